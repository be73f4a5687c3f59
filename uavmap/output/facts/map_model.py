"""A map with all that its writers show, among it the outline of its region."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final, Literal, NamedTuple, Self, get_args

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import affinity
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from missions.classes import Classes
from missions.geo.grid import Grid
from missions.mapping.frame_sums import FrameSums
from missions.units import Cell, LatLon

Runs = list[tuple[int, int, int]]
"""Row, first and last column of neighbours in a row."""


def outline(cells: Collection[Cell], grid: Grid) -> Polygon | MultiPolygon:
    """Unite cells in ground metres of the grid's moving frame.

    Exterior rings run counter-clockwise, holes clockwise. Cells that share only a corner are
    separate parts. No cells give an empty polygon.

    >>> from missions.units import LatLon
    >>> shape = outline([Cell(0, 0), Cell(1, 0)], Grid.at(LatLon(48.0, 11.0), cell_m=4.0))
    >>> shape.bounds, len(shape.exterior.coords)
    ((-2.0, -2.0, 6.0, 2.0), 5)
    """
    if not cells:
        return Polygon()
    # on the lattice of half cells, corners are whole numbers and edges meet exactly
    row, first, last = 2.0 * np.array(runs(np.array(list(cells))), dtype=np.float64).T
    united = shapely.union_all(shapely.box(first - 1, row - 1, last + 1, row + 1))
    half_m = grid.cell_m / 2
    scaled = affinity.scale(united, half_m, half_m, origin=(0.0, 0.0))
    parts = []
    for part in getattr(scaled, "geoms", [scaled]):
        outer, *holes = (_corners(ring) for ring in (part.exterior, *part.interiors))
        parts.append(orient(Polygon(outer, holes)))
    return parts[0] if len(parts) == 1 else MultiPolygon(parts)


def runs(cells: NDArray[np.integer]) -> Runs:
    """Return row, first and last column of each run of neighbours.

    >>> runs(np.array([[4, 1], [5, 1], [7, 1], [5, 2]]))
    [(1, 4, 5), (1, 7, 7), (2, 5, 5)]
    """
    if not len(cells):
        return []
    order = np.lexsort((cells[:, 0], cells[:, 1]))
    columns, rows = cells[order].T
    breaks = np.flatnonzero((np.diff(rows) != 0) | (np.diff(columns) != 1))
    first, last = np.r_[0, breaks + 1], np.r_[breaks, len(rows) - 1]
    return list(
        zip(rows[first].tolist(), columns[first].tolist(), columns[last].tolist(), strict=True)
    )


def _corners(ring: shapely.LinearRing) -> NDArray[np.float64]:
    """Return the vertices at which an axis-parallel ring turns."""
    points = shapely.get_coordinates(ring)[:-1]
    before, after = (np.roll(points, by, axis=0) for by in (1, -1))
    straight = ((before == points) & (points == after)).any(axis=1)
    found: NDArray[np.float64] = points[~straight]
    return found


State = Literal[
    "non-roi",
    "unexplored",
    "under exploration",
    "explored",
    "provisional",
    "provisional non-roi",
    "skipped",
    "unsure",
]
"""Skipped: region that the operator excluded from looks. Provisional: the majority of frames, while
they are too few for a verdict. Unsure: not taken for region, and like nothing that the detector
knows."""

NOT_ROI: frozenset[State] = frozenset(("non-roi", "provisional", "provisional non-roi", "unsure"))
"""States that are not region."""

_STATES: Final[tuple[State, ...]] = get_args(State)
_CODES: Final = {state: np.uint8(code) for code, state in enumerate(_STATES)}
_ROI: Final = np.array([state not in NOT_ROI for state in _STATES])
AT_ONCE: Final = 4096
"""Number of cells that are written at a time."""


class CellRow(NamedTuple):
    """One cell of the map: its state and the frames that voted for it."""

    cell: Cell
    state: State
    positive: int
    votes: int


@dataclass(frozen=True, slots=True, eq=False)
class CellTable:
    """Cells, column by column (tens of bytes a cell).

    Attributes:
        cells: Columns and rows, shape (n, 2).
        codes: Of the states, shape (n,).
        positive: Number of frames whose verdict is region.
        votes: Number of frames that voted.
        belief: Believed share of region, 0 to 1; None where nothing is weighed.
        shares: Mean share of each class of the region, (n, classes); None without classes.

    >>> rows = [CellRow(Cell(3, 4), "explored", 2, 3), CellRow(Cell(3, 5), "non-roi", 0, 3)]
    >>> table = CellTable.of(rows)
    >>> table.cells.tolist(), table.roi.tolist(), next(table.values())
    ([[3, 4], [3, 5]], [True, False], ([3, 4], 'explored', 2, 3, None))
    """

    cells: NDArray[np.int32]
    codes: NDArray[np.uint8]
    positive: NDArray[np.int32]
    votes: NDArray[np.int32]
    belief: NDArray[np.float64] | None = None
    shares: NDArray[np.float64] | None = None

    @classmethod
    def of(cls, rows: Iterable[CellRow]) -> Self:
        """Create the table of a flight, where nothing is weighed."""
        found = list(rows)
        return cls(
            np.array([row.cell for row in found], np.int32).reshape(-1, 2),
            np.array([_CODES[row.state] for row in found], np.uint8),
            np.array([row.positive for row in found], np.int32),
            np.array([row.votes for row in found], np.int32),
        )

    @classmethod
    def judged(
        cls,
        cells: NDArray[np.int32],
        roi: NDArray[np.bool_],
        positive: NDArray[np.int32],
        votes: NDArray[np.int32],
        belief: NDArray[np.float64] | None,
    ) -> Self:
        """Create the table of recorded pictures, where a cell is region or not."""
        codes = np.where(roi, _CODES["explored"], _CODES["non-roi"])
        return cls(cells, codes, positive, votes, belief)

    def __len__(self) -> int:
        return len(self.cells)

    def with_sums(self, sums: FrameSums, numbers: Sequence[int]) -> CellTable:
        """Return the table with cells unsure that are no region, and with the shares of classes."""
        codes = np.where(sums.are(self.cells) & ~self.roi, _CODES["unsure"], self.codes)
        shares = sums.shares(self.cells, numbers) if numbers else None
        return replace(self, codes=codes, shares=shares)

    def which(self, some: slice | Sequence[int] | NDArray[np.bool_]) -> CellTable:
        """Return the table of some of the cells."""
        belief, shares = (
            None if column is None else column[some] for column in (self.belief, self.shares)
        )
        counts = self.positive[some], self.votes[some]
        return CellTable(self.cells[some], self.codes[some], *counts, belief, shares)

    def parts(self) -> Iterator[CellTable]:
        """Yield the table in parts of at most `AT_ONCE` cells."""
        for first in range(0, len(self), AT_ONCE):
            yield self.which(slice(first, first + AT_ONCE))

    def values(self) -> Iterator[tuple[list[int], State, int, int, float | None]]:
        """Yield the fields of each row."""
        beliefs = [None] * len(self) if self.belief is None else self.belief.tolist()
        states = [_STATES[code] for code in self.codes.tolist()]
        columns = self.cells.tolist(), states, self.positive.tolist(), self.votes.tolist()
        return zip(*columns, beliefs, strict=True)

    @property
    def roi(self) -> NDArray[np.bool_]:
        """Which cells are part of the region."""
        found: NDArray[np.bool_] = _ROI[self.codes]
        return found

    @property
    def classes(self) -> NDArray[np.intp]:
        """The column of the class that frames saw most of, in cells of the region; else -1."""
        if self.shares is None:
            return np.full(len(self), -1)
        known = self.roi & (self.shares.max(axis=1) > 0.0)
        return np.where(known, self.shares.argmax(axis=1), -1)

    def are(self, state: State) -> NDArray[np.bool_]:
        """Return which cells are in a state."""
        found: NDArray[np.bool_] = self.codes == _CODES[state]
        return found

    def counts(self) -> dict[State, int]:
        """Return the number of cells in each state that occurs."""
        many = np.bincount(self.codes, minlength=len(_STATES)).tolist()
        return {state: count for state, count in zip(_STATES, many, strict=True) if count}


def packed(cells: NDArray[np.int32]) -> NDArray[np.int64]:
    """Pack each cell into a whole number, in the order of the cells.

    >>> packed(np.array([[0, -1], [0, 1], [1, 0]], np.int32)).argsort().tolist()
    [0, 1, 2]
    """
    found: NDArray[np.int64] = (cells[:, 0].astype(np.int64) << 32) + cells[:, 1]
    return found


@dataclass(frozen=True, slots=True)
class Track:
    """Where a vehicle went: (mission seconds, position over ground, metres above home)."""

    vehicle: int
    points: tuple[tuple[float, LatLon, float], ...]


@dataclass(frozen=True, slots=True)
class ClassArea:
    """The cells of a class of the region, and how large it is.

    Attributes:
        outline: Around its cells, in the moving frame; may be empty.
        area_m2: Of its cells.
        low_m2: The area that frames saw of it in its cells, on average.
        high_m2: Its cells, and what frames saw of it in others.
        thickness_um: The least, and the greatest if there is a bound above; None: not known.
    """

    number: int
    name: str
    cells: tuple[Cell, ...]
    outline: Polygon | MultiPolygon
    area_m2: float
    low_m2: float
    high_m2: float
    thickness_um: tuple[float, ...] | None

    @property
    def volume_l(self) -> tuple[float, float | None] | None:
        """The least and the greatest volume, litres: a micrometre on a square metre is 1 ml."""
        if self.thickness_um is None:
            return None
        least, *most = (um / 1000.0 for um in self.thickness_um)
        return self.low_m2 * least, self.high_m2 * most[0] if most else None

    def figures(self) -> dict[str, Any]:
        """Return the figures for files; litres only where a thickness is known."""
        found = {
            "number": self.number,
            "name": self.name,
            "cells": len(self.cells),
            "area_m2": round(self.area_m2, 1),
            "area_low_m2": round(self.low_m2, 1),
            "area_high_m2": round(self.high_m2, 1),
        }
        if self.volume_l is None:
            return found
        low_l, high_l = self.volume_l
        volume_l = [round(low_l, 3), None if high_l is None else round(high_l, 3)]
        return {**found, "volume_l": volume_l}


def class_figures(classes: Sequence[ClassArea]) -> dict[str, Any]:
    """Return what the summary has of classes, and their volume together; empty without any."""
    if not classes:
        return {}
    found: dict[str, Any] = {"classes": [one.figures() for one in classes]}
    volumes_l = [one.volume_l for one in classes if one.volume_l is not None]
    if volumes_l:
        low_l, high_l = zip(*volumes_l, strict=True)
        most_l = None if None in high_l else round(sum(high_l), 3)
        found["volume_l"] = [round(sum(low_l), 3), most_l]
    return found


@dataclass(frozen=True)
class MapData:
    """A map at the mission time `t_s`.

    `truth` is the real region in ground metres of the grid's moving frame; None outside of
    simulation. `box`, `fence` and `fence_holes` are rings, open or closed, fixed to the ground.
    """

    mission: str
    grid: Grid
    t_s: float
    cells: CellTable
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
    """The region's boundary at pixel level, in the moving frame, where pictures show it."""
    classes: Classes | None = None
    """Those that its detector tells apart."""

    def with_boundary(self, boundary: BaseGeometry) -> MapData:
        """Return the same map with a boundary, and keep what was computed of its cells."""
        other = replace(self, boundary=boundary)
        kept = ("corners", "outline", "class_areas")
        other.__dict__.update({name: self.__dict__[name] for name in kept if name in self.__dict__})
        return other

    @cached_property
    def corners(self) -> CellCorners:
        """The corners of the cells at the time of the map."""
        return CellCorners.of(self.cells.cells, self.grid, self.t_s)

    @cached_property
    def outline(self) -> Polygon | MultiPolygon:
        """Around the cells of the region, in the moving frame."""
        return outline(self.roi_cells, self.grid)

    @cached_property
    def class_areas(self) -> tuple[ClassArea, ...]:
        """The classes of the region, by number; none where the detector knows the region only."""
        table, shares = self.cells, self.cells.shares
        if self.classes is None or shares is None:
            return ()
        cell_m2, which = self.grid.cell_m**2, table.classes
        found = []
        for column, number in enumerate(self.classes.explored):
            name, share = self.classes.names[number], shares[:, column]
            there = which == column
            cells = tuple(Cell(*cell) for cell in table.cells[there].tolist())
            inside_m2, beside_m2 = (float(share[some].sum()) * cell_m2 for some in (there, ~there))
            found.append(
                ClassArea(
                    number,
                    name,
                    cells,
                    outline(cells, self.grid),
                    len(cells) * cell_m2,
                    inside_m2,
                    len(cells) * cell_m2 + beside_m2,
                    self.classes.by_name[name].thickness_um,
                )
            )
        return tuple(found)

    @property
    def roi_cells(self) -> tuple[Cell, ...]:
        """The cells of the region, in the order of `cells`."""
        return tuple(Cell(*cell) for cell in self.cells.cells[self.cells.roi].tolist())


