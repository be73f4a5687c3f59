"""What the frames say about each cell: votes that only add up.

Section 7 of Sung and Tokekar: five frames are taken over a cell, each votes for the cell below
(the *vantage*) and for its four neighbours, and three positive votes from one vantage mark a cell
as ROI. A positive is never taken back, a negative can turn.

Votes are kept by vantage and by frame, so a belief is a join-semilattice: frames may arrive in
any order, twice, or in batches from several vehicles, and the map is the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from missions.units import Cell


class FrameId(NamedTuple):
    """A picture: who took it, and when (mission seconds); nobody takes two at one instant."""

    vehicle: int
    t_s: float


class Tally(NamedTuple):
    """Votes on one cell: how many said yes, of how many."""

    positive: int
    total: int


Verdicts = Mapping[Cell, bool]
"""What one frame says: each cell that it shows, and whether it looks like ROI."""


@dataclass(frozen=True, slots=True)
class Belief:
    """Votes so far, and the cells that they make ROI.

    >>> belief = Belief(frames=2, positive=1)
    >>> belief = belief.with_frame(Cell(0, 0), FrameId(1, 0.5), {Cell(0, 1): True})
    >>> Cell(0, 1) in belief.roi, Cell(0, 0) in belief.roi
    (True, False)
    """

    frames: int
    positive: int
    looks: Mapping[Cell, Mapping[FrameId, Verdicts]] = field(default_factory=dict)
    roi: frozenset[Cell] = frozenset()

    def with_frame(self, vantage: Cell, frame: FrameId, verdicts: Verdicts) -> Belief:
        """This belief and one frame taken over `vantage`; the same frame twice counts once."""
        at_vantage = dict(self.looks.get(vantage, {}))
        at_vantage[frame] = _either(at_vantage.get(frame, {}), verdicts)
        looks = {**self.looks, vantage: at_vantage}
        return Belief(
            self.frames, self.positive, looks, self.roi | self._positives(at_vantage, verdicts)
        )

    def join(self, other: Belief) -> Belief:
        """What two vehicles know once they have met: the least upper bound of both."""
        looks = dict(self.looks)
        roi = self.roi | other.roi
        for vantage, frames in other.looks.items():
            mine = dict(looks.get(vantage, {}))
            for frame, verdicts in frames.items():
                mine[frame] = _either(mine.get(frame, {}), verdicts)
            looks[vantage] = mine
            roi |= self._positives(mine, {cell for seen in mine.values() for cell in seen})
        return Belief(self.frames, self.positive, looks, roi)

    def tally(self, cell: Cell, vantage: Cell) -> Tally:
        """The votes on a cell from one vantage."""
        votes = [seen[cell] for seen in self.looks.get(vantage, {}).values() if cell in seen]
        return Tally(sum(votes), len(votes))

    def fully_voted(self, vantage: Cell) -> bool:
        """Whether the cell and its four neighbours have all their votes from this vantage."""
        return all(self.tally(cell, vantage).total >= self.frames for cell in vantage.cross())

    def frames_taken(self, vantage: Cell) -> int:
        """How many frames were taken over a cell."""
        return len(self.looks.get(vantage, {}))

    def detections(self) -> list[tuple[Cell, Cell, bool]]:
        """Every (vantage, cell, verdict) with a full set of votes, in a fixed order."""
        found = []
        for vantage in sorted(self.looks):
            for cell in sorted({c for seen in self.looks[vantage].values() for c in seen}):
                tally = self.tally(cell, vantage)
                if tally.total >= self.frames:
                    found.append((vantage, cell, tally.positive >= self.positive))
        return found

    def cells(self) -> dict[Cell, Tally]:
        """Every cell that any frame has voted on, with all its votes, in a fixed order."""
        counts: dict[Cell, list[int]] = {}
        for frames in self.looks.values():
            for seen in frames.values():
                for cell, says_roi in seen.items():
                    count = counts.setdefault(cell, [0, 0])
                    count[0] += says_roi
                    count[1] += 1
        return {cell: Tally(*counts[cell]) for cell in sorted(counts)}

    def _positives(
        self, at_vantage: Mapping[FrameId, Verdicts], cells: Iterable[Cell]
    ) -> frozenset[Cell]:
        """Of `cells`, those with enough positive votes from one vantage."""
        return frozenset(
            cell
            for cell in cells
            if sum(seen.get(cell, False) for seen in at_vantage.values()) >= self.positive
        )


def _either(one: Verdicts, other: Verdicts) -> Verdicts:
    """Two reports of one frame: what either says; a positive outweighs a negative."""
    both = {**one, **other}
    return {cell: one.get(cell, False) or other.get(cell, False) for cell in sorted(both)}
