"""Cells of which the detector is not sure: most frames show ground like nothing that it knows."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from missions.events import FrameSeen
from missions.mapping.evidence import Cells, CellSums
from missions.units import Cell


class Unsure:
    """Counts by cell the frames that show it, and those that leave it unsure.

    >>> unsure = Unsure()
    >>> unsure.add(np.array([[0, 0], [0, 1]]), np.array([True, False]))
    >>> unsure.cells().tolist(), unsure.are(np.array([[0, 1], [0, 0]])).tolist()
    ([[0, 0]], [False, True])
    """

    def __init__(self) -> None:
        self._counts = CellSums(2)

    def note(self, event: FrameSeen) -> None:
        """Count a frame; one from the height of a search only suspects."""
        if event.overview or not event.votes:
            return
        doubtful = frozenset(event.unsure or ())
        cells = np.array([vote.cell for vote in event.votes], np.int32).reshape(-1, 2)
        self.add(cells, np.array([vote.cell in doubtful for vote in event.votes]))

    def add(self, cells: NDArray[np.integer], unsure: NDArray[np.bool_]) -> None:
        """Count a frame column by column."""
        self._counts.add(cells, np.column_stack([unsure, np.ones_like(unsure)]))

    def cells(self) -> Cells:
        """Return the cells that half of their frames or more leave unsure, sorted."""
        cells, counts = self._counts.table()
        return cells[(counts[:, 0] > 0) & (2 * counts[:, 0] >= counts[:, 1])]

    def beyond(self, region: Collection[Cell]) -> bool:
        """Return whether a cell that is no region is one of them."""
        return any(Cell(*cell) not in region for cell in self.cells().tolist())

    def is_unsure(self, cell: Cell) -> bool:
        """Return whether a cell is one of them."""
        unsure, frames = self._counts.of_cell(cell)[0].tolist()
        return bool(unsure > 0 and 2 * unsure >= frames)

    def are(self, cells: NDArray[np.integer]) -> NDArray[np.bool_]:
        """Return which of some cells are."""
        found = {Cell(*cell) for cell in self.cells().tolist()}
        return np.array([Cell(*cell) in found for cell in cells.tolist()], np.bool_)
