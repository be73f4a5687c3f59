"""A member's knowledge of the others: their state, their clocks, and the facts that they lack.

Members count the same seconds, whatever their computers' clocks. Facts are sent in this order:
those of a lost datagram, new ones of ours, those that others lack. A fact is sent again only to a
member that has since reported its holdings without it. Facts of a third member are relayed after a
while without news of it.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from missions.fleet_events import MemberReport
from missions.flight.lane_progress import lanes_held
from missions.flight.state import Setting, State
from missions.flight.vehicle_state import Phase, VehicleState
from missions.orders import FlyPath
from missions.units import GridPoint, PadHeight
from uavmap.base import messages
from uavmap.fleet.codec import AirRequest, Batch, Does, Message, Presence, encode
from uavmap.fleet.knowledge import NOTHING, Holding, Knowledge, runs_of


@dataclass(slots=True)
class Peer:
    """Another member, by its messages; times are those of our clock."""

    received_s: float
    have: dict[int, Holding] = field(default_factory=dict)
    """Its known facts of each member."""
    have_s: float = -math.inf
    """Time of that report, s."""
    lacks_since_s: dict[int, float] = field(default_factory=dict)
    """Time since which it lacks known facts of a member, and got no later one, s."""
    apart: bool = False
    done: bool = False
    reported_all: bool = False
    """True if it has sent its knowledge since it was done."""
    begun: bool = False
    """True if its clock moves no more."""
    ask: AirRequest | None = None
    promised: int = -1
    """Number of our request for air to which it has agreed."""
    pad: PadHeight | None = None
    ahead_s: float = -math.inf
    """Minimum lead of its clock over ours, s: a late message seems less."""

    def clock_moved(self, by_s: float) -> None:
        """Note that our clock was moved by `by_s`."""
        self.received_s += by_s
        self.have_s += by_s
        self.ahead_s -= by_s
        self.lacks_since_s = {o: at_s + by_s for o, at_s in self.lacks_since_s.items()}


PATH_S: Final = 8.0
"""Time between the places of a path that are sent, s."""
PATH_PLACES: Final = 4
"""Number of such places."""


def presence_of(state: State, vehicle: VehicleState) -> Presence:
    """Return a member's report on its vehicle."""
    capacity_wh = state.setting.mission.battery.capacity_wh
    return Presence(
        _does(vehicle),
        vehicle.position,
        vehicle.height_m,
        vehicle.remaining_wh / capacity_wh,
        vehicle.cruise_altitude_m,
        lanes_held(state.setting, vehicle),
        _places_ahead(vehicle, state.t_s),
    )


def member_report(setting: Setting, sender: int, now_s: float, presence: Presence) -> MemberReport:
    """Return another's report on its vehicle, for our service."""
    capacity_wh = setting.mission.battery.capacity_wh
    return MemberReport(
        sender, round(now_s, 3), presence.position, presence.height_m,
        round(presence.charge * capacity_wh, 2), presence.does, setting.pad_of(sender),
        presence.lanes, presence.path, presence.layer_m,
    )  # fmt: skip


def _does(vehicle: VehicleState) -> Does:
    if vehicle.phase in (Phase.DOWN, Phase.LOST):
        return "down"
    if vehicle.phase in (Phase.FINISHED, Phase.FAILED):
        return "ended"
    if vehicle.landed:
        return "stands"
    if vehicle.phase in (Phase.YIELDED, Phase.OFFLINE):
        return "pilot"
    if vehicle.phase is Phase.GUARDED:
        return "guarded"
    return "flies" if vehicle.return_reason is None else "returns"


def _places_ahead(vehicle: VehicleState, t_s: float) -> tuple[GridPoint, ...]:
    order = vehicle.order
    if not isinstance(order, FlyPath):
        return ()
    path = order.trajectory
    times = [t_s + PATH_S * k for k in range(1, PATH_PLACES + 1)]
    return tuple(
        path.place_at(min(at_s, path.end_s)) for at_s in times if at_s - PATH_S < path.end_s
    )


# --- the clock -----------------------------------------------------------------------------------
LISTEN_S: Final = 15.0
"""Time to listen for others before a first take-off, s."""
_STEP_S: Final = 0.5
ELSEWHERE_CELLS: Final = 0.25
"""Offset, by a cell's edge, from which on cells are other ground."""


class FleetClock:
    """The relation of one member's clock to those of the others, which are in `peers`."""

    def __init__(
        self,
        setting: Setting,
        number: int,
        peers: Mapping[int, Peer],
    ) -> None:
        self._setting = setting
        self._number = number
        self._peers = peers
        self._log = messages.bound("uavmap.fleet")
        self._strangers: set[int] = set()
        self.begun = False
        """True if our vehicle has taken off."""
        self.agreed = False
        """True if our clock is that of the fleet."""

    async def agree(self, wait_s: float) -> float:
        """Listen until all on the ground reported their pads' heights, at most `wait_s`.

        Return the change of our clock, s: to that of a member that took off, else of the lowest
        number.
        """
        others = set(range(1, len(self._setting.mission.vehicles) + 1)) - {self._number}
        waited_s = 0.0
        while waited_s < wait_s:
            if others <= {n for n, p in self._peers.items() if p.pad is not None or p.begun}:
                break
            await asyncio.sleep(_STEP_S)
            waited_s += _STEP_S
        flying = {n: p for n, p in self._peers.items() if p.begun}
        if self.begun and not flying:
            return 0.0
        clocks = {n: p.ahead_s for n, p in (flying or self._peers).items()}
        if not flying:
            clocks[self._number] = 0.0
        if len(clocks) > 1:  # a listener follows
            clocks.pop(0, None)
        return round(clocks[min(clocks)], 3) if clocks else 0.0

    def shift(self, by_s: float) -> None:
        """Note that our clock was moved by `by_s`, the result of `agree`."""
        self.agreed = True
        for peer in self._peers.values():
            peer.clock_moved(by_s)

    def note_time(self, peer: Peer, its_s: float, now_s: float, *, begun: bool) -> None:
        """Note another's clock, and whether it moves no more."""
        if begun and not peer.begun:  # its clock may have just been moved
            peer.ahead_s = -math.inf
        peer.ahead_s = max(peer.ahead_s, its_s - now_s)

    def is_elsewhere(self, sender: int) -> bool:
        """Return whether another's cells are not ours: it began apart, and the region drifts."""
        grid, peer = self._setting.grid, self._peers[sender]
        off_m = abs(peer.ahead_s) * grid.drift_speed_m_s
        elsewhere = self.agreed and peer.begun and off_m > ELSEWHERE_CELLS * grid.cell_m
        if elsewhere and sender not in self._strangers:
            self._strangers.add(sender)
            self._log.info(
                f"vehicle {sender} began apart from us, its clock is {peer.ahead_s:+.0f} s off, "
                "and the region drifts: its cells are other ground, and are ignored"
            )
        return elsewhere


