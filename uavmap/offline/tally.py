"""Votes of pictures that come in the order of their exposure, at the cost of a cell each.

The rule is `missions.mapping.belief.Belief`'s: the first `frames` votes on a cell from one vantage
count, and `positive` of them make it ROI. A belief remembers every frame, because frames of a
flight come late, twice, and from several vehicles. Here none do, so that sums are enough: what is
kept grows with the ground, and not with the pictures.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from missions.events import Vote
from missions.units import Cell


@dataclass(slots=True)
class _Count:
    """Of a ballot, or of a cell: how many votes, and how many of them yes."""

    votes: int = 0
    positive: int = 0


@dataclass(slots=True)
class Votes:
    """The votes so far.

    >>> votes = Votes(frames=2, positive=2)
    >>> for _ in range(2):
    ...     votes.add(Cell(0, 0), [Vote(Cell(1, 0), True, 0.9)])
    >>> sorted(votes.roi), votes.cells()[Cell(1, 0)]
    ([Cell(east=1, north=0)], (2, 2))
    """

    frames: int
    positive: int
    roi: set[Cell] = field(default_factory=set)
    _ballots: dict[tuple[Cell, Cell], _Count] = field(default_factory=dict)
    _cells: dict[Cell, _Count] = field(default_factory=dict)

    def add(self, vantage: Cell, votes: Iterable[Vote]) -> None:
        """The votes of the next picture."""
        for vote in votes:
            everything = self._cells.setdefault(vote.cell, _Count())
            everything.votes += 1
            everything.positive += vote.positive
            ballot = self._ballots.setdefault((vantage, vote.cell), _Count())
            if ballot.votes >= self.frames:
                continue
            ballot.votes += 1
            ballot.positive += vote.positive
            if ballot.positive >= self.positive:
                self.roi.add(vote.cell)

    def cells(self) -> dict[Cell, tuple[int, int]]:
        """Every cell that was voted on, sorted: votes that said yes, and all of them."""
        return {cell: (c.positive, c.votes) for cell, c in sorted(self._cells.items())}

    @property
    def undecided(self) -> int:
        """Cells with too few votes to be ROI, whatever all of them say."""
        return len(self.undecided_cells())

    def undecided_cells(self) -> set[Cell]:
        """Those cells."""
        return {cell for cell, count in self._cells.items() if count.votes < self.positive}
