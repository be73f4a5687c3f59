"""The model of a map for all its writers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal, NamedTuple, Self, get_args

import numpy as np
from numpy.typing import NDArray
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from missions.classes import Classes
from missions.geo.grid import Grid
from missions.mapping.frame_sums import FrameSums
from missions.units import Cell, LatLon
from uavmap.output.facts.cell_outlines import outline
from uavmap.output.facts.class_areas import ClassArea, class_areas

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
"""States of cells, as the glossary defines them."""

NOT_ROI: frozenset[State] = frozenset(("non-roi", "provisional", "provisional non-roi", "unsure"))
"""The states that are not region."""

_STATES: Final[tuple[State, ...]] = get_args(State)
_CODES: Final = {state: np.uint8(code) for code, state in enumerate(_STATES)}
_ROI: Final = np.array([state not in NOT_ROI for state in _STATES])
AT_ONCE: Final = 4096
"""Number of cells that a writer processes at a time."""


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
        codes: Numbers of the states, shape (n,).
        positive: Number of frames whose verdict is region.
        votes: Number of frames that voted.
        belief: Believed share of region, 0 to 1; None without weighed evidence.
        shares: Mean share of each class of the region, (n, classes); None without classes.

    >>> rows = [CellRow(Cell(3, 4), "explored", 2, 3), CellRow(Cell(3, 5), "non-roi", 0, 3)]
    >>> table = CellTable.from_rows(rows)
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
    def from_rows(cls, rows: Iterable[CellRow]) -> Self:
        """Create the table of a flight, without weighed evidence."""
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
        """Create the table of recorded pictures: each cell is region or not."""
        codes = np.where(roi, _CODES["explored"], _CODES["non-roi"])
        return cls(cells, codes, positive, votes, belief)

    def __len__(self) -> int:
        return len(self.cells)

    def with_sums(self, sums: FrameSums, numbers: Sequence[int]) -> CellTable:
        """Return the table with unsure cells among those not region, and with shares of classes."""
        codes = np.where(sums.which_unsure(self.cells) & ~self.roi, _CODES["unsure"], self.codes)
        shares = sums.shares(self.cells, numbers) if numbers else None
        return replace(self, codes=codes, shares=shares)

    def subset(self, some: slice | Sequence[int] | NDArray[np.bool_]) -> CellTable:
        """Return the table of some of the cells."""
        belief, shares = (
            None if column is None else column[some] for column in (self.belief, self.shares)
        )
        counts = self.positive[some], self.votes[some]
        return CellTable(self.cells[some], self.codes[some], *counts, belief, shares)

    def parts(self) -> Iterator[CellTable]:
        """Yield the table in parts of at most `AT_ONCE` cells."""
        for first in range(0, len(self), AT_ONCE):
            yield self.subset(slice(first, first + AT_ONCE))

    def values(self) -> Iterator[tuple[list[int], State, int, int, float | None]]:
        """Yield the fields of each row."""
        beliefs = [None] * len(self) if self.belief is None else self.belief.tolist()
        states = [_STATES[code] for code in self.codes.tolist()]
        columns = self.cells.tolist(), states, self.positive.tolist(), self.votes.tolist()
        return zip(*columns, beliefs, strict=True)

    @property
    def roi(self) -> NDArray[np.bool_]:
        """True for each cell of the region, shape (n,)."""
        found: NDArray[np.bool_] = _ROI[self.codes]
        return found

    @property
    def classes(self) -> NDArray[np.intp]:
        """Column of the class with the largest share in each cell of the region; else -1."""
        if self.shares is None:
            return np.full(len(self), -1)
        known = self.roi & (self.shares.max(axis=1) > 0.0)
        return np.where(known, self.shares.argmax(axis=1), -1)

    def in_state(self, state: State) -> NDArray[np.bool_]:
        """Return true for each cell in a state, shape (n,)."""
        found: NDArray[np.bool_] = self.codes == _CODES[state]
        return found

    def counts(self) -> dict[State, int]:
        """Return the number of cells in each state that occurs."""
        many = np.bincount(self.codes, minlength=len(_STATES)).tolist()
        return {state: count for state, count in zip(_STATES, many, strict=True) if count}


@dataclass(frozen=True, slots=True)
class Track:
    """The track of a vehicle: (mission seconds, position over ground, metres above home)."""

    vehicle: int
    points: tuple[tuple[float, LatLon, float], ...]


@dataclass(frozen=True)
class MapData:
    """A map at the mission time `t_s`.

    `truth` is the true region in ground metres of the grid's moving frame; None outside of
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
    """Number of pictures in the map of a replay; None for a flight."""
    boundary: BaseGeometry | None = None
    """The region's boundary at pixel level, in the moving frame, if pictures show it."""
    classes: Classes | None = None
    """The classes that its detector distinguishes."""

    def with_boundary(self, boundary: BaseGeometry) -> MapData:
        """Return the map with a boundary; results that were computed for its cells are kept."""
        other = replace(self, boundary=boundary)
        kept = ("corners", "outline", "class_areas")
        other.__dict__.update({name: self.__dict__[name] for name in kept if name in self.__dict__})
        return other

    @cached_property
    def corners(self) -> CellCorners:
        """The corners of the cells at the time of the map."""
        return CellCorners.of_cells(self.cells.cells, self.grid, self.t_s)

    @cached_property
    def outline(self) -> Polygon | MultiPolygon:
        """Outline of the cells of the region, in the moving frame."""
        return outline(self.roi_cells, self.grid)

    @cached_property
    def class_areas(self) -> tuple[ClassArea, ...]:
        """The classes of the region, by number; empty if the detector has no classes."""
        shares = self.cells.shares
        if self.classes is None or shares is None:
            return ()
        return class_areas(self.classes, self.grid, self.cells.cells, shares, self.cells.classes)

    @property
    def roi_cells(self) -> tuple[Cell, ...]:
        """The cells of the region, in the order of `cells`."""
        return tuple(Cell(*cell) for cell in self.cells.cells[self.cells.roi].tolist())