# --- facts to send -------------------------------------------------------------------------------
RELAY_S: Final = 8.0
"""Time without news of a third member, after which others relay its facts, s."""
MAX_TRANSIT_S: Final = 1.0
"""Maximum time of a datagram and its acknowledgement, s."""


class FactSender:
    """The sending of one member's facts to the others, which are in `peers`."""

    def __init__(self, number: int, peers: Mapping[int, Peer]) -> None:
        self._number = number
        self._peers = peers
        self._sent_s: dict[int, dict[int, float]] = {}
        """Time of the last send of facts, by member and number, s."""

    def clock_moved(self, by_s: float) -> None:
        """Note that our clock was moved by `by_s`."""
        for sent_s in self._sent_s.values():
            for number in sent_s:
                sent_s[number] += by_s

    def batches(self, knowledge: Knowledge, now_s: float, room: int) -> tuple[Batch, ...]:
        """Return facts to send, in at most `room` bytes: lost ones first, but in half of the room.

        Facts to a member that receives nothing are always lost.
        """
        new = self._new(knowledge, now_s)
        found: list[Batch] = []
        lost = self._lost(knowledge, now_s)
        used = self._put(found, knowledge, lost, now_s, room // 2 if new else room)
        if lost and not used:  # a single one may need more than half
            origin, numbers = next(iter(lost.items()))
            used = self._put(found, knowledge, {origin: numbers[:1]}, now_s, room)
        used += self._put(found, knowledge, {self._number: new}, now_s, room - used)
        self._put(found, knowledge, self._lost(knowledge, now_s), now_s, room - used)
        return tuple(found)

    def _new(self, knowledge: Knowledge, now_s: float) -> list[int]:
        """Return facts of ours that were not sent since this start, and that a member may not
        know."""
        if self._peers and all(peer.apart for peer in self._peers.values()):
            return []  # no member receives it, and the saved bytes are for one that comes back
        sent_s = self._sent_s.setdefault(self._number, {})
        unsent = sorted(
            number for number in knowledge.facts.get(self._number, ()) if number not in sent_s
        )
        held = [
            peer.have.get(self._number, NOTHING)
            for peer in self._peers.values()
            if not peer.apart and peer.have_s > -math.inf
        ]
        known = [number for number in unsent if held and all(h.holds(number) for h in held)]
        sent_s.update(dict.fromkeys(known, now_s))
        return [number for number in unsent if number not in sent_s]

    def _put(
        self,
        found: list[Batch],
        knowledge: Knowledge,
        wanted: Mapping[int, list[int]],
        now_s: float,
        room: int,
    ) -> int:
        """Add as many of the wanted facts as there is room for; return their bytes."""
        used = 0
        for origin, numbers in wanted.items():
            for run in runs_of(numbers):
                batch, size = _fitting(knowledge, origin, run[0], len(run), room - used)
                if batch is None:
                    return used
                found.append(batch)
                used += size
                sent_s = self._sent_s.setdefault(origin, {})
                sent_s.update((batch.first + k, now_s) for k in range(len(batch.facts)))
        return used

    def _lost(self, knowledge: Knowledge, now_s: float) -> dict[int, list[int]]:
        """Return facts that a member lacks although they were sent, by member; ours first."""
        lost: dict[int, set[int]] = {}
        for peer in (p for p in self._peers.values() if not p.apart):
            for origin, numbers in knowledge.missing(peer.have).items():
                ours = origin == self._number
                if not ours and now_s < peer.lacks_since_s.get(origin, now_s) + RELAY_S:
                    continue
                sent_s = self._sent_s.get(origin, {})
                never_s = math.inf if ours else -math.inf
                due_s = peer.have_s - MAX_TRANSIT_S
                lost.setdefault(origin, set()).update(
                    number for number in numbers if sent_s.get(number, never_s) < due_s
                )
        first = sorted(lost, key=lambda origin: (origin != self._number, origin))
        return {origin: sorted(lost[origin]) for origin in first if lost[origin]}


def _fitting(
    knowledge: Knowledge, origin: int, first: int, count: int, room: int
) -> tuple[Batch | None, int]:
    """Return the facts of a member from `first` on, at most `count`, that fit; and their bytes."""
    facts = [knowledge.facts[origin][first + k] for k in range(count)]
    while count > 0:
        batch = Batch(origin, first, tuple(facts[:count]))
        size = len(encode(Message(0.0, batches=(batch,)))) - 4
        if size <= room:
            return batch, size
        count = min(count - 1, count * max(room, 0) // size)
    return None, 0
