"""What recorded pictures say of each cell, weighed: the belief of a map by evidence.

A vote counts alike from wherever it was taken, and the first few of them decide: that is how the
paper maps, in flight. Recorded pictures are all there before anything is decided, and they differ:
one sees a cell from above, another aslant, one with 25 pixels along its edge, another with 10, one
all of it, another half. So each picture has a weight on each cell (`vision.weighing`), and the
belief in a cell is the weighed mean of the shares of region that pictures have seen in it. It is a
mean and no product of odds: a cell of which a third is region is a third region in every picture,
and ten of them do not make it less.

A belief begins with what is usual in the whole set, at the weight `PRIOR_WEIGHT`: one look aslant
moves it less than three from above.

All sums are of whole numbers. So the belief does not depend on the order of the pictures, not in
its last bit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

from missions.events import Event, FrameSeen, Vote, Weighed
from missions.units import Cell

PRIOR_WEIGHT: Final = 0.15
"""Of what is usual in the set, beside a picture from straight above, which has about 1."""
LEAST_WEIGHT: Final = 0.05
"""A cell on which all pictures together weigh less is left undecided: no region."""
_STEPS: Final = 1000  # shares and weights are told in thousandths


@dataclass(slots=True)
class _Sums:
    """Of a cell, in thousandths of thousandths: weight, weight times share; and pictures."""

    weight: int = 0
    region: int = 0
    positive: int = 0
    pictures: int = 0


@dataclass(slots=True)
class Evidence:
    """The evidence so far.

    >>> evidence = Evidence()
    >>> above, aslant = Vote(Cell(0, 0), True, 0.9), Vote(Cell(0, 0), False, 0.2)
    >>> evidence.add([above], [0.9])
    >>> evidence.add([aslant], [0.2])
    >>> round(evidence.belief(Cell(0, 0)), 2), evidence.roi(0.5), evidence.cells()
    (0.77, frozenset({Cell(east=0, north=0)}), {Cell(east=0, north=0): (1, 2)})
    """

    _cells: dict[Cell, _Sums] = field(default_factory=dict)
    _weight: int = 0
    _region: int = 0

    def add(self, votes: Iterable[Vote], weights: Sequence[float]) -> None:
        """The votes of one more picture and their weights, 0 to 1, in the same order."""
        for vote, weight in zip(votes, weights, strict=True):
            w = round(weight * _STEPS)
            region = w * round(vote.share * _STEPS)
            sums = self._cells.setdefault(vote.cell, _Sums())
            sums.weight += w
            sums.region += region
            sums.positive += vote.positive
            sums.pictures += 1
            self._weight += w
            self._region += region

    def belief(self, cell: Cell) -> float:
        """The part of a cell that is believed to be region, 0 to 1; what is usual, if unseen."""
        prior = round(PRIOR_WEIGHT * _STEPS)
        usual = self._region / (_STEPS * self._weight) if self._weight else 0.0
        sums = self._cells.get(cell, _Sums())
        return (sums.region / _STEPS + prior * usual) / (sums.weight + prior)

    def weight(self, cell: Cell) -> float:
        """The weight of all pictures on a cell, at least 0."""
        sums = self._cells.get(cell)
        return 0.0 if sums is None else sums.weight / _STEPS

    def roi(self, share: float) -> frozenset[Cell]:
        """The cells that are believed to be region in at least that share (`detector.share`)."""
        return frozenset(cell for cell in self._cells if self.is_roi(cell, share))

    def is_roi(self, cell: Cell, share: float) -> bool:
        """Whether there is weight enough on a cell, and it is region in at least that share."""
        return self.weight(cell) >= LEAST_WEIGHT and self.belief(cell) >= share

    def cells(self) -> dict[Cell, tuple[int, int]]:
        """Every cell that was seen, sorted: pictures that say region, and all that show it."""
        return {cell: (s.positive, s.pictures) for cell, s in sorted(self._cells.items())}

    @property
    def undecided(self) -> int:
        """How many cells have too little weight to be decided."""
        return len(self.undecided_cells())

    def undecided_cells(self) -> set[Cell]:
        """Those cells."""
        return {cell for cell, s in self._cells.items() if s.weight < LEAST_WEIGHT * _STEPS}


def evidence_of(events: Iterable[Event]) -> Evidence | None:
    """The evidence of a replay's journal; None of a flight's, or a replay's that counts votes."""
    found, seen = None, None
    for event in events:
        if isinstance(event, FrameSeen):
            seen = event
        elif isinstance(event, Weighed) and seen is not None:
            found = found or Evidence()
            found.add(seen.votes, event.weights)
    return found
