"""A window of the grid as arrays: the votes of each cell, and closed or forbidden cells."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from missions.geo.grid import Grid
from missions.planning.search.strip import Strip
from missions.units import Cell, GridPoint

Ints = NDArray[np.int64]
Flags = NDArray[np.uint8]
Bits = NDArray[np.bool_]
Metres = NDArray[np.float64]
Parts = tuple[tuple[int, tuple[GridPoint, ...]], ...]
"""Places of each vehicle from which it is to see the rest."""

PAD_CELLS = 8
"""Cells around the known ones: as far as cells are worth a frame, and a way round them."""

BEHIND = 2
"""Mark of cells behind the vehicle on a lane that it still flies: others map them."""


def places(cells: Collection[Cell]) -> Ints:
    """Return cells as an array of shape (number, 2): east, north.

    >>> places([Cell(3, -1)]).tolist()
    [[3, -1]]
    """
    flat = np.fromiter(chain.from_iterable(cells), np.int64, 2 * len(cells))
    return flat.reshape(-1, 2)


@dataclass(slots=True)
class Chart:
    """Arrays by cell, row by row from the south-west corner; the caller owns them."""

    west: int
    south: int
    columns: int
    rows: int
    cell_m: float
    yes: Ints
    """Votes for ROI that count."""
    no: Ints
    closed: Flags
    """Not 0 where no frame is worth anything: out of reach, given up, or shown by lanes."""
    allowed: Flags
    """0 where no vehicle may be."""
    fenced: bool
    """True if there is any such place."""

    @classmethod
    def around(cls, cells: Iterable[Cell], cell_m: float, pad: int = PAD_CELLS) -> Chart:
        """Return an empty chart that holds cells, with some room around them.

        >>> chart = Chart.around([Cell(0, 0), Cell(3, 1)], cell_m=4.0, pad=1)
        >>> chart.columns, chart.rows, chart.index(Cell(-1, -1)), chart.index(Cell(3, 1))
        (6, 4, 0, 16)
        """
        known = places(list(cells))
        west, south = (int(low) - pad for low in known.min(axis=0))
        east, north = (int(high) + pad + 1 for high in known.max(axis=0))
        columns, rows = east - west, north - south
        size = columns * rows
        return cls(
            west, south, columns, rows, cell_m,
            np.zeros(size, np.int64), np.zeros(size, np.int64),
            np.zeros(size, np.uint8), np.ones(size, np.uint8), fenced=False,
        )  # fmt: skip

    def index(self, cell: Cell) -> int:
        """Return the place of a cell of the window in the arrays."""
        return (cell.north - self.south) * self.columns + cell.east - self.west

    def indices(self, cells: Collection[Cell]) -> Ints:
        """Return the places of cells in the arrays; all must be in the window."""
        east, north = places(cells).T
        found: Ints = (north - self.south) * self.columns + east - self.west
        return found

    def holds(self, cell: Cell) -> bool:
        """Return whether a cell is in the window."""
        east, north = cell.east - self.west, cell.north - self.south
        return 0 <= east < self.columns and 0 <= north < self.rows

    def cell(self, index: int) -> Cell:
        """Return the cell at a place: the inverse of `index`."""
        return Cell(index % self.columns + self.west, index // self.columns + self.south)

    def allow(self, allowed: Flags, reaches: Iterable[tuple[int, int]]) -> None:
        """Forbid all cells that are not allowed, and close cells that are not seen from the
        allowed.

        `allowed` is by row and column. `reaches` are the columns and rows to either side that each
        vehicle sees.
        """
        self.allowed = allowed.ravel()
        self.fenced = not bool(allowed.all())
        if not self.fenced:
            return
        seen = np.zeros_like(allowed)
        for columns, rows in reaches:
            seen |= dilated(np.asarray(allowed), columns, rows)
        self.closed = (1 - seen).astype(np.uint8).ravel()

    def close(self, strip: Strip, reason: int = 1) -> None:
        """Close the cells of a strip, as far as they are in the window."""
        columns, rows = strip.columns, strip.rows
        east, north = (columns, rows) if strip.eastward else (rows, columns)
        self.closed.reshape(self.rows, self.columns)[
            max(north.start - self.south, 0) : max(north.stop - self.south, 0),
            max(east.start - self.west, 0) : max(east.stop - self.west, 0),
        ] = reason

    def open_behind(self) -> bool:
        """Open cells that are closed as `BEHIND`; return whether there are any."""
        behind = self.closed == BEHIND
        self.closed[behind] = 0
        return bool(behind.any())

    def middles_m(self, grid: Grid, t_s: float) -> tuple[Metres, Metres]:
        """Return the middle of each cell over ground at a time: east and north, by row and
        column."""
        east = (np.arange(self.columns) + self.west) * self.cell_m + grid.drift_east_m_s * t_s
        north = (np.arange(self.rows) + self.south) * self.cell_m + grid.drift_north_m_s * t_s
        x, y = np.meshgrid(east, north)
        return x, y

    @property
    def grid(self) -> tuple[int, int, int, int, float]:
        """Window in the form of the kernels."""
        return self.west, self.south, self.columns, self.rows, self.cell_m


@dataclass(frozen=True, slots=True)
class KnownMap:
    """A chart, and the cells of it to be decided: the region around a cell, or given cells."""

    chart: Chart
    root: int
    """Cell where the region was first seen; -1 if cells are given."""
    wanted: Flags | None = None
    """1 for each cell that has to be decided in any case, None without any.

    In a survey those are cells of the box that no lane which is still to be flown shows.
    """
    patches: bool = False
    """True if every patch of the region is explored, wherever it began."""


@lru_cache(maxsize=16)
def nearest_place(mapping: Parts, grid: tuple[int, int, int, int, float], high: float) -> Ints:
    """Return the vehicle with the nearest place, by cell of a window of the grid; 0 for none.

    Distances are measured in pictures, which are `high` times as high as they are wide.
    """
    west, south, columns, rows, cell_m = grid
    who = np.zeros(columns * rows, np.int64)
    least = np.full((rows, columns), np.inf)
    east = (np.arange(columns) + west) * cell_m
    north = (np.arange(rows) + south) * cell_m
    whose = who.reshape(rows, columns)
    for number, places in mapping:
        for place in places:
            away = np.maximum(
                np.abs(east - place.east_m)[None, :], np.abs(north - place.north_m)[:, None] / high
            )
            nearer = away < least
            least[nearer] = away[nearer]
            whose[nearer] = number
    return who


def dilated(flags: Flags, columns: int, rows: int) -> Flags:
    """Return flags, each spread over `columns` and `rows` to either side."""
    out = flags.copy()
    for k in range(1, columns + 1):
        out[:, k:] |= flags[:, :-k]
        out[:, :-k] |= flags[:, k:]
    flags = out.copy()
    for k in range(1, rows + 1):
        out[k:, :] |= flags[:-k, :]
        out[:-k, :] |= flags[k:, :]
    return out
