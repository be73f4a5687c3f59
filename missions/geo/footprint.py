"""What a camera that looks straight down shows of flat ground, and how finely.

The level case, which planning needs: a camera on a tilted vehicle sees the ground through a
homography (`vision.camera`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

TOUCH_M = 1e-6
"""A cell on the very edge of a footprint is inside, whatever the last bits of its corners say."""


class Footprint(NamedTuple):
    """The rectangle of ground in a level picture: metres along its upper and its side edge."""

    across_m: float
    along_m: float

    @property
    def short_m(self) -> float:
        """The shorter side."""
        return min(self)


@dataclass(frozen=True, slots=True)
class Optics:
    """A pinhole camera with square pixels, its optical axis through the middle of the picture.

    Attributes:
        hfov_rad: Angle of view across the picture, 0 to pi, open.
        width_px: Columns of the picture, at least 1.
        height_px: Rows of the picture, at least 1.
    """

    hfov_rad: float
    width_px: int
    height_px: int

    def __post_init__(self) -> None:
        """Refuse what is not a camera with `ValueError`."""
        if not 0.0 < self.hfov_rad < math.pi:
            raise ValueError(f"hfov_rad is {self.hfov_rad:g}, expected 0 to pi, open")
        if self.width_px < 1 or self.height_px < 1:
            raise ValueError(f"a picture of {self.width_px} x {self.height_px} px has no pixels")

    @property
    def focal_px(self) -> float:
        """Focal length in pixels."""
        return self.width_px / 2.0 / math.tan(self.hfov_rad / 2.0)

    def gsd_m(self, height_m: float) -> float:
        """Ground sample distance: metres of ground to a pixel, from `height_m` above it."""
        return height_m / self.focal_px

    def footprint(self, height_m: float) -> Footprint:
        """What the level camera shows from `height_m` above the ground."""
        gsd_m = self.gsd_m(height_m)
        return Footprint(self.width_px * gsd_m, self.height_px * gsd_m)

    def pixels_per_cell(self, height_m: float, cell_m: float) -> float:
        """Pixels of a cell's edge, from `height_m` above the ground."""
        return cell_m / self.gsd_m(height_m)

    def height_m(self, cell_m: float, pixels_per_cell: float) -> float:
        """The inverse of `pixels_per_cell`."""
        return self.focal_px * cell_m / pixels_per_cell
