"""The map that all facts make, in any order.

A member acts on the map as it grows, by votes of its own frames and by reports of others. The radio
decides what comes first. Its results do not depend on that. For each cell the earliest decision
counts, of whatever vehicle, so members with the same facts have the same region.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import NamedTuple

from missions.events import Event, FrameSeen, Tracked
from missions.fleet_events import Fact, FactsShared
from missions.mapping.belief import Ballot, Belief, FrameId, Verdicts
from missions.mapping.frame_sums import Doubts
from missions.mapping.overview import with_plain
from missions.mapping.own_cells import OwnCells, as_frames
from missions.units import Cell

Decision = tuple[float, int, bool]
"""Time, vehicle and verdict of a decision."""


class JoinedMap(NamedTuple):
    """The votes that result from all facts."""

    belief: Belief
    """Votes of frames from map height, and of plain cells."""
    overview: Belief
    """Votes of frames from search height."""
    shown: frozenset[Cell]
    """Cells that frames showed as no region, without a decision."""


class Facts:
    """The facts in a journal of a fleet, as they come.

    They are of vehicles whose frames it holds, and of those whose reports it has received.
    """

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

    def add(self, event: Event) -> list[Fact]:
        """Add what an event reports of cells; return the new facts."""
        if not isinstance(event, FactsShared | FrameSeen | Tracked):
            return []
        if isinstance(event, FactsShared):
            facts = list(event.frames)
        else:
            none = OwnCells(self._none, self._none, self._explored)
            own = self._own.setdefault(event.vehicle, none)
            facts = own.add(event) if isinstance(event, FrameSeen) else own.passed(event.t_s)
        for fact in facts:
            self._add(event.vehicle, fact)
        return facts

    def _add(self, vehicle: int, fact: Fact) -> None:
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
        """Return the map of all facts; a cell that no vehicle has decided has our votes."""
        for vehicle, own in sorted(self._own.items()):
            for fact in own.passed(float("1e9")):
                self._add(vehicle, fact)
        high, low = self._belief(overview=True), self._belief(overview=False)
        low = with_plain(low, high, self._box, list(high.open_ballots))
        # our own votes come last: other members do not know them, and their maps must be the same
        low, high = self._with_open(low, overview=False), self._with_open(high, overview=True)
        return JoinedMap(low, high, frozenset(self._shown))

    def _with_open(self, belief: Belief, *, overview: bool) -> Belief:
        """Return a belief with one vehicle's votes on each undecided cell."""
        found: dict[FrameId, dict[Cell, bool]] = {}
        reported: set[Cell] = set()
        for _, own in sorted(self._own.items()):
            known = own.high if overview else own.low
            for cell, ballot in known.open_ballots.items():
                # (of one vehicle only, and only votes that decide nothing: those of several might)
                new = cell not in reported and known.verdict(cell) is None
                if new and not belief.tally(cell, None).total:
                    reported.add(cell)
                    for frame, vote in ballot:
                        found.setdefault(frame, {})[cell] = vote
        return belief.with_frames(None, _by_exposure(found))

    def _belief(self, *, overview: bool) -> Belief:
        """Return the votes that made each decision, as far as known, else the fewest possible."""
        beliefs = {v: own.high if overview else own.low for v, own in sorted(self._own.items())}
        ballots = {vehicle: belief.open_ballots for vehicle, belief in beliefs.items()}
        found: dict[FrameId, dict[Cell, bool]] = {}

        def put(cell: Cell, ballot: Ballot) -> None:
            for frame, vote in ballot:
                found.setdefault(frame, {})[cell] = vote

        for cell, (t_s, vehicle, says) in sorted(self._decided[overview].items()):
            # (a late frame may have changed a verdict that was reported already, which stays)
            if vehicle in beliefs and beliefs[vehicle].verdict(cell) is says:
                put(cell, ballots[vehicle][cell])
                continue
            fact = Fact(t_s, ((cell, says),), overview)
            for seen in as_frames(vehicle, fact, self._none.frames, self._none.positive):
                put(cell, ((FrameId(vehicle, seen.t_s), says),))
        return self._none.with_frames(None, _by_exposure(found))


def _by_exposure(found: Mapping[FrameId, Verdicts]) -> dict[FrameId, Verdicts]:
    return dict(sorted(found.items(), key=lambda item: item[0].exposed))