_AROUND: Final = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])


@dataclass(frozen=True, slots=True)
class CellCorners:
    """The corners of cells.

    Attributes:
        lon_deg: Longitude of each corner.
        lat_deg: Latitude of each corner.
        rings: Numbers of each cell's corners, shape (n, 4): south-west, south-east, north-east,
            north-west.

    >>> from missions.units import LatLon
    >>> grid = Grid.at(LatLon(48.0, 11.0), cell_m=4.0)
    >>> found = CellCorners.of_cells(np.array([[0, 0], [1, 0]], np.int32), grid, t_s=0.0)
    >>> len(found.lon_deg), found.rings.tolist()
    (6, [[0, 2, 3, 1], [2, 4, 5, 3]])
    """

    lon_deg: NDArray[np.float64]
    lat_deg: NDArray[np.float64]
    rings: NDArray[np.int32]

    @classmethod
    def of_cells(cls, cells: NDArray[np.int32], grid: Grid, t_s: float) -> CellCorners:
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

    def subset(self, some: NDArray[np.bool_]) -> CellCorners:
        """Return the corners of some of the cells."""
        return CellCorners(self.lon_deg, self.lat_deg, self.rings[some])

    def written(
        self, start: LatLon, write: Callable[[float, float], str]
    ) -> Iterator[list[list[str]]]:
        """Yield the four corners of each cell as texts, `AT_ONCE` cells at a time.

        `write` makes the text of a longitude, within 180 degrees of the start's, and a latitude.
        """
        for first in range(0, len(self.rings), AT_ONCE):
            rings = self.rings[first : first + AT_ONCE]
            numbers, which = np.unique(rings, return_inverse=True)
            lons = turned(self.lon_deg[numbers], start).tolist()
            texts = list(map(write, lons, self.lat_deg[numbers].tolist()))
            yield [[texts[corner] for corner in ring] for ring in which.reshape(-1, 4).tolist()]


def turned(lon_deg: NDArray[np.float64], start: LatLon) -> NDArray[np.float64]:
    """Return longitudes within 180 degrees of the start's, so that no polygon spans the globe."""
    return lon_deg + 360.0 * np.round((start.lon_deg - lon_deg) / 360.0)


def on_earth(points: NDArray[np.float64], grid: Grid, t_s: float) -> NDArray[np.float64]:
    """Return longitudes and latitudes, shape (n, 2), of points of the moving frame."""
    origin = np.array([grid.origin.east_m, grid.origin.north_m])
    return grid.zone.lon_lat(origin + (points + drift_m(grid, t_s)) * grid.scale)


def placed(
    points: NDArray[np.float64], grid: Grid, t_s: float, start: LatLon, decimals: int
) -> NDArray[np.float64]:
    """Return `on_earth` for a file: rounded, longitudes within 180 degrees of the start's."""
    found = on_earth(points, grid, t_s)
    found[:, 0] = turned(found[:, 0], start)
    return found.round(decimals)


def on_ground(degrees: NDArray[np.float64], grid: Grid) -> NDArray[np.float64]:
    """Return points of the fixed frame, shape (n, 2), of longitudes and latitudes."""
    origin = np.array([grid.origin.east_m, grid.origin.north_m])
    found: NDArray[np.float64] = (grid.zone.utm(degrees) - origin) / grid.scale
    return found


def drift_m(grid: Grid, t_s: float) -> NDArray[np.float64]:
    """Return the shift of the moving frame from the fixed one at a time, east and north, m."""
    return np.array([grid.drift_east_m_s, grid.drift_north_m_s]) * t_s
