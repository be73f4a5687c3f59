"""The cells of a map in columns: some tens of bytes a cell, where objects take a kilobyte.

A map of thousands of recorded pictures has hundreds of thousands of cells. Who writes them takes
some thousands at a time (`CellTable.parts`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple, Self, get_args, overload

import numpy as np
from numpy.typing import NDArray

from missions.units import Cell

State = Literal[
    "non-roi",
    "unexplored",
    "under exploration",
    "explored",
    "provisional",
    "provisional non-roi",
    "skipped",
]
"""Of a cell. Skipped is one of the region from which the operator had nobody look. Provisional is
what most of its frames say while too few of them make a verdict."""

NOT_ROI: frozenset[State] = frozenset(("non-roi", "provisional", "provisional non-roi"))
"""What a map does not count as region."""

_STATES: Final[tuple[State, ...]] = get_args(State)
_CODES: Final = {state: np.uint8(code) for code, state in enumerate(_STATES)}
_ROI: Final = np.array([state not in NOT_ROI for state in _STATES])
AT_ONCE: Final = 4096
"""So many cells are written at a time."""


class CellRow(NamedTuple):
    """One cell of the map: its state and the frames that voted for it."""

    cell: Cell
    state: State
    positive: int
    votes: int
    belief: float | None = None
    """How much of it is believed to be region, 0 to 1, where recorded pictures are weighed."""

    @property
    def is_roi(self) -> bool:
        """Whether the cell is part of the region, visited or not."""
        return self.state not in NOT_ROI


@dataclass(frozen=True, slots=True, eq=False)
class CellTable(Sequence[CellRow]):
    """Cells, column by column; as a sequence, a row each.

    Attributes:
        cells: Columns and rows, shape (n, 2).
        codes: Of the states, shape (n,); see `states`.
        positive: How many frames say that the cell is region.
        votes: How many frames voted.
        belief: How much of each is believed to be region, 0 to 1; None where nothing is weighed.

    >>> rows = [CellRow(Cell(3, 4), "explored", 2, 3), CellRow(Cell(3, 5), "non-roi", 0, 3)]
    >>> table = CellTable.of(rows)
    >>> table[1].cell, table.cells.tolist(), table.roi.tolist(), list(table) == rows
    (Cell(east=3, north=5), [[3, 4], [3, 5]], [True, False], True)
    """

    cells: NDArray[np.int32]
    codes: NDArray[np.uint8]
    positive: NDArray[np.int32]
    votes: NDArray[np.int32]
    belief: NDArray[np.float64] | None = None

    @classmethod
    def of(cls, rows: Iterable[CellRow]) -> Self:
        """The table of rows; beliefs are those of all, or of none."""
        found = list(rows)
        beliefs = [row.belief for row in found if row.belief is not None]
        return cls(
            np.array([row.cell for row in found], np.int32).reshape(-1, 2),
            np.array([_CODES[row.state] for row in found], np.uint8),
            np.array([row.positive for row in found], np.int32),
            np.array([row.votes for row in found], np.int32),
            np.array(beliefs) if beliefs else None,
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
        """The table of recorded pictures, where a cell is region or not."""
        codes = np.where(roi, _CODES["explored"], _CODES["non-roi"])
        return cls(cells, codes, positive, votes, belief)

    def __len__(self) -> int:
        """How many cells."""
        return len(self.cells)

    @overload
    def __getitem__(self, at: int) -> CellRow: ...
    @overload
    def __getitem__(self, at: slice) -> CellTable: ...
    def __getitem__(self, at: int | slice) -> CellRow | CellTable:
        """A row, or the table of some."""
        if isinstance(at, slice):
            return self.which(at)
        return next(iter(self.which([range(len(self))[at]])))

    def which(self, some: slice | Sequence[int] | NDArray[np.bool_]) -> CellTable:
        """The table of some of the cells."""
        belief = None if self.belief is None else self.belief[some]
        counts = self.positive[some], self.votes[some]
        return CellTable(self.cells[some], self.codes[some], *counts, belief)

    def __iter__(self) -> Iterator[CellRow]:
        """Row by row."""
        for part in self.parts():
            for (east, north), state, positive, votes, belief in part.values():
                yield CellRow(Cell(east, north), state, positive, votes, belief)

    def parts(self) -> Iterator[CellTable]:
        """The table in parts of at most `AT_ONCE` cells."""
        for first in range(0, len(self), AT_ONCE):
            yield self[first : first + AT_ONCE]

    def values(self) -> Iterator[tuple[list[int], State, int, int, float | None]]:
        """The fields of each row: of a part, or they are many at once."""
        beliefs = [None] * len(self) if self.belief is None else self.belief.tolist()
        states = [_STATES[code] for code in self.codes.tolist()]
        columns = self.cells.tolist(), states, self.positive.tolist(), self.votes.tolist()
        return zip(*columns, beliefs, strict=True)

    @property
    def roi(self) -> NDArray[np.bool_]:
        """Which cells are part of the region, visited or not."""
        found: NDArray[np.bool_] = _ROI[self.codes]
        return found

    def are(self, state: State) -> NDArray[np.bool_]:
        """Which cells are in a state."""
        found: NDArray[np.bool_] = self.codes == _CODES[state]
        return found

    def counts(self) -> dict[State, int]:
        """How many cells are in each state that there is."""
        many = np.bincount(self.codes, minlength=len(_STATES)).tolist()
        return {state: count for state, count in zip(_STATES, many, strict=True) if count}


def packed(cells: NDArray[np.int32]) -> NDArray[np.int64]:
    """A whole number for each cell, in the order of the cells.

    >>> packed(np.array([[0, -1], [0, 1], [1, 0]], np.int32)).argsort().tolist()
    [0, 1, 2]
    """
    found: NDArray[np.int64] = (cells[:, 0].astype(np.int64) << 32) + cells[:, 1]
    return found
