"""What goes into a registration and what comes out: views with their tags, and refined poses.

All positions are metres in one local frame: true east, true north, and up from the ground. Pixels
are those of `vision.camera`, counted from the middle of the picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Prior:
    """A value that a tag tells, and its standard deviation, in the same unit; above 0."""

    value: float
    sigma: float


@dataclass(frozen=True, slots=True)
class Features:
    """What is kept of a picture: at most `features.MOST` distinctive points.

    Attributes:
        points: (n, 2), pixels to the right of and below the middle of the picture, without lens
            distortion.
        descriptors: (n, 128) uint8.
        width_px: columns of the picture that the pixels belong to.
        height_px: rows of it.
    """

    points: Floats
    descriptors: NDArray[np.uint8]
    width_px: int
    height_px: int


class Described(Protocol):
    """`Features`, wherever they are kept: of ten thousand pictures they fill a memory."""

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
    """A picture to be registered: its features, and what its tags say; None where they are silent.

    Attributes:
        name: how the picture is called; no two views have the same.
        features: its distinctive points.
        focal_px: the focal length in pixels of `features`.
        camera: views with the same word here were taken by one camera, and share a focal length.
        east_m: the geotag, metres true east.
        north_m: the geotag, metres true north.
        position_sigma_m: standard deviation of either, without what all tags have in common.
        height_m: above the ground; over a relief, above the level that its heights are counted
            from.
        yaw_rad: true bearing of the picture's upper edge.
        tilt: where straight down lies, as the ray (right, down) over forward, in camera axes:
            (0, 0) looks straight down.
        tilt_sigma: standard deviation of either, radians.
        ground_m: the height of the ground below, of a relief.
    """

    name: str
    features: Described
    focal_px: Prior
    camera: str
    east_m: float
    north_m: float
    position_sigma_m: float = 10.0
    height_m: Prior | None = None
    yaw_rad: Prior | None = None
    tilt: tuple[float, float] = (0.0, 0.0)
    tilt_sigma: float = 0.12
    ground_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Refined:
    """The pose of one view after the adjustment.

    Attributes:
        centre_m: the camera, metres (east, north, up).
        axes: 3 x 3; columns are the picture's right, its down, and forward, in (east, north, up).
        focal_px: the focal length.
        position_sigma_m: standard deviation of east and of north, within the net of overlaps.
        height_sigma_m: of the height.
        yaw_sigma_rad: of the bearing of the upper edge.
        component: number of the group of views that hang together by overlaps, from 0.
        turned: the tagged bearing is that of the lower edge: stored upside down.
        matches: tie points that hold the view.
        residual_px: median transfer error of them.
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
