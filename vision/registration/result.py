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
    """How well overlapping pictures agree, by `points` tie points that no fit has seen.

    On the ground in metres, and in pixels of the features; medians, and what 90 % are below.
    """

    points: int
    median_m: float
    most_m: float
    median_px: float
    most_px: float


@dataclass(frozen=True, slots=True)
class Net:
    """Views that hang together by overlaps and were adjusted together.

    Attributes:
        members: indices of the views.
        pairs: how many overlaps hold them.
        focal: by camera, the focal length as a share of what was told.
        slope: of the ground towards (east, north), tangents, positive where it falls.
        height_bias: what height tags have in common, as a share.
        yaw_bias_rad: what headings have in common.
        position_sigma_m: how far geotags are off one by one; None for too few of them.
        yaw_sigma_rad: how certain the heading of the whole net is.
        scale_sigma: how certain its scale is, as a share.
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
    """What a registration found.

    Attributes:
        refined: of each view in the order given, its pose; None: left as tagged.
        left: of each view, why it was left as tagged; None where it was not.
        nets: the adjusted groups, the largest first.
        before: how well the refined pictures agreed as tagged; None where tags lack a heading or
            a height. Pictures that were stored upside down are turned for this, too.
        after: how well they agree now; None where nothing was refined.
    """

    refined: tuple[Refined | None, ...]
    left: tuple[str | None, ...]
    nets: tuple[Net, ...]
    before: Agreement | None
    after: Agreement | None
