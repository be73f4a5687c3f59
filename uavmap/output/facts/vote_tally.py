"""Votes of recorded pictures, counted in the order of exposure with a fixed cost per cell.

The rule is that of `missions.mapping.belief.Belief`: the first `frames` votes on a cell from one
vantage count, and `positive` of them make it ROI. A belief remembers every frame, because frames of
a flight come late, twice, and from several vehicles. Here none do, so sums are enough: memory grows
with the ground, not with the pictures.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from missions.events import Vote
from missions.mapping.evidence import Evidence
from missions.units import Cell
from uavmap.output.facts.map_model import CellTable

Decided = tuple[CellTable, NDArray[np.int32]]
"""All cells, and the undecided ones of them, shape (n, 2)."""


@dataclass(slots=True)
class Votes:
    """The votes so far.

    >>> votes = Votes(frames=2, positive=2)
    >>> for _ in range(2):
    ...     votes.add(Cell(0, 0), [Vote(Cell(1, 0), True, 0.9)])
    >>> table, undecided = votes.counted()
    >>> list(table.values()), len(undecided)
    ([([1, 0], 'explored', 2, 2, None)], 0)
    """

    frames: int
    positive: int
    roi: set[Cell] = field(default_factory=set)
    _ballots: dict[tuple[Cell, Cell], tuple[int, int]] = field(default_factory=dict)
    _cells: dict[Cell, tuple[int, int]] = field(default_factory=dict)
    """Votes, and those of them that say yes."""

    def add(self, vantage: Cell, votes: Iterable[Vote]) -> None:
        """Count the votes of the next picture."""
        for vote in votes:
            votes_in_all, yes = self._cells.get(vote.cell, (0, 0))
            self._cells[vote.cell] = votes_in_all + 1, yes + vote.positive
            cast, yes = self._ballots.get((vantage, vote.cell), (0, 0))
            if cast < self.frames:
                self._ballots[vantage, vote.cell] = cast + 1, yes + vote.positive
                if yes + vote.positive >= self.positive:
                    self.roi.add(vote.cell)

    def counted(self) -> Decided:
        """Return every cell with votes, sorted; and those with too few votes to be ROI."""
        found = sorted(self._cells.items())
        cells = np.array([cell for cell, _ in found], np.int32).reshape(-1, 2)
        roi = np.array([cell in self.roi for cell, _ in found], np.bool_)
        votes, positive = np.array([n for _, n in found], np.int32).reshape(-1, 2).T
        return CellTable.judged(cells, roi, positive, votes, None), cells[votes < self.positive]


def weighed(evidence: Evidence, share: float) -> Decided:
    """Return every seen cell, sorted, and the undecided; region is believed in at least `share`."""
    found = evidence.weighings()
    positive, pictures = (count.astype(np.int32) for count in (found.positive, found.pictures))
    table = CellTable.judged(found.cells, found.roi(share), positive, pictures, found.belief)
    return table, found.cells[~found.decided]
