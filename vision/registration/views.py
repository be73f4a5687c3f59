"""Views with their tags, the input of a registration, and refined poses, its result.

Positions are metres in one local frame: true east, true north, and up from the ground. Pixels are
those of `vision.camera`, counted from the middle of the picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int64]


class Measured(NamedTuple):
    """A number and its standard deviation, above 0, in the same unit."""

    value: float
    sigma: float


@dataclass(frozen=True, slots=True)
class Features:
    """Distinctive points of a picture of `width_px` x `height_px`.

    Attributes:
        points: (n, 2), pixels right of and below the middle of the picture, without distortion.
        descriptors: (n, 128) uint8.
    """

    points: Floats
    descriptors: NDArray[np.uint8]
    width_px: int
    height_px: int


class FeaturesLike(Protocol):
    """`Features`, in memory or on disk: ten thousand pictures have more than fit into memory."""

    @property
    def points(self) -> Floats: ...  # noqa: D102
    @property
    def descriptors(self) -> NDArray[np.uint8]: ...  # noqa: D102
    @property
    def width_px(self) -> int: ...  # noqa: D102
    @property
    def height_px(self) -> int: ...  # noqa: D102


@dataclass(frozen=True, slots=True)
class View:
    """A picture to be registered: its features and its tags; None for a missing tag.

    Attributes:
        name: Unique.
        focal_px: The focal length in pixels of `features`.
        camera: Name of the camera; its views share a focal length.
        position_sigma_m: Error of east and of north, without the common error of all tags.
        height_m: Height above the ground; over a relief, above the level of its heights.
        yaw_rad: True bearing of the picture's upper edge.
        tilt: Straight down, as the ray (right, down) over forward, in camera axes.
        tilt_sigma: Standard deviation of either, radians.
        ground_m: The height of the ground below, on a relief.
    """

    name: str
    features: FeaturesLike
    focal_px: Measured
    camera: str
    east_m: float
    north_m: float
    position_sigma_m: float = 10.0
    height_m: Measured | None = None
    yaw_rad: Measured | None = None
    tilt: tuple[float, float] = (0.0, 0.0)
    tilt_sigma: float = 0.12
    ground_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Refined:
    """The pose of one view after the adjustment.

    Attributes:
        centre_m: The camera, metres (east, north, up).
        axes: 3 x 3; columns are the picture's right, down, and forward, in (east, north, up).
        position_sigma_m: Error of east and of north, within the net of overlaps.
        yaw_sigma_rad: Error of the bearing of the upper edge.
        component: Number of the net, from 0.
        turned: True for a picture stored upside down: its tagged bearing is that of the lower edge.
        residual_px: Median transfer error of its matches.
    """

    centre_m: Floats
    axes: Floats
    focal_px: float
    position_sigma_m: float
    height_sigma_m: float
    yaw_sigma_rad: float
    component: int
    turned: bool
    matches: int
    residual_px: float


NO_OVERLAP: Final = "no overlap with another picture was found"
NO_TEXTURE: Final = "it shows nothing distinctive"
SIDEWAYS: Final = "it looks too far to the side"
CONTRADICTED: Final = "its overlaps contradict each other"
NO_HEADING: Final = "the positions of its net are too close together to give its heading"
NO_SCALE: Final = "the positions of its net are too close together to give its height"


@dataclass(frozen=True, slots=True)
class Agreement:
    """The agreement of overlapping pictures, by `points` tie points that no fit has used.

    It is in metres on the ground, and in pixels of the features; `most` is the 90 % quantile.
    """

    points: int
    median_m: float
    most_m: float
    median_px: float
    most_px: float


@dataclass(frozen=True, slots=True)
class Net:
    """Views that overlaps connect, adjusted together.

    Attributes:
        members: Indices of the views.
        focal: Focal length of each camera, as a share of the tagged one.
        slope: Slope of the ground towards (east, north), tangents, positive where it falls.
        height_bias: Common error of height tags, as a share.
        yaw_bias_rad: Common error of headings.
        position_sigma_m: Error of single geotags; None for too few of them.
    """

    members: tuple[int, ...]
    pairs: int
    focal: dict[str, float]
    slope: tuple[float, float]
    height_bias: float
    yaw_bias_rad: float
    position_sigma_m: float | None


@dataclass(frozen=True, slots=True)
class Registration:
    """The result for all views, in the order given.

    Attributes:
        refined: The pose; None if the view was left as tagged.
        left: Reason why a view was left as tagged; None if it was not.
        nets: The adjusted groups, the largest first.
        before: Agreement of the refined pictures as tagged (upright); None if tags lack a heading
            or a height.
        after: Their agreement now; None if nothing was refined.
    """

    refined: tuple[Refined | None, ...]
    left: tuple[str | None, ...]
    nets: tuple[Net, ...]
    before: Agreement | None
    after: Agreement | None
