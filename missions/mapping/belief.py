"""What the frames say about each cell: a ballot by cell and vantage.

Section 7 of Sung and Tokekar: five frames are taken over a cell, each votes for the cell below
(the *vantage*) and for its four neighbours, and three positive votes from one vantage mark a cell
as ROI.

More frames than that may be taken from a vantage: by a second vehicle, in a search, or because a
neighbour was not in every picture. If every vote counted, three of thirty would do, and noise would
make ROI of anything: with the paper's 27 false detections in 483, 23 % of the cells instead of
0.16 %. So a ballot (the votes on one cell from one vantage) counts its first `frames` votes, in the
order of their exposure. Which these are depends on the times alone and not on what the votes say,
so the chance of a false ROI cell is that of `positive` of `frames`, whatever else is taken.

What is stored are votes by vantage and by frame, and everything follows from them. So a belief is a
join-semilattice: frames may arrive in any order, twice, or in batches from several vehicles, and
the map is the same.

Frames that arrive in the order of their exposure only ever add to `roi`: what comes after a full
ballot is not counted. A frame that comes late, taken before some that a full ballot has counted,
would push out the last of these, and might take a positive back. No rule on votes alone avoids this
and keeps the bound: with five negative votes the cell is not ROI, with five later ones of which
three are positive it is; a rule by which votes only add would let any five of thirty decide. So
whoever acts on the map as it grows, and must not see a cell taken back, adds only what `in_time`
leaves of a frame: then ballots that are full are closed, `roi` only grows, and the bound holds for
every cell that ever was in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from missions.mapping.persistent import PersistentMap, PersistentSet
from missions.units import Cell


class FrameId(NamedTuple):
    """A picture: who took it, and when (mission seconds); nobody takes two at one instant."""

    vehicle: int
    t_s: float

    @property
    def exposed(self) -> tuple[float, int]:
        """What frames are ordered by: the time of exposure; at one instant, the vehicle.

        >>> sorted([FrameId(1, 5.0), FrameId(2, 4.0)], key=lambda frame: frame.exposed)
        [FrameId(vehicle=2, t_s=4.0), FrameId(vehicle=1, t_s=5.0)]
        """
        return self.t_s, self.vehicle


class Tally(NamedTuple):
    """Votes on one cell: how many said yes, of how many."""

    positive: int
    total: int


Verdicts = Mapping[Cell, bool]
"""What one frame says: each cell that it shows, and whether it looks like ROI."""

Ballot = tuple[tuple[FrameId, bool], ...]
"""The votes on a cell from one vantage that count, in the order of exposure."""


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
    looks: PersistentMap[Cell, PersistentMap[FrameId, Verdicts]] = field(
        default_factory=PersistentMap
    )
    roi: PersistentSet[Cell] = field(default_factory=PersistentSet)
    _ballots: PersistentMap[Cell, PersistentMap[Cell, Ballot]] = field(
        default_factory=PersistentMap
    )
    """By vantage and by cell: follows from `looks`, kept because it is asked for at every frame."""

    def with_frame(self, vantage: Cell, frame: FrameId, verdicts: Verdicts) -> Belief:
        """This belief and one frame taken over `vantage`; the same frame twice counts once."""
        return self._with_frames(vantage, {frame: verdicts})

    def in_time(self, vantage: Cell, frame: FrameId, verdicts: Verdicts) -> Verdicts:
        """Of a frame that has just arrived, the verdicts that do not come too late.

        A verdict is too late when its ballot is full and counts a frame that was taken later. Who
        adds only these to a belief never sees a cell leave `roi`.

        >>> belief = Belief(frames=1, positive=1)
        >>> belief = belief.with_frame(Cell(0, 0), FrameId(1, 2.0), {Cell(0, 0): True})
        >>> belief.in_time(Cell(0, 0), FrameId(2, 1.0), {Cell(0, 0): False, Cell(1, 0): True})
        {Cell(east=1, north=0): True}
        """
        kept = {}
        for cell, says_roi in verdicts.items():
            ballot = self._ballot(cell, vantage)
            if len(ballot) < self.frames or frame.exposed >= ballot[-1][0].exposed:
                kept[cell] = says_roi
        return kept

    def join(self, other: Belief) -> Belief:
        """What two vehicles know once they have met: the least upper bound of their votes.

        Where the two have more votes on a cell from one vantage than count, the first of both
        decide, and the cell may be no ROI although one of them took it for ROI.
        """
        joined = self
        for vantage, frames in other.looks.items():
            joined = joined._with_frames(vantage, frames)
        return joined

    def tally(self, cell: Cell, vantage: Cell) -> Tally:
        """The votes on a cell from one vantage that count, at most `frames`."""
        ballot = self._ballot(cell, vantage)
        return Tally(sum(says_roi for _, says_roi in ballot), len(ballot))

    def fully_voted(self, vantage: Cell) -> bool:
        """Whether the cell and its four neighbours have all their votes from this vantage."""
        return all(self.tally(cell, vantage).total >= self.frames for cell in vantage.cross())

    def frames_taken(self, vantage: Cell) -> int:
        """How many frames were taken over a cell."""
        return len(self.looks.get(vantage, {}))

    def detections(self) -> list[tuple[Cell, Cell, bool]]:
        """Every (vantage, cell, verdict) with a full set of votes, in a fixed order."""
        return [
            (vantage, cell, self.tally(cell, vantage).positive >= self.positive)
            for vantage in sorted(self._ballots)
            for cell, ballot in sorted(self._ballots[vantage].items())
            if len(ballot) >= self.frames
        ]

    def cells(self) -> dict[Cell, Tally]:
        """Every cell that any frame has voted on, with all its votes, in a fixed order.

        Votes from all vantages, and those that no ballot counts any more.
        """
        counts: dict[Cell, list[int]] = {}
        for frames in self.looks.values():
            for seen in frames.values():
                for cell, says_roi in seen.items():
                    count = counts.setdefault(cell, [0, 0])
                    count[0] += says_roi
                    count[1] += 1
        return {cell: Tally(*counts[cell]) for cell in sorted(counts)}

    def _with_frames(self, vantage: Cell, frames: Mapping[FrameId, Verdicts]) -> Belief:
        at_vantage: PersistentMap[FrameId, Verdicts] = self.looks.get(vantage, PersistentMap())
        ballots: PersistentMap[Cell, Ballot] = self._ballots.get(vantage, PersistentMap())
        taken: dict[FrameId, Verdicts] = {}
        counted: dict[Cell, Ballot] = {}
        for frame, verdicts in frames.items():
            taken[frame] = seen = _either(at_vantage.get(frame, {}), verdicts)
            for cell in verdicts:
                ballot = counted.get(cell) or self._ballot(cell, vantage)
                counted[cell] = self._counted(ballot, frame, seen[cell])
        elected = {cell for cell, ballot in counted.items() if self._elects(ballot)}
        taken_back = {
            cell
            for cell in counted
            if cell not in elected and self._elects(self._ballot(cell, vantage))
        }
        # here the maps change hands: what they were must have been read before
        looks = self.looks.updated({vantage: at_vantage.updated(taken)})
        all_ballots = self._ballots.updated({vantage: ballots.updated(counted)})
        roi = self.roi.added(elected)
        if taken_back:  # by a frame that came late: another vantage may still say yes
            still = all_ballots.values()
            roi = roi.without(
                {
                    cell
                    for cell in taken_back
                    if not any(self._elects(at.get(cell, ())) for at in still)
                }
            )
        return Belief(self.frames, self.positive, looks, roi, all_ballots)

    def _ballot(self, cell: Cell, vantage: Cell) -> Ballot:
        at_vantage = self._ballots.get(vantage)
        return () if at_vantage is None else at_vantage.get(cell, ())

    def _counted(self, ballot: Ballot, frame: FrameId, says_roi: bool) -> Ballot:
        """A ballot with one more vote: the first `frames` by their time of exposure."""
        others = [vote for vote in ballot if vote[0] != frame]
        votes = sorted([*others, (frame, says_roi)], key=lambda vote: vote[0].exposed)
        return tuple(votes[: self.frames])

    def _elects(self, ballot: Ballot) -> bool:
        return sum(says_roi for _, says_roi in ballot) >= self.positive


def _either(one: Verdicts, other: Verdicts) -> Verdicts:
    """Two reports of one frame: what either says; a positive outweighs a negative."""
    both = {**one, **other}
    return {cell: one.get(cell, False) or other.get(cell, False) for cell in sorted(both)}
