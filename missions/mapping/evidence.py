"""The weighted evidence of recorded pictures on each cell: the belief of a map by evidence.

In flight, as in the paper, votes count alike and the first few decide. Recorded pictures are all
there before any decision. They differ in aspect, pixels and the visible part of a cell. So each
picture has a weight on each cell (`vision.projection`). The belief in a cell is the weighted mean
of the shares of region in its pictures. It is a mean and no product of odds. A cell of which a
third is region is so in every picture, and ten pictures do not make it less.

A belief begins with the mean of the whole set, at the weight `PRIOR_WEIGHT`: one oblique view moves
it less than three from above. All sums are of whole numbers, so the belief does not depend on the
order of the pictures, not in its last bit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from missions.events import Event, FrameSeen, FrameWeighed, Vote
from missions.units import Cell

PRIOR_WEIGHT: Final = 0.15
"""Weight of the mean of the set; a picture from straight above has about 1."""
MIN_WEIGHT: Final = 0.05
"""Weight of all pictures below which a cell is left undecided: no region."""
_STEPS: Final = 1000  # shares and weights are stored in thousandths
_HALF: Final = 1 << 31
_LOW: Final = (1 << 32) - 1
_FEW: Final = 4096  # minimum number of votes that wait before they are added to the sums

Cells = NDArray[np.int32]
"""Columns and rows of cells, shape (n, 2)."""


class Weighings(NamedTuple):
    """All cells that were seen, sorted, in columns.

    Attributes:
        cells: Shape (n, 2).
        belief: The part of each that is believed to be region, 0 to 1.
        decided: Whether there is weight enough on it.
        positive: Number of pictures that vote for region.
        pictures: Number of pictures that show it.
    """

    cells: Cells
    belief: NDArray[np.float64]
    decided: NDArray[np.bool_]
    positive: NDArray[np.int64]
    pictures: NDArray[np.int64]

    def roi(self, share: float) -> NDArray[np.bool_]:
        """Return which cells are believed to be region in at least `share` (`detector.share`)."""
        return self.decided & (self.belief >= share)


class CellSums:
    """Sums of whole numbers by cell, some tens of bytes a cell, in columns.

    >>> sums = CellSums(2)
    >>> for one in ([[3, 1]], [[4, 1]]):
    ...     sums.add(np.array([[0, -7]]), np.array(one))
    >>> [column.tolist() for column in sums.table()]
    [[[0, -7]], [[7, 2]]]
    """

    def __init__(self, columns: int) -> None:
        self._keys = np.empty(0, np.int64)  # of the cells, sorted
        self._sums = np.empty((0, columns), np.int64)
        self._new: list[tuple[NDArray[np.int64], NDArray[np.int64]]] = []
        self._waiting = 0

    def add(self, cells: NDArray[np.integer], numbers: NDArray[np.integer]) -> None:
        """Add numbers, shape (n, columns), to those of cells, shape (n, 2)."""
        self._new.append((_keys(cells), numbers.astype(np.int64)))
        self._waiting += len(numbers)
        if self._waiting > max(_FEW, len(self._keys)):
            self._settle()

    def _settle(self) -> None:
        """Add waiting votes to the sums; this is rare, since it sorts all cells."""
        if not self._new:
            return
        keys = np.concatenate([self._keys, *(keys for keys, _ in self._new)])
        sums = np.concatenate([self._sums, *(sums for _, sums in self._new)])
        order = np.argsort(keys, kind="stable")
        self._keys, first = np.unique(keys[order], return_index=True)
        if len(first):
            self._sums = np.add.reduceat(sums[order], first, axis=0)
        self._new, self._waiting = [], 0

    def table(self) -> tuple[Cells, NDArray[np.int64]]:
        """Return every cell, sorted, shape (n, 2), and its sums, shape (n, columns)."""
        self._settle()
        cells = np.column_stack([self._keys >> 32, (self._keys & _LOW) - _HALF]).astype(np.int32)
        return cells, self._sums

    def of_cells(self, cells: NDArray[np.integer]) -> NDArray[np.int64]:
        """Return the sums of cells, shape (n, 2), as (n, columns); zeros of an unknown one."""
        self._settle()
        if not len(self._keys):
            return np.zeros((len(cells), self._sums.shape[1]), np.int64)
        keys = _keys(cells)
        at = np.minimum(self._keys.searchsorted(keys), len(self._keys) - 1)
        found: NDArray[np.int64] = self._sums[at] * (self._keys[at] == keys)[:, None]
        return found

    def of_cell(self, cell: Cell) -> NDArray[np.int64]:
        """Return the sums of a cell, shape (1, columns); zeros of an unknown one."""
        return self.of_cells(np.array([cell]))


class Evidence:
    """The evidence so far, some tens of bytes a cell.

    >>> evidence = Evidence()
    >>> above, aslant = Vote(Cell(0, 0), True, 0.9), Vote(Cell(0, 0), False, 0.2)
    >>> evidence.add([above], [0.9])
    >>> evidence.add([aslant], [0.2])
    >>> round(evidence.belief(Cell(0, 0)), 2), evidence.is_roi(Cell(0, 0), 0.5), evidence.cells()
    (0.77, True, {Cell(east=0, north=0): (1, 2)})
    """

    def __init__(self) -> None:
        # in thousandths of thousandths: weight, weight times share; and pictures that vote for
        # region, and all
        self._sums = CellSums(4)

    def add(self, votes: Iterable[Vote], weights: Sequence[float]) -> None:
        """Add the votes of one more picture and their weights, 0 to 1, in the same order."""
        said = list(votes)
        if len(said) != len(weights):
            raise ValueError(f"{len(said)} votes have {len(weights)} weights")
        self.add_columns(
            np.array([vote.cell for vote in said], np.int32).reshape(-1, 2),
            np.array([vote.positive for vote in said], np.bool_),
            np.array([vote.share for vote in said], np.float64),
            np.array(weights, np.float64),
        )

    def add_columns(
        self,
        cells: Cells,
        positive: NDArray[np.bool_],
        shares: NDArray[np.float64],
        weights: NDArray[np.float64],
    ) -> None:
        """Add the votes of one more picture, column by column."""
        weight = np.rint(weights * _STEPS).astype(np.int64)
        region = weight * np.rint(shares * _STEPS).astype(np.int64)
        self._sums.add(cells, np.column_stack([weight, region, positive, np.ones_like(weight)]))

    def weighings(self) -> Weighings:
        """Return the evidence on every cell that was seen."""
        cells, sums = self._sums.table()
        weight, _, positive, pictures = sums.T
        decided = weight >= MIN_WEIGHT * _STEPS
        return Weighings(cells, self._beliefs(sums), decided, positive, pictures)

    def _beliefs(self, sums: NDArray[np.int64]) -> NDArray[np.float64]:
        prior = round(PRIOR_WEIGHT * _STEPS)
        weight, region = self._sums.table()[1][:, :2].sum(axis=0).tolist()
        usual = region / (_STEPS * weight) if weight else 0.0  # mean of the whole set
        found: NDArray[np.float64] = (sums[:, 1] / _STEPS + prior * usual) / (sums[:, 0] + prior)
        return found

    def belief(self, cell: Cell) -> float:
        """Return the part of a cell that is believed to be region, 0 to 1; the mean if unseen."""
        return float(self._beliefs(self._sums.of_cell(cell))[0])

    def weight(self, cell: Cell) -> float:
        """Return the weight of all pictures on a cell, at least 0."""
        return float(self._sums.of_cell(cell)[0, 0]) / _STEPS

    def is_roi(self, cell: Cell, share: float) -> bool:
        """Return whether a cell has weight enough and is region in at least that share."""
        return self.weight(cell) >= MIN_WEIGHT and self.belief(cell) >= share

    def cells(self) -> dict[Cell, tuple[int, int]]:
        """Return every cell that was seen, sorted: pictures that vote for region, and all."""
        found = self.weighings()
        reported = zip(found.positive.tolist(), found.pictures.tolist(), strict=True)
        return dict(zip(_named(found.cells), reported, strict=True))


def _keys(cells: NDArray[np.integer]) -> NDArray[np.int64]:
    """Return a whole number for each cell, in the order of the cells."""
    wide = cells.astype(np.int64)
    return (wide[:, 0] << 32) + (wide[:, 1] + _HALF)


def _named(cells: Cells) -> list[Cell]:
    return [Cell(east, north) for east, north in cells.tolist()]


def evidence_of(events: Iterable[Event]) -> Evidence | None:
    """Return the evidence of a replay's journal; None for a flight or a replay by votes."""
    found, seen = None, None
    for event in events:
        if isinstance(event, FrameSeen):
            seen = event
        elif isinstance(event, FrameWeighed) and seen is not None:
            found = found or Evidence()
            found.add(seen.votes, event.weights)
    return found
