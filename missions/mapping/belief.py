"""The votes of frames on each cell: a ballot by cell and vantage, or an open one by cell.

Section 7 of Sung and Tokekar: five frames are taken over a cell. Each votes for the cell below (the
*vantage*) and for its four neighbours. Three positive votes from one vantage mark a cell as ROI. A
vehicle that does not stop takes its frames anywhere. Such a frame has no vantage (None): its votes
on a cell go into the cell's *open* ballot, whatever vehicle took it and from where. Every other
rule is the same for both.

More frames may be taken from a vantage: by a second vehicle, in a search, or because a neighbour
was not in every picture. If every vote counted, three of thirty would be enough, and noise would
make ROI of anything. With the paper's 27 false detections in 483, that is 23 % of the cells instead
of 0.16 %. So a ballot (the votes on one cell from one vantage) counts its first `frames` votes, in
the order of exposure. The choice depends on the times alone and not on the votes. So the chance of
a false ROI cell is that of `positive` of `frames`, whatever else is taken. (That holds for a
ballot: a cell on which two ballots are full has two chances.)

A ballot may be *decided* before it is full. After three positives of five, or three negatives, the
rest of the frames could not change the verdict. A vehicle that stops then has the verdict of the
full ballot, so the chance is not raised. No other rule on when to stop raises it either: a ballot
that is left undecided elects no cell.

Stored are votes by vantage and by frame; all else follows from them. So a belief is a
join-semilattice: frames may arrive in any order, twice, or in batches from several vehicles, and
the map is the same.

Frames that arrive in the order of exposure only ever add to `roi`: votes after a full ballot do not
count. A late frame, taken before some that a full ballot has counted, would push out the last of
these, and might take a positive back. No rule on votes alone avoids this and keeps the bound. With
five negative votes the cell is not ROI; with five later ones of which three are positive it is. A
rule by which votes only add would let any five of thirty decide. A user of a growing map who must
not see a cell taken back adds only what `in_time` leaves of a frame. Then full ballots are closed,
`roi` only grows, and the bound holds for every cell that ever was in it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from missions.mapping.persistent import PersistentMap, PersistentSet
from missions.units import Cell


class FrameId(NamedTuple):
    """A picture: its vehicle and its time, mission seconds; a vehicle takes one at a time."""

    vehicle: int
    t_s: float

    @property
    def exposed(self) -> tuple[float, int]:
        """The order of frames: the time of exposure; at one instant, the vehicle."""
        return self.t_s, self.vehicle


class Tally(NamedTuple):
    """Votes on one cell: positive ones, of all."""

    positive: int
    total: int


Verdicts = Mapping[Cell, bool]
"""The verdicts of one frame: for each cell that it shows, whether it looks like ROI."""

Ballot = tuple[tuple[FrameId, bool], ...]
"""The votes on a cell that count, of one vantage or of none, in the order of exposure."""

Vantage = Cell | None
"""The cell over which a frame was taken; None for a frame that was taken anywhere."""


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
    looks: PersistentMap[Vantage, PersistentMap[FrameId, Verdicts]] = field(
        default_factory=PersistentMap
    )
    roi: PersistentSet[Cell] = field(default_factory=PersistentSet)
    _ballots: PersistentMap[Vantage, PersistentMap[Cell, Ballot]] = field(
        default_factory=PersistentMap
    )
    """Ballots by vantage and cell: derived from `looks`, kept because every frame needs them."""
    open_tallies: PersistentMap[Cell, Tally] = field(
        default_factory=PersistentMap, compare=False, repr=False
    )
    """The votes of every open ballot, in the order of their first votes; derived."""
    _verdicts: PersistentMap[Cell, bool | None] = field(
        default_factory=PersistentMap, compare=False, repr=False
    )
    """The verdict on every cell with a ballot; derived."""

    def with_frame(self, vantage: Vantage, frame: FrameId, verdicts: Verdicts) -> Belief:
        """Return this belief with one frame taken over `vantage`; the same frame twice counts once.

        A frame belongs to one vantage, or to none: added to both, it votes in two ballots.
        """
        return self.with_frames(vantage, {frame: verdicts})

    def in_time(self, vantage: Vantage, frame: FrameId, verdicts: Verdicts) -> Verdicts:
        """Return the verdicts of a new frame that are not too late.

        A verdict is too late when its ballot is full and counts a frame that was taken later. If
        only these are added to a belief, no cell ever leaves `roi`.
        """
        found = self._ballots.get(vantage)
        if found is None:
            return dict(verdicts)
        ballots = found.as_dict()
        kept, exposed, most = {}, frame.exposed, self.frames
        for cell, says_roi in verdicts.items():
            ballot = ballots.get(cell, ())
            if len(ballot) < most or exposed >= ballot[-1][0].exposed:
                kept[cell] = says_roi
        return kept

    def join(self, other: Belief) -> Belief:
        """Return the joint knowledge of two vehicles: the least upper bound of their votes.

        Where the two have more votes on a cell from one vantage than count, the first of both
        decide. Then the cell may be no ROI although it was for one of them.
        """
        joined = self
        for vantage, frames in other.looks.items():
            joined = joined.with_frames(vantage, frames)
        return joined

    def tally(self, cell: Cell, vantage: Vantage) -> Tally:
        """Return the counted votes on a cell from one vantage, or the open ones; at most
        `frames`."""
        return _tally(self._ballot(cell, vantage))

    def verdict(self, cell: Cell) -> bool | None:
        """Return whether a cell is ROI: True, False, or None while it is not decided.

        True for the cells of `roi`. False when the cell's open ballot is decided against it: with
        the frames that it still lacks it could not elect the cell. Ballots by vantage decide for a
        cell and never against it, since another vantage may show more.

        A verdict stays as long as frames come in the order of exposure, or only the rest by
        `in_time` is added. It does not stay if a vantage elects a cell that the open ballot has
        decided against.
        """
        return self._verdicts.get(cell)

    @property
    def verdicts(self) -> Mapping[Cell, bool | None]:
        """The verdict on every cell with a ballot, read at once (`PersistentMap.as_dict`)."""
        return self._verdicts.as_dict()

    def undecided(self, cells: Iterable[Cell]) -> list[Cell]:
        """Return the undecided ones of some cells, in their order."""
        verdicts = self._verdicts.as_dict()
        return [cell for cell in cells if verdicts.get(cell) is None]

    def provisional(self, cell: Cell) -> bool | None:
        """Return the provisional verdict on an undecided cell; None if no open vote was cast on it.

        It is the verdict, if there is one. Else it is True if the open ballot would elect the cell
        with further votes like those so far. For three of five that is the majority, and a tie is a
        no.
        """
        verdict, tally = self.verdict(cell), self.open_tallies.get(cell)
        if verdict is not None or tally is None:
            return verdict
        return tally.positive * self.frames >= self.positive * tally.total

    @property
    def open_ballots(self) -> Mapping[Cell, Ballot]:
        """The open ballot of every cell that has one, in the order of their first votes."""
        return self._ballots.get(None, PersistentMap())

    @property
    def ballots(self) -> Mapping[Vantage, Mapping[Cell, Ballot]]:
        """Every ballot, the open ones under None."""
        return self._ballots

    def first_seen_s(self) -> dict[Cell, float]:
        """Return the time of the first counted frame of each cell."""
        first: dict[Cell, float] = {}
        for ballots in self._ballots.values():
            for cell, ballot in ballots.items():
                t_s = ballot[0][0].t_s
                first[cell] = min(t_s, first.get(cell, t_s))
        return first

    def fully_voted(self, vantage: Cell) -> bool:
        """Return whether the cell and its four neighbours have all votes from this vantage."""
        return all(self.tally(cell, vantage).total >= self.frames for cell in vantage.cross())

    def frames_taken(self, vantage: Vantage) -> int:
        """Return the number of frames taken over a cell; with None, of those taken anywhere."""
        return len(self.looks.get(vantage, {}))

    @property
    def cells_searched(self) -> int:
        """Number of cells below frames, plus cells that frames from anywhere show."""
        over = len(self.looks) - (None in self.looks)
        return over + len(self.open_ballots)

    def detections(self) -> list[tuple[Vantage, Cell, bool]]:
        """Return every (vantage, cell, verdict) of a decided ballot, in a fixed order.

        For a vantage these are ballots with a full set of votes; last come the decided open
        ballots.
        """
        by_vantage: list[tuple[Vantage, Cell, bool]] = [
            (vantage, cell, self._elects(ballot))
            for vantage in sorted(vantage for vantage in self._ballots if vantage is not None)
            for cell, ballot in sorted(self._ballots[vantage].items())
            if len(ballot) >= self.frames
        ]
        for cell, tally in sorted(self.open_tallies.items()):
            if (decided := self._verdict_of(tally)) is not None:
                by_vantage.append((None, cell, decided))
        return by_vantage

    def cells(self) -> dict[Cell, Tally]:
        """Return every cell with any vote, and all its votes, in a fixed order.

        Included are votes from all vantages, and those that no ballot counts any more.
        """
        counts: dict[Cell, list[int]] = {}
        for frames in self.looks.values():
            for seen in frames.values():
                for cell, says_roi in seen.items():
                    count = counts.setdefault(cell, [0, 0])
                    count[0] += says_roi
                    count[1] += 1
        return {cell: Tally(*counts[cell]) for cell in sorted(counts)}

    def with_frames(self, vantage: Vantage, frames: Mapping[FrameId, Verdicts]) -> Belief:
        """Return this belief with frames taken over `vantage`; the same frame twice counts once."""
        if not frames:
            return self
        at_vantage: PersistentMap[FrameId, Verdicts] = self.looks.get(vantage, PersistentMap())
        ballots: PersistentMap[Cell, Ballot] = self._ballots.get(vantage, PersistentMap())
        before = ballots.as_dict()
        taken: dict[FrameId, Verdicts] = {}
        counted: dict[Cell, Ballot] = {}
        for frame, verdicts in frames.items():
            taken[frame] = seen = _either(at_vantage.get(frame, {}), verdicts)
            exposed = frame.exposed
            for cell in verdicts:
                ballot = counted.get(cell) or before.get(cell) or ()
                if not ballot or ballot[-1][0].exposed < exposed:  # as nearly all come
                    if len(ballot) < self.frames:
                        counted[cell] = (*ballot, (frame, seen[cell]))
                else:
                    counted[cell] = self._counted(ballot, frame, seen[cell])
        tallies = {cell: _tally(ballot) for cell, ballot in counted.items()}
        elected = {cell for cell, tally in tallies.items() if tally.positive >= self.positive}
        taken_back = {
            cell for cell in counted if cell not in elected and self._elects(before.get(cell, ()))
        }
        # here the maps pass to the new version: their old content must have been read before
        looks = self.looks.updated({vantage: at_vantage.updated(taken)})
        all_ballots = self._ballots.updated({vantage: ballots.updated(counted)})
        roi = self.roi.added(elected)
        if taken_back:  # by a late frame: another vantage may still elect the cell
            still = all_ballots.values()
            roi = roi.without(
                {
                    cell
                    for cell in taken_back
                    if not any(self._elects(at.get(cell, ())) for at in still)
                }
            )
        open_tallies = self.open_tallies.updated(tallies if vantage is None else {})
        none = Tally(0, 0)
        region, tally_of = roi.as_dict(), open_tallies.as_dict()
        says: dict[Cell, bool | None] = {
            cell: True if cell in region else self._verdict_of(tally_of.get(cell, none))
            for cell in counted
        }
        return Belief(
            self.frames, self.positive, looks, roi, all_ballots,
            open_tallies, self._verdicts.updated(says),
        )  # fmt: skip

    def with_verdicts(self, verdicts: Mapping[Cell, bool]) -> Belief:
        """Return this belief with verdicts that hold against all ballots: for a finished map."""
        region = [cell for cell, is_region in verdicts.items() if is_region]
        roi = self.roi.added(region)
        if none := {cell for cell, is_region in verdicts.items() if not is_region and cell in roi}:
            roi = roi.without(none)
        return replace(self, roi=roi, _verdicts=self._verdicts.updated(dict(verdicts)))

    def _ballot(self, cell: Cell, vantage: Vantage) -> Ballot:
        at_vantage = self._ballots.get(vantage)
        return () if at_vantage is None else at_vantage.get(cell, ())

    def _counted(self, ballot: Ballot, frame: FrameId, says_roi: bool) -> Ballot:
        """Return a ballot with one more vote: the first `frames` by their time of exposure."""
        others = [vote for vote in ballot if vote[0] != frame]
        votes = sorted([*others, (frame, says_roi)], key=lambda vote: vote[0].exposed)
        return tuple(votes[: self.frames])

    def _elects(self, ballot: Ballot) -> bool:
        return _tally(ballot).positive >= self.positive

    def _verdict_of(self, tally: Tally) -> bool | None:
        """Return the verdict of a ballot, whatever votes it lacks; None while these matter."""
        positive, total = tally
        if positive >= self.positive:
            return True
        return False if positive + self.frames - total < self.positive else None


def _tally(ballot: Ballot) -> Tally:
    positive = 0
    for _, says_roi in ballot:
        positive += says_roi
    return Tally(positive, len(ballot))


def _either(one: Verdicts, other: Verdicts) -> Verdicts:
    """Return two reports of one frame as one; a positive outweighs a negative."""
    if not one:
        return {cell: other[cell] for cell in sorted(other)}
    both = {**one, **other}
    return {cell: one.get(cell, False) or other.get(cell, False) for cell in sorted(both)}


def judging_frames(belief: Belief) -> dict[Cell, FrameId]:
    """Return the frame that decided each cell; an undecided cell is absent.

    A cell of the region is decided when the first of its ballots elects it. Another cell is decided
    when its open ballot is decided against it. It is decided as well when a full ballot of an
    observation of it does not elect it. A verdict of a finished map by all frames (`with_verdicts`)
    counts from its latest vote.

    >>> belief, here, beside = Belief(frames=3, positive=2), Cell(0, 0), Cell(0, 1)
    >>> for t_s in (0.0, 1.0, 2.0):
    ...     said = {here: True, beside: t_s > 1.0}
    ...     belief = belief.with_frame(None, FrameId(1, t_s), said)
    >>> {cell: frame.t_s for cell, frame in judging_frames(belief).items()}
    {Cell(east=0, north=1): 1.0, Cell(east=0, north=0): 1.0}
    """
    region: dict[Cell, FrameId] = {}
    others: dict[Cell, FrameId] = {}
    for vantage, ballots in belief.ballots.items():
        for cell, ballot in ballots.items():
            found = _spoken(belief, ballot, is_open=vantage is None)
            if found is not None:
                elected, frame = found
                reported = region if elected else others
                reported[cell] = min(
                    frame, reported.get(cell, frame), key=lambda each: each.exposed
                )
    found_frames = {**others, **region}
    verdicts = belief.verdicts
    late = {
        cell: ballot[-1][0]
        for cell, ballot in belief.ballots.get(None, {}).items()
        if cell not in found_frames and verdicts.get(cell) is not None
    }
    return {**late, **found_frames}


def _spoken(belief: Belief, ballot: Ballot, *, is_open: bool) -> tuple[bool, FrameId] | None:
    """Return the verdict of a ballot and its deciding frame; None while there is none.

    An observation continues until it has all of its frames, so a verdict against counts when full.
    """
    positive = 0
    for count, (frame, vote) in enumerate(ballot, start=1):
        positive += vote
        if positive >= belief.positive:
            return True, frame
        lost = positive + belief.frames - count < belief.positive
        if lost and (is_open or count == belief.frames):
            return False, frame
    return None
