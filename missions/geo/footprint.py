"""What a camera that looks straight down shows of flat ground, and how finely.

A pinhole with square pixels, its optical axis through the middle of the picture. A camera on a
tilted vehicle sees the ground through a homography (`vision.camera`); this is the level case, which
is what can be planned with: before a picture is taken nobody knows the tilt.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from missions.units import Cell, GridPoint

TOUCH_M = 1e-6
"""A cell on the very edge of a footprint is inside, whatever the last bits of its corners say."""


class Footprint(NamedTuple):
    """The rectangle of ground in a level picture: metres along its upper edge, and its side edge.

    >>> Footprint(20.0, 15.0).short_m
    15.0
    """

    across_m: float
    along_m: float

    @property
    def short_m(self) -> float:
        """The shorter side."""
        return min(self)

    def whole_cells(
        self, centre: GridPoint, bearing_rad: float, cell_m: float, margin_m: float = 0.0
    ) -> tuple[Cell, ...]:
        """The cells that lie wholly inside, sorted by column and row.

        Args:
            centre: The ground below the camera, in the grid's moving frame.
            bearing_rad: Where the upper edge of the picture points, clockwise from grid north.
            cell_m: Edge of a cell, above 0.
            margin_m: How far from the rim of the footprint a cell must stay, at least 0.

        >>> Footprint(20.0, 15.0).whole_cells(GridPoint(0.0, 0.0), 0.0, 5.0)[:3]
        (Cell(east=-1, north=-1), Cell(east=-1, north=0), Cell(east=-1, north=1))
        """
        cos, sin = math.cos(bearing_rad), math.sin(bearing_rad)
        # how far a cell reaches from its centre, along either side of the picture
        reach_m = cell_m / 2.0 * (abs(cos) + abs(sin)) + margin_m - TOUCH_M
        across_m, along_m = self.across_m / 2.0 - reach_m, self.along_m / 2.0 - reach_m
        if across_m < 0.0 or along_m < 0.0:
            return ()
        east_m = abs(cos) * across_m + abs(sin) * along_m
        north_m = abs(sin) * across_m + abs(cos) * along_m
        found = []
        for east in _between(centre.east_m, east_m, cell_m):
            for north in _between(centre.north_m, north_m, cell_m):
                away_e, away_n = east * cell_m - centre.east_m, north * cell_m - centre.north_m
                if (
                    abs(away_e * cos - away_n * sin) <= across_m
                    and abs(away_e * sin + away_n * cos) <= along_m
                ):
                    found.append(Cell(east, north))
        return tuple(found)


def _between(middle_m: float, reach_m: float, cell_m: float) -> range:
    """The columns, or rows, whose centre is no farther than this from a coordinate."""
    first = math.ceil((middle_m - reach_m) / cell_m)
    return range(first, math.floor((middle_m + reach_m) / cell_m) + 1)


@dataclass(frozen=True, slots=True)
class Optics:
    """A pinhole camera with square pixels, its optical axis through the middle of the picture.

    Attributes:
        hfov_rad: Angle of view across the picture, 0 to pi, open.
        width_px: Columns of the picture, at least 1.
        height_px: Rows of the picture, at least 1.

    >>> camera = Optics(math.radians(90.0), 640, 480)
    >>> round(camera.focal_px, 9)
    320.0
    >>> across_m, along_m = camera.footprint(12.0)
    >>> round(across_m, 9), round(along_m, 9)
    (24.0, 18.0)
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

    @property
    def vfov_rad(self) -> float:
        """Angle of view along the picture, top to bottom."""
        return 2.0 * math.atan(self.height_px / 2.0 / self.focal_px)

    def gsd_m(self, height_m: float) -> float:
        """Ground sample distance: metres of ground to a pixel, from `height_m` above it."""
        return height_m / self.focal_px

    def footprint(self, height_m: float) -> Footprint:
        """What the level camera shows from `height_m` above the ground."""
        gsd_m = self.gsd_m(height_m)
        return Footprint(self.width_px * gsd_m, self.height_px * gsd_m)

    def pixels_per_cell(self, height_m: float, cell_m: float) -> float:
        """How many pixels the edge of a cell of `cell_m` has, from `height_m` above the ground."""
        return cell_m / self.gsd_m(height_m)

    def height_m(self, cell_m: float, pixels_per_cell: float) -> float:
        """From how high the edge of a cell has so many pixels: the inverse of `pixels_per_cell`.

        >>> camera = Optics(math.radians(90.0), 640, 480)
        >>> round(camera.height_m(cell_m=4.0, pixels_per_cell=80.0), 9)
        16.0
        """
        return self.focal_px * cell_m / pixels_per_cell
