"""Sums over the frames that show a cell: how many leave it unsure, how much of each class they saw.

A frame leaves a cell unsure if most of it looks like nothing that the detector knows.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.classes import ClassShare
from missions.events import FrameSeen
from missions.fleet_events import Shared
from missions.mapping.evidence import Cells, CellSums
from missions.units import Cell

_STEPS: Final = 1000  # shares have three digits; whole numbers add up alike in any order


class FrameSums:
    """Counts by cell the frames that show it, and those that leave it unsure; sums of shares.

    >>> sums = FrameSums()
    >>> cells = np.array([[0, 0], [0, 1]])
    >>> sums.add(cells, np.array([True, False]), [ClassShare(Cell(0, 1), 3, 0.5)])
    >>> sums.cells().tolist(), sums.are(np.array([[0, 1], [0, 0]])).tolist()
    ([[0, 0]], [False, True])
    >>> sums.shares(cells, (3, 4)).tolist(), sums.classes(cells, (3, 4)).tolist()
    ([[0.0, 0.0], [0.5, 0.0]], [0, 3])
    """

    def __init__(self) -> None:
        self._counts = CellSums(2)
        self._classes: dict[int, CellSums] = {}

    def note(self, event: FrameSeen | Shared) -> None:
        """Count a frame; one from the height of a search only suspects.

        A fact of another member with classes counts as one frame, which knows its cells.
        """
        if isinstance(event, Shared):
            for fact in event.frames:
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
        """Return the cells that half of their frames or more leave unsure, sorted."""
        cells, counts = self._counts.table()
        return cells[(counts[:, 0] > 0) & (2 * counts[:, 0] >= counts[:, 1])]

    def beyond(self, region: Collection[Cell]) -> bool:
        """Return whether a cell that is no region is unsure."""
        return any(Cell(*cell) not in region for cell in self.cells().tolist())

    def is_unsure(self, cell: Cell) -> bool:
        """Return whether a cell is unsure."""
        unsure, frames = self._counts.of_cell(cell)[0].tolist()
        return bool(unsure > 0 and 2 * unsure >= frames)

    def are(self, cells: NDArray[np.integer]) -> NDArray[np.bool_]:
        """Return which of some cells are unsure."""
        found = {Cell(*cell) for cell in self.cells().tolist()}
        return np.array([Cell(*cell) in found for cell in cells.tolist()], np.bool_)

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
        """Return the class, of some numbers, that frames saw most of in each cell; 0: of none."""
        shares = self.shares(cells, numbers)
        best = np.array(numbers, np.uint8)[shares.argmax(axis=1)]
        return np.where(shares.max(axis=1) > 0.0, best, np.uint8(0))
