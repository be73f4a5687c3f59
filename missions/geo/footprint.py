"""The footprint of a camera that looks straight down on flat ground, and its resolution.

Planning needs only the level case. A camera on a tilted vehicle sees the ground through a
homography (`vision.camera`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

TOUCH_M = 1e-6
"""Tolerance at the edge of a footprint, m, whatever the rounding of a cell's corners."""


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
        """Raise `ValueError` for values that are no camera."""
        if not 0.0 < self.hfov_rad < math.pi:
            raise ValueError(f"hfov_rad is {self.hfov_rad:g}, expected 0 to pi, open")
        if self.width_px < 1 or self.height_px < 1:
            raise ValueError(f"a picture of {self.width_px} x {self.height_px} px has no pixels")

    @property
    def focal_px(self) -> float:
        """Focal length in pixels."""
        return self.width_px / 2.0 / math.tan(self.hfov_rad / 2.0)

    def gsd_m(self, height_m: float) -> float:
        """Return the ground sample distance from `height_m` above the ground, m per pixel."""
        return height_m / self.focal_px

    def footprint(self, height_m: float) -> Footprint:
        """Return the footprint of the level camera from `height_m` above the ground."""
        gsd_m = self.gsd_m(height_m)
        return Footprint(self.width_px * gsd_m, self.height_px * gsd_m)

    def pixels_per_cell(self, height_m: float, cell_m: float) -> float:
        """Return the pixels of a cell's edge, from `height_m` above the ground."""
        return cell_m / self.gsd_m(height_m)

    def height_m(self, cell_m: float, pixels_per_cell: float) -> float:
        """Return the height for a number of pixels: the inverse of `pixels_per_cell`."""
        return self.focal_px * cell_m / pixels_per_cell