_AROUND: Final = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])


@dataclass(frozen=True, slots=True)
class CellCorners:
    """The corners of cells.

    Attributes:
        lon_deg: Of each corner.
        lat_deg: Of each corner.
        rings: Numbers of each cell's corners, shape (n, 4): south-west, south-east, north-east,
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
        """Compute the corners of cells over ground at a mission time."""
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
        """Return those of some of the cells."""
        return CellCorners(self.lon_deg, self.lat_deg, self.rings[some])

    def written(
        self, start: LatLon, write: Callable[[float, float], str]
    ) -> Iterator[list[list[str]]]:
        """Yield the four corners of each cell as texts, `AT_ONCE` cells at a time.

        `write` makes the text of a longitude, in the turn of the start's, and a latitude.
        """
        for first in range(0, len(self.rings), AT_ONCE):
            rings = self.rings[first : first + AT_ONCE]
            numbers, which = np.unique(rings, return_inverse=True)
            lons = turned(self.lon_deg[numbers], start).tolist()
            texts = list(map(write, lons, self.lat_deg[numbers].tolist()))
            yield [[texts[corner] for corner in ring] for ring in which.reshape(-1, 4).tolist()]


def turned(lon_deg: NDArray[np.float64], start: LatLon) -> NDArray[np.float64]:
    """Return longitudes in the turn of the start's, so that no polygon spans the globe."""
    return lon_deg + 360.0 * np.round((start.lon_deg - lon_deg) / 360.0)


