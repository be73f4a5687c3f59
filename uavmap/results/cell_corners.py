"""Where the corners of a map's cells are, each reckoned and written down once.

Four cells share a corner, and a map has thousands of them: the projection takes all corners at
once, and what a file says of one is text that is made once.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.ground.grid import Grid
from missions.units import Cell

_AT_ONCE: Final = 4096
_AROUND: Final = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])


@dataclass(frozen=True, slots=True)
class CellCorners:
    """The corners of cells.

    Attributes:
        lon_deg: Of each corner that a cell has.
        lat_deg: The same.
        rings: Of each cell its corners by number, shape (n, 4): south-west, south-east, north-east,
            north-west.

    >>> from missions.units import LatLon
    >>> grid = Grid.at(LatLon(48.0, 11.0), cell_m=4.0)
    >>> found = CellCorners.of([Cell(0, 0), Cell(1, 0)], grid, t_s=0.0)
    >>> len(found.lon_deg), list(found.each())
    (6, [[0, 2, 3, 1], [2, 4, 5, 3]])
    """

    lon_deg: list[float]
    lat_deg: list[float]
    rings: NDArray[np.intp]

    @classmethod
    def of(cls, cells: list[Cell], grid: Grid, t_s: float) -> CellCorners:
        """The corners of cells, where they are over ground at a mission time."""
        if not cells:
            return cls([], [], np.empty((0, 4), np.intp))
        # on the lattice of half cells, corners are whole numbers
        lattice = (2 * np.array(cells, dtype=np.int64)[:, None] + _AROUND).reshape(-1, 2)
        low = lattice.min(axis=0)
        wide = int(np.ptp(lattice[:, 1])) + 1
        numbers, which = np.unique((lattice - low) @ [wide, 1], return_inverse=True)
        nodes = np.column_stack(np.divmod(numbers, wide)) + low
        places = on_earth(nodes * (grid.cell_m / 2.0), grid, t_s)
        lon_deg, lat_deg = places.T.tolist()
        return cls(lon_deg, lat_deg, which.reshape(-1, 4))

    def each(self) -> Iterator[list[int]]:
        """The four corners of each cell; numbers of thousands of cells at once are much."""
        for first in range(0, len(self.rings), _AT_ONCE):
            yield from self.rings[first : first + _AT_ONCE].tolist()


def on_earth(points: NDArray[np.float64], grid: Grid, t_s: float) -> NDArray[np.float64]:
    """Longitudes and latitudes, shape (n, 2), of points of the moving frame at a mission time."""
    drift_m = np.array([grid.drift_east_m_s * t_s, grid.drift_north_m_s * t_s])
    origin = np.array([grid.origin.east_m, grid.origin.north_m])
    return grid.zone.lon_lat(origin + (points + drift_m) * grid.scale)


def squares_of(cells: list[Cell], grid: Grid, t_s: float) -> NDArray[np.float64]:
    """West, south, east and north of cells over ground at a mission time, metres in the fixed
    frame; shape (n, 4)."""
    half_m, middle_m = grid.cell_m / 2, np.array(cells, np.float64).reshape(-1, 2) * grid.cell_m
    drift_m = np.array([grid.drift_east_m_s * t_s, grid.drift_north_m_s * t_s])
    return np.hstack([middle_m - half_m + drift_m, middle_m + half_m + drift_m])
