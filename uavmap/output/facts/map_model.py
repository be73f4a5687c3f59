"""What a finished or running mission has to show: the input of every writer in this package."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from missions.geo.grid import Grid
from missions.units import Cell, GridPoint, LatLon
from uavmap.output.facts.cell_table import AT_ONCE, NOT_ROI, CellRow, CellTable, State
from uavmap.output.facts.outline import outline

__all__ = ["NOT_ROI", "CellRow", "CellTable", "MapData", "State", "Track"]


@dataclass(frozen=True, slots=True)
class Track:
    """Where a vehicle went: (mission seconds, position over ground, metres above home)."""

    vehicle: int
    points: tuple[tuple[float, LatLon, float], ...]


@dataclass(frozen=True)
class MapData:
    """A map at the mission time `t_s`, and what belongs into its picture.

    `truth` is the real region in ground metres of the grid's moving frame; None where nobody
    knows it, which is everywhere but in simulation. `box`, `fence` and `fence_holes` are rings,
    open or closed, fixed to the ground.
    """

    mission: str
    grid: Grid
    t_s: float
    cells: Sequence[CellRow]
    tracks: tuple[Track, ...]
    start: LatLon
    box: tuple[LatLon, ...]
    fence: tuple[LatLon, ...]
    fence_holes: tuple[tuple[LatLon, ...], ...] = ()
    truth: BaseGeometry | None = None
    unsearched: tuple[tuple[LatLon, LatLon], ...] = ()
    """Stretches of search lanes that no judged frame shows, fixed to the ground."""
    pictures: int | None = None
    """Of a replay, from how many pictures the map is; None for a flight."""
    boundary: BaseGeometry | None = None
    """The region's boundary at pixel level, in the moving frame, where pictures told it."""

    def place(self, point: GridPoint) -> LatLon:
        """Where a point of the region is at the time of the map."""
        return self.grid.position(self.grid.to_fixed(point, self.t_s))

    def with_boundary(self, boundary: BaseGeometry) -> MapData:
        """The same map with a boundary; what was reckoned of its cells is not reckoned again."""
        other = replace(self, boundary=boundary)
        kept = ("corners", "outline", "squares", "table")
        other.__dict__.update({name: self.__dict__[name] for name in kept if name in self.__dict__})
        return other

    @cached_property
    def table(self) -> CellTable:
        """The cells in columns, in their order."""
        return self.cells if isinstance(self.cells, CellTable) else CellTable.of(self.cells)

    @cached_property
    def corners(self) -> CellCorners:
        """The corners of `cells`, in their order, at the time of the map."""
        return CellCorners.of(self.table.cells, self.grid, self.t_s)

    @cached_property
    def outline(self) -> Polygon | MultiPolygon:
        """Around the cells of the region, in the moving frame (`uavmap.output.facts.outline`)."""
        return outline(self.roi_cells, self.grid)

    @cached_property
    def squares(self) -> NDArray[np.float64]:
        """West, south, east and north of each cell over ground at the time of the map, metres in
        the fixed frame; shape (n, 4)."""
        return squares_of(self.table.cells, self.grid, self.t_s)

    @property
    def roi_cells(self) -> tuple[Cell, ...]:
        """The cells of the region, in the order of `cells`."""
        return tuple(Cell(*cell) for cell in self.table.cells[self.table.roi].tolist())


Text = TypeVar("Text")
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
    >>> found = CellCorners.of(np.array([[0, 0], [1, 0]], np.int32), grid, t_s=0.0)
    >>> len(found.lon_deg), found.rings.tolist()
    (6, [[0, 2, 3, 1], [2, 4, 5, 3]])
    """

    lon_deg: NDArray[np.float64]
    lat_deg: NDArray[np.float64]
    rings: NDArray[np.int32]

    @classmethod
    def of(cls, cells: NDArray[np.int32], grid: Grid, t_s: float) -> CellCorners:
        """The corners of cells, where they are over ground at a mission time."""
        if not len(cells):
            return cls(np.empty(0), np.empty(0), np.empty((0, 4), np.int32))
        # on the lattice of half cells, corners are whole numbers
        lattice = (2 * cells.astype(np.int64)[:, None] + _AROUND).reshape(-1, 2)
        low = lattice.min(axis=0)
        wide = int(np.ptp(lattice[:, 1])) + 1
        numbers, which = np.unique((lattice - low) @ [wide, 1], return_inverse=True)
        nodes = np.column_stack(np.divmod(numbers, wide)) + low
        places = on_earth(nodes * (grid.cell_m / 2.0), grid, t_s)
        lon_deg, lat_deg = (np.ascontiguousarray(degrees) for degrees in places.T)
        return cls(lon_deg, lat_deg, which.reshape(-1, 4).astype(np.int32))

    def which(self, some: NDArray[np.bool_]) -> CellCorners:
        """Those of some of the cells."""
        return CellCorners(self.lon_deg, self.lat_deg, self.rings[some])

    def written(
        self, write: Callable[[NDArray[np.float64], NDArray[np.float64]], list[Text]]
    ) -> Iterator[list[list[Text]]]:
        """The four corners of each cell as they are written, `AT_ONCE` cells at a time.

        `write` makes texts of longitudes and latitudes.
        """
        for first in range(0, len(self.rings), AT_ONCE):
            rings = self.rings[first : first + AT_ONCE]
            numbers, which = np.unique(rings, return_inverse=True)
            texts = write(self.lon_deg[numbers], self.lat_deg[numbers])
            yield [
                [texts[sw], texts[se], texts[ne], texts[nw]]
                for sw, se, ne, nw in which.reshape(-1, 4).tolist()
            ]


def on_earth(points: NDArray[np.float64], grid: Grid, t_s: float) -> NDArray[np.float64]:
    """Longitudes and latitudes, shape (n, 2), of points of the moving frame at a mission time."""
    drift_m = np.array([grid.drift_east_m_s * t_s, grid.drift_north_m_s * t_s])
    origin = np.array([grid.origin.east_m, grid.origin.north_m])
    return grid.zone.lon_lat(origin + (points + drift_m) * grid.scale)


def squares_of(cells: NDArray[np.int32], grid: Grid, t_s: float) -> NDArray[np.float64]:
    """West, south, east and north of cells over ground at a mission time, metres in the fixed
    frame; shape (n, 4)."""
    half_m, middle_m = grid.cell_m / 2, cells.astype(np.float64) * grid.cell_m
    drift_m = np.array([grid.drift_east_m_s * t_s, grid.drift_north_m_s * t_s])
    return np.hstack([middle_m - half_m + drift_m, middle_m + half_m + drift_m])
