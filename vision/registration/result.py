"""What a registration found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from vision.registration.views import Refined

NO_OVERLAP: Final = "no overlap with another picture was found"
NO_TEXTURE: Final = "it shows nothing distinctive"
SIDEWAYS: Final = "it looks too far to the side"
CONTRADICTED: Final = "its overlaps contradict each other"
NO_HEADING: Final = "the positions of its net lie too close together to tell which way it faces"
NO_SCALE: Final = "the positions of its net lie too close together to tell how high it was taken"


@dataclass(frozen=True, slots=True)
class Agreement:
    """How well overlapping pictures agree, by `points` tie points that no fit has used.

    On the ground in metres, and in pixels of the features; `most` is the 90 % quantile.
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
        pairs: Count of overlaps.
        focal: By camera, the focal length as a share of the tagged one.
        slope: Of the ground towards (east, north), tangents, positive where it falls.
        height_bias: Common error of height tags, as a share.
        yaw_bias_rad: Common error of headings.
        position_sigma_m: Of geotags one by one; None for too few of them.
        yaw_sigma_rad: Of the heading of the whole net.
        scale_sigma: Of its scale, as a share.
    """

    members: tuple[int, ...]
    pairs: int
    focal: dict[str, float]
    slope: tuple[float, float]
    height_bias: float
    yaw_bias_rad: float
    position_sigma_m: float | None
    yaw_sigma_rad: float
    scale_sigma: float


@dataclass(frozen=True, slots=True)
class Registration:
    """The result for all views, in the order given.

    Attributes:
        refined: The pose; None: left as tagged.
        left: Why a view was left as tagged; None where it was not.
        nets: The adjusted groups, the largest first.
        before: Agreement of the refined pictures as tagged (upright); None where tags lack a
            heading or a height.
        after: Their agreement now; None where nothing was refined.
    """

    refined: tuple[Refined | None, ...]
    left: tuple[str | None, ...]
    nets: tuple[Net, ...]
    before: Agreement | None
    after: Agreement | None
