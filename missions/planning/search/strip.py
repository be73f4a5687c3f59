"""The cells that a lane decides: its rows, column by column, as they lie at a time."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass
from typing import Final

from missions.geo.grid import Grid
from missions.planning.search.lanes import Lane, unseen_parts
from missions.units import Cell

ON_ROW_M: Final = 0.01
"""Tolerance of lanes on rows of cells, or between them, m."""


@dataclass(frozen=True, slots=True)
class Strip:
    """The rows of a lane. A column is the cells of one coordinate along it, one in each row."""

    cell_m: float
    eastward: bool
    """True if the lane lies along east, else along north."""
    start_m: float
    """Position of its beginning, along it, in the frame of the region, m."""
    end_m: float
    line_m: float
    """Position of the lane, across it, m."""
    rows: range

    @classmethod
    def along_lane(cls, grid: Grid, lane: Lane, rows: int, t_s: float) -> Strip:
        """Return the strip of a lane that decides `rows` rows, at a time."""
        cell_m = grid.cell_m
        start, end = (grid.to_moving(place, t_s) for place in lane)
        eastward = abs(end.east_m - start.east_m) >= abs(end.north_m - start.north_m)
        start_m, end_m = (p.east_m if eastward else p.north_m for p in (start, end))
        line_m = start.north_m if eastward else start.east_m
        reach_m = (rows - 1) / 2 * cell_m + ON_ROW_M
        first = math.ceil((line_m - reach_m) / cell_m)
        last = math.floor((line_m + reach_m) / cell_m)
        if last < first:  # one row, and the lane off its middle
            first = last = math.floor(line_m / cell_m + 0.5)
        return cls(cell_m, eastward, start_m, end_m, line_m, range(first, last + 1))

    @property
    def columns(self) -> range:
        """Columns that the lane leads over."""
        low_m, high_m = sorted((self.start_m, self.end_m))
        first = math.floor((low_m + ON_ROW_M) / self.cell_m + 0.5)
        last = math.ceil((high_m - ON_ROW_M) / self.cell_m - 0.5)
        return range(first, max(first, last) + 1)

    @property
    def cells(self) -> Iterator[Cell]:
        """Yield all of its cells."""
        return (self.cell(column, row) for column in self.columns for row in self.rows)

    def cell(self, column: int, row: int) -> Cell:
        """Return the cell of a column in a row."""
        return Cell(column, row) if self.eastward else Cell(row, column)

    def judged_m(
        self, judged: Callable[[Cell], bool], near: Collection[Cell] | None = None
    ) -> list[float]:
        """Return the positions along the lane of columns that are judged in all rows, m.

        Both neighbouring columns have to be judged as well, as far as the lane leads over them. A
        column that is reported as seen counts for a cell before it and a cell behind it
        (`missions.planning.search.lanes`). `near` limits the search to columns beside these cells.
        """
        columns: Iterable[int] = self.columns
        if near is not None:
            along = [cell.east if self.eastward else cell.north for cell in near]
            columns = [c for c in range(min(along) - 1, max(along) + 2) if c in self.columns]
        whole: dict[int, bool] = {}
        for column in {c + k for c in columns for k in (-1, 0, 1)}:
            whole[column] = column not in self.columns or all(
                judged(self.cell(column, row)) for row in self.rows
            )
        return [
            self._along_m(column)
            for column in columns
            if whole[column - 1] and whole[column] and whole[column + 1]
        ]

    def parts_left(self, lane: Lane, judged: Callable[[Cell], bool]) -> tuple[Lane, ...]:
        """Return the parts of its lane with a column that is not judged in all rows."""
        seen_m = self.judged_m(judged)
        return unseen_parts(lane, seen_m, self.cell_m) if seen_m else (lane,)

    def is_known(self, known: Callable[[Cell], bool]) -> bool:
        """Return whether that holds for all its cells; the end is checked first."""
        columns = self.columns if self.end_m < self.start_m else reversed(self.columns)
        return all(known(self.cell(column, row)) for column in columns for row in self.rows)

    def missing_rows(self, judged: Callable[[Cell], bool]) -> list[int]:
        """Return the rows in which a cell is not judged yet."""
        columns, cell = self.columns, self.cell
        return [row for row in self.rows if not all(judged(cell(c, row)) for c in columns)]

    def _along_m(self, column: int) -> float:
        """Return the distance of a column from the start of the lane, 0 to the length, m."""
        ahead_m = column * self.cell_m - self.start_m
        length_m = self.end_m - self.start_m
        along_m = ahead_m if length_m >= 0.0 else -ahead_m
        return round(min(max(along_m, 0.0), abs(length_m)), 2)