def on_earth(points: NDArray[np.float64], grid: Grid, t_s: float) -> NDArray[np.float64]:
    """Return longitudes and latitudes, shape (n, 2), of points of the moving frame."""
    origin = np.array([grid.origin.east_m, grid.origin.north_m])
    return grid.zone.lon_lat(origin + (points + drift_m(grid, t_s)) * grid.scale)


def placed(
    points: NDArray[np.float64], grid: Grid, t_s: float, start: LatLon, decimals: int
) -> NDArray[np.float64]:
    """Return `on_earth` for a file: longitudes in the turn of the start's, rounded."""
    found = on_earth(points, grid, t_s)
    found[:, 0] = turned(found[:, 0], start)
    return found.round(decimals)


def on_ground(degrees: NDArray[np.float64], grid: Grid) -> NDArray[np.float64]:
    """Return points of the fixed frame, shape (n, 2), of longitudes and latitudes."""
    origin = np.array([grid.origin.east_m, grid.origin.north_m])
    found: NDArray[np.float64] = (grid.zone.utm(degrees) - origin) / grid.scale
    return found


def drift_m(grid: Grid, t_s: float) -> NDArray[np.float64]:
    """Return how far the moving frame is from the fixed one at a time, east and north."""
    return np.array([grid.drift_east_m_s, grid.drift_north_m_s]) * t_s
