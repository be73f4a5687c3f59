"""What a finished or running mission has to show: the input of every writer in this package."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from missions.geo.grid import Grid
from missions.units import Cell, GridPoint, LatLon
from uavmap.output.facts.cell_corners import CellCorners, squares_of
from uavmap.output.facts.cell_table import NOT_ROI, CellRow, CellTable, State
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
