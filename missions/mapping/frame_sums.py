"""Sums over the frames of a cell: frames that leave it unsure, and the share of each class.

A frame leaves a cell unsure if most of it resembles nothing that the detector knows.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.classes import ClassShare
from missions.events import FrameSeen
from missions.fleet_events import Fact, FactsShared
from missions.mapping.evidence import Cells, CellSums
from missions.units import Cell

_STEPS: Final = 1000  # shares have three digits; whole numbers add up alike in any order


class Doubts:
    """Cells that vehicles of a fleet leave unsure, each by what it has reported last.

    >>> doubts, cell = Doubts(), Cell(0, 0)
    >>> for vehicle, t_s, unsure in ((1, 9.0, False), (1, 2.0, True), (2, 4.0, True)):
    ...     doubts.note(vehicle, Fact(t_s, ((cell, unsure),), doubt=True))
    ...     print(cell in doubts)
    False
    False
    True
    """

    def __init__(self) -> None:
        self._last: dict[Cell, dict[int, tuple[float, bool]]] = {}

    def note(self, vehicle: int, fact: Fact) -> None:
        """Note a fact; one without doubts changes nothing."""
        for cell, unsure in fact.votes if fact.doubt else ():
            reports = self._last.setdefault(cell, {})
            new = (fact.t_s, unsure)
            reports[vehicle] = max(new, reports.get(vehicle, new))

    def __bool__(self) -> bool:
        return bool(self._last)

    def __contains__(self, cell: Cell) -> bool:
        return any(unsure for _, unsure in self._last.get(cell, {}).values())

    def cells(self) -> set[Cell]:
        """Return all of them."""
        return {cell for cell in self._last if cell in self}


class FrameSums:
    """Counts by cell of the frames that show it and of those that leave it unsure; sums of shares.

    >>> sums = FrameSums()
    >>> cells = np.array([[0, 0], [0, 1]])
    >>> sums.add(cells, np.array([True, False]), [ClassShare(Cell(0, 1), 3, 0.5)])
    >>> sums.cells().tolist(), sums.which_unsure(np.array([[0, 1], [0, 0]])).tolist()
    ([[0, 0]], [False, True])
    >>> sums.shares(cells, (3, 4)).tolist(), sums.classes(cells, (3, 4)).tolist()
    ([[0.0, 0.0], [0.5, 0.0]], [0, 3])
    """

    def __init__(self, doubts: Doubts | None = None) -> None:
        self._counts = CellSums(2)
        self._doubts = Doubts() if doubts is None else doubts
        self._classes: dict[int, CellSums] = {}

    def note(self, event: FrameSeen | FactsShared) -> None:
        """Count a frame; a frame from search height only raises suspicions and does not count.

        A fact of another member with classes counts as one frame, which knows its cells. Cells that
        a member leaves unsure are unsure.
        """
        if isinstance(event, FactsShared):
            for fact in event.frames:
                self._doubts.note(event.vehicle, fact)
                if fact.classes:
                    cells = np.array([cell for cell, _ in fact.votes], np.int32)
                    self.add(cells, np.zeros(len(cells), np.bool_), fact.classes)
            return
        if event.overview or not event.votes:
            return
        doubtful = frozenset(event.unsure or ())
        cells = np.array([vote.cell for vote in event.votes], np.int32).reshape(-1, 2)
        unsure = np.array([vote.cell in doubtful for vote in event.votes])
        self.add(cells, unsure, event.classes or ())

    def add(
        self,
        cells: NDArray[np.integer],
        unsure: NDArray[np.bool_],
        classes: Iterable[ClassShare] = (),
    ) -> None:
        """Count a frame column by column."""
        self._counts.add(cells, np.column_stack([unsure, np.ones_like(unsure)]))
        by_number: dict[int, list[ClassShare]] = {}
        for one in classes:
            by_number.setdefault(one.number, []).append(one)
        for number, some in by_number.items():
            sums = self._classes.setdefault(number, CellSums(1))
            shares = np.rint([_STEPS * one.share for one in some]).astype(np.int64)
            sums.add(np.array([one.cell for one in some], np.int32), shares[:, None])

    def cells(self) -> Cells:
        """Return the cells that half of their frames, or a member of the fleet, leave unsure.

        They are sorted.
        """
        cells, counts = self._counts.table()
        ours: Cells = cells[_half(counts)]
        if not self._doubts:
            return ours
        reported = np.array(list(self._doubts.cells()), np.int32).reshape(-1, 2)
        found: Cells = np.unique(np.vstack([ours, reported]), axis=0)
        return found

    def beyond(self, region: Collection[Cell]) -> bool:
        """Return whether a cell that is no region is unsure."""
        return any(Cell(*cell) not in region for cell in self.cells().tolist())

    def is_unsure(self, cell: Cell) -> bool:
        """Return whether a cell is unsure."""
        return cell in self._doubts or bool(_half(self._counts.of_cell(cell))[0])

    def which_unsure(self, cells: NDArray[np.integer]) -> NDArray[np.bool_]:
        """Return which of some cells are unsure."""
        ours = _half(self._counts.of_cells(cells))
        if not self._doubts:
            return ours
        reported = [Cell(*cell) in self._doubts for cell in cells.tolist()]
        return ours | np.array(reported, np.bool_)

    def shares(self, cells: NDArray[np.integer], numbers: Sequence[int]) -> NDArray[np.float64]:
        """Return the mean share of each class in cells over their frames, (n, classes), 0 to 1."""
        frames = np.maximum(self._counts.of_cells(cells)[:, 1:], 1)
        none = np.zeros((len(cells), 1), np.int64)
        columns = [
            self._classes[number].of_cells(cells) if number in self._classes else none
            for number in numbers
        ]
        found: NDArray[np.float64] = np.hstack([none[:, :0], *columns]) / (_STEPS * frames)
        return found

    def classes(self, cells: NDArray[np.integer], numbers: Sequence[int]) -> NDArray[np.uint8]:
        """Return the class, of some numbers, with the largest share in each cell; 0 without any."""
        shares = self.shares(cells, numbers)
        best = np.array(numbers, np.uint8)[shares.argmax(axis=1)]
        return np.where(shares.max(axis=1) > 0.0, best, np.uint8(0))


def _half(counts: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return of which rows of counts half of the frames or more are unsure."""
    found: NDArray[np.bool_] = (counts[:, 0] > 0) & (2 * counts[:, 0] >= counts[:, 1])
    return found
