"""The map that all votes make, in whatever order they became known.

A member acts on the map as it grows, and takes of late frames only what comes in time
(`missions.mapping.belief`), which depends on when it heard of them. Its results do not: they are
the join of all votes that it knows, so members that know the same have the same map.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from missions.events import Event, FrameSeen, Shared
from missions.flight.lane_passes import still_open
from missions.flight.two_heights import with_plain
from missions.flight.whole_box import open_cells
from missions.mapping.belief import Belief, FrameId
from missions.state import Setting, State
from missions.units import Cell


class Votes:
    """The votes of a journal of a fleet, as they come."""

    def __init__(self, setting: Setting) -> None:
        votes = setting.mission.votes
        self._setting = setting
        self._low = self._high = Belief(votes.frames, votes.positive)

    def take(self, event: Event) -> None:
        """Take in what an event says of cells, if anything."""
        if isinstance(event, FrameSeen):
            said = {vote.cell: vote.positive for vote in event.votes}
            self._add(FrameId(event.vehicle, event.t_s), said, overview=bool(event.overview))
        elif isinstance(event, Shared):
            for frame in event.frames:
                at = FrameId(event.vehicle, frame.t_s)
                self._add(at, dict(frame.votes), overview=frame.overview)

    def _add(self, frame: FrameId, said: dict[Cell, bool], *, overview: bool) -> None:
        if overview:
            self._high = self._high.with_frame(None, frame, said)
        else:
            self._low = self._low.with_frame(None, frame, said)

    def joined(self, state: State) -> State:
        """A state with the map of all votes."""
        none = Belief(self._low.frames, self._low.positive)
        seen = list(self._high.open_ballots)
        low = with_plain(self._low, none, self._high, self._setting.in_box, seen)
        return replace(state, belief=low, overview=self._high)


def joined(setting: Setting, state: State, events: Iterable[Event]) -> State:
    """The state of a member after its journal, with the map that its votes make in any order."""
    votes = Votes(setting)
    for event in events:
        votes.take(event)
    return votes.joined(state)


def concluded(setting: Setting, state: State) -> State:
    """The state of who flies nothing, with what the map says of how far the mission has come.

    Lanes are what is left of them, whoever held them.
    """
    if state.our_numbers:
        return state
    left = () if state.tree is not None else still_open(setting, state, setting.lanes)
    vehicles = {number: replace(v, lanes=()) for number, v in state.vehicles.items()}
    state = replace(state, vehicles=vehicles, unreachable_lanes=left)
    if not setting.sees_box:
        return replace(state, exhausted=state.tree is None and not left)
    open_ = open_cells(setting, state)
    return replace(
        state, exhausted=True, surveyed=not open_, undecided=open_,
        unreachable_lanes=left if open_ else (),
    )  # fmt: skip
