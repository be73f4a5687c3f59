"""The map that all facts make, in whatever order they became known.

A member acts on the map as it grows, by votes of its own frames and by what it hears of others,
and what comes first depends on the radio. Its results do not: of each cell the decision counts that
was made first, whoever made it, so members that know the same facts have the same region.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import NamedTuple

from missions.events import Event, FrameSeen, Tracked
from missions.fleet_events import Fact, Shared
from missions.mapping.belief import Ballot, Belief, FrameId, Verdicts
from missions.mapping.frame_sums import Doubts
from missions.mapping.overview import with_plain
from missions.mapping.own_cells import OwnCells, as_frames
from missions.units import Cell

Decision = tuple[float, int, bool]
"""When, by whom, and what."""


class JoinedMap(NamedTuple):
    """The votes that all facts come to."""

    belief: Belief
    """Of frames from the map's height, and of plain cells."""
    overview: Belief
    """Of frames from the height of a search."""
    shown: frozenset[Cell]
    """What frames have shown, and took for no region without a decision."""


class Facts:
    """The facts in a journal of a fleet, as they come: of vehicles whose frames it holds, and of
    those that it has heard."""

    def __init__(
        self, none_seen: Belief, box: Container[Cell], explored: tuple[int, ...] = ()
    ) -> None:
        self._none = none_seen
        self._explored = explored
        self._box = box
        self._own: dict[int, OwnCells] = {}
        self._decided: dict[bool, dict[Cell, Decision]] = {False: {}, True: {}}
        self._shown: set[Cell] = set()
        self.doubts = Doubts()

    def take(self, event: Event) -> list[Fact]:
        """Take in what an event says of cells; returns the facts that it adds."""
        if not isinstance(event, Shared | FrameSeen | Tracked):
            return []
        if isinstance(event, Shared):
            facts = list(event.frames)
        else:
            none = OwnCells(self._none, self._none, self._explored)
            own = self._own.setdefault(event.vehicle, none)
            facts = own.take(event) if isinstance(event, FrameSeen) else own.passed(event.t_s)
        for fact in facts:
            self._take(event.vehicle, fact)
        return facts

    def _take(self, vehicle: int, fact: Fact) -> None:
        self.doubts.note(vehicle, fact)
        if fact.doubt:
            return
        if fact.seen:
            self._shown.update(cell for cell, _ in fact.votes)
            return
        decided = self._decided[fact.overview]
        for cell, says in fact.votes:
            new = (fact.t_s, vehicle, says)
            decided[cell] = min(new, decided.get(cell, new))

    def joined(self) -> JoinedMap:
        """Return the map of all facts; what no vehicle has decided has our votes on it."""
        for vehicle, own in sorted(self._own.items()):
            for fact in own.passed(float("1e9")):
                self._take(vehicle, fact)
        high, low = self._belief(overview=True), self._belief(overview=False)
        low = with_plain(low, high, self._box, list(high.open_ballots))
        # our own votes come last: others have not heard them, and the map is to be the same
        low, high = self._with_open(low, overview=False), self._with_open(high, overview=True)
        return JoinedMap(low, high, frozenset(self._shown))

    def _with_open(self, belief: Belief, *, overview: bool) -> Belief:
        """A belief with the votes of one vehicle on each cell that nothing has decided."""
        found: dict[FrameId, dict[Cell, bool]] = {}
        told: set[Cell] = set()
        for _, own in sorted(self._own.items()):
            known = own.high if overview else own.low
            for cell, ballot in known.open_ballots.items():
                # (of one vehicle only, and only what decides nothing: votes of several might)
                new = cell not in told and known.verdict(cell) is None
                if new and not belief.tally(cell, None).total:
                    told.add(cell)
                    for frame, vote in ballot:
                        found.setdefault(frame, {})[cell] = vote
        return belief.with_frames(None, _by_exposure(found))

    def _belief(self, *, overview: bool) -> Belief:
        """The votes that made each decision, as far as they are known, else as few as could."""
        beliefs = {v: own.high if overview else own.low for v, own in sorted(self._own.items())}
        ballots = {vehicle: belief.open_ballots for vehicle, belief in beliefs.items()}
        found: dict[FrameId, dict[Cell, bool]] = {}

        def put(cell: Cell, ballot: Ballot) -> None:
            for frame, vote in ballot:
                found.setdefault(frame, {})[cell] = vote

        for cell, (t_s, vehicle, says) in sorted(self._decided[overview].items()):
            # (a frame that came late may have changed what was told already, which stays)
            if vehicle in beliefs and beliefs[vehicle].verdict(cell) is says:
                put(cell, ballots[vehicle][cell])
                continue
            fact = Fact(t_s, ((cell, says),), overview)
            for seen in as_frames(vehicle, fact, self._none.frames, self._none.positive):
                put(cell, ((FrameId(vehicle, seen.t_s), says),))
        return self._none.with_frames(None, _by_exposure(found))


def _by_exposure(found: Mapping[FrameId, Verdicts]) -> dict[FrameId, Verdicts]:
    return dict(sorted(found.items(), key=lambda item: item[0].exposed))
