"""A member of a fleet: sends its knowledge and state, and receives those of the others.

About every `BEAT_S` it sends its number, place, reservations, and the number of known facts of each
member. Then it sends facts not sent yet, then those that others lack, within its budget of bytes.
Received messages become events for its service (`FactsShared`, `MemberReport`, `MemberApart`), and
so are in its journal.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Final

from missions.events import (
    Continued,
    Event,
    FrameSeen,
    LiftedOff,
    Paused,
    Recalled,
    Tracked,
    VehicleRecalled,
)
from missions.fleet_events import FactsShared, MemberApart, Part, PartsAllotted
from missions.flight.state import Setting, State
from missions.mapping.belief import Belief
from missions.mapping.own_cells import OwnCells
from missions.units import PadHeight
from uavmap.base import messages
from uavmap.fleet.airspace_leases import AirspaceLeases
from uavmap.fleet.bits import BytesError
from uavmap.fleet.codec import Message, OperatorOrder, Order, Presence, decode, encode
from uavmap.fleet.knowledge import NOTHING, Knowledge
from uavmap.fleet.peer import FactSender, FleetClock, Peer, member_report, presence_of
from uavmap.fleet.radio import Radio
from uavmap.fleet.sealing import CODE_BYTES, Seal

BEAT_S: Final = 2.0
MAX_SILENCE_S: Final = 6.0
"""Maximum silence of a member that saves bytes for its next messages, s."""
KNOWLEDGE_INTERVAL: Final = 2
"""Number of messages from one report of the sender's knowledge to the next."""
APART_S: Final = 12.0
"""Silence after which a member is out of contact, s."""
BYTES_A_MINUTE: Final = 4_500
"""Budget of a member, bytes a minute, headers included: a narrow radio has 5 kB for each."""
BURST_BYTES: Final = 2_000
"""Maximum budget that is saved up, for a member that comes back into contact."""
MAX_BYTES: Final = 900
"""Maximum bytes of facts in a datagram, which stays below every network's maximum."""
HEADER_BYTES: Final = CODE_BYTES + 12
"""Bytes of a seal."""
PARTS_EVERY_S: Final = 6.0
"""Minimum time between two messages with work shares, s."""
SOON_S: Final = 0.5
"""Minimum time between urgent messages, s."""


_OF_ALL: Final[Mapping[Order, type[Recalled | Paused | Continued]]] = {
    "recall": Recalled, "pause": Paused, "continue": Continued,
}  # fmt: skip


def _carried_out(event: Event) -> OperatorOrder | None:
    if isinstance(event, VehicleRecalled) and event.stamp is not None:
        return OperatorOrder(event.stamp, event.vehicle, "recall")
    for order, kind in _OF_ALL.items():
        if isinstance(event, kind) and event.stamp is not None:
            return OperatorOrder(event.stamp, 0, order)
    return None


class Member:
    """The communication of one member with its fleet."""

    def __init__(
        self,
        setting: Setting,
        seal: Seal,
        radio: Radio,
        now_s: Callable[[], float],
        post: Callable[[Event], None],
    ) -> None:
        self._setting = setting
        self._seal = seal
        self._radio = radio
        self._now_s = now_s
        self._post = post
        self._log = messages.bound("uavmap.fleet")
        self._number = seal.member
        none = Belief(setting.mission.votes.frames, setting.mission.votes.positive)
        self._own = OwnCells(none, none, setting.mission.detector.explored)
        """Not those of the state, whose map also counts others' decisions as votes."""
        self.knowledge = Knowledge()
        self.peers: dict[int, Peer] = {}
        self._clock = FleetClock(setting, self._number, self.peers)
        self._airspace = AirspaceLeases(
            setting, self._number, self.peers, now_s, post, hurry=self.beat_soon
        )
        self._sender = FactSender(self._number, self.peers)
        self._budget = float(BURST_BYTES)
        self._budget_s = now_s()
        self._state: State | None = None
        self._orders: dict[int, OperatorOrder] = {}
        self._beaten_s = -math.inf
        self._messages = 0
        self._urgent = False
        self._soon: asyncio.TimerHandle | None = None
        self._failed = False
        self._parts_s = (-math.inf, -math.inf)
        """Time of the last sent work shares, and time when they were sent, s."""
        self._pad: PadHeight | None = None

    def remember(self, events: Iterable[Event]) -> None:
        """Add the events in the journal of an earlier start."""
        for event in events:
            self._note(event)
            if isinstance(event, FactsShared):
                self.knowledge.add(event.vehicle, event.first, event.frames)
            elif (word := _carried_out(event)) is not None:
                self._orders[word.vehicle] = word

    def observe(self, event: Event, state: State) -> None:
        """Note an event that our service has handled."""
        self._state = state
        self._note(event)
        self._airspace.ask_for(state.vehicles[self._number].asks if state.own_vehicles else None)

    def _note(self, event: Event) -> None:
        if isinstance(event, LiftedOff):
            self._clock.begun = True
        if isinstance(event, FrameSeen | Tracked) and event.vehicle == self._number:
            known, own = self.knowledge.upto(self._number), self._own
            new = own.add(event) if isinstance(event, FrameSeen) else own.passed(event.t_s)
            self.knowledge.add(self._number, known, new)

    # --- the clock -----------------------------------------------------------------------------
    async def agree(self, wait_s: float, pad: PadHeight | None) -> float:
        """Listen until all are received, at most `wait_s`; return the change of our clock, s.

        Facts of others on cells count once `clock_moved` was called. `pad` is the report of our
        vehicle's receiver; None for one in the air.
        """
        self._pad = pad
        self.beat_soon()
        return await self._clock.agree(wait_s)

    @property
    def pads(self) -> dict[int, PadHeight]:
        """Return the heights of the pads of the fleet's vehicles, as far as known."""
        known = {self._number: self._pad, **{n: peer.pad for n, peer in self.peers.items()}}
        return {number: pad for number, pad in sorted(known.items()) if pad is not None}

    def clock_moved(self, by_s: float) -> None:
        """Note that our clock was moved by `by_s`, the result of `agree`."""
        self._clock.shift(by_s)
        self._budget_s += by_s
        self._sender.clock_moved(by_s)

    # --- an operator's word --------------------------------------------------------------------
    def command(self, order: Order, vehicle: int = 0) -> None:
        """Send an order of the operator here, newer than all others, by any clock."""
        newest = max((word.stamp for word in self._orders.values()), default=0)
        self.order(OperatorOrder(max(newest + 1, int(time.time())), vehicle, order))

    def order(self, word: OperatorOrder) -> None:
        """Send an operator's order, and carry it out."""
        known = self._orders.get(word.vehicle)
        if known is not None and known.stamp >= word.stamp:
            return
        self._orders[word.vehicle] = word
        t_s = round(self._now_s(), 3)
        if word.vehicle == 0:
            self._post(_OF_ALL[word.order](t_s, stamp=word.stamp))
        elif word.vehicle == self._number and word.order == "recall":
            self._post(VehicleRecalled(self._number, t_s, stamp=word.stamp))

    # --- speaking ------------------------------------------------------------------------------
    async def run(self) -> None:
        """Communicate until cancelled."""
        self._radio.listen(self.receive)
        while True:
            self._beat_safely()
            await asyncio.sleep(BEAT_S)

    def beat_soon(self) -> None:
        """Send before the next beat: another member waits for it."""
        if self._soon is not None:
            return
        loop = asyncio.get_running_loop()
        wait_s = max(self._beaten_s + SOON_S - self._now_s(), 0.05)
        self._soon = loop.call_later(wait_s, self._beat_now)

    def _beat_now(self) -> None:
        self._soon = None
        self._urgent = True
        self._beat_safely()

    def _beat_safely(self) -> None:
        """Send, and log a failure once: aircraft fly without communication."""
        try:
            self.beat()
        except Exception as failure:
            if self._failed:
                return
            self._failed = True
            self._log.info(
                f"internal error in fleet communication ({type(failure).__name__}: {failure}); "
                "vehicles continue independently"
            )

    def beat(self) -> None:
        """Send the present message, and note members out of contact."""
        now_s = self._now_s()
        for number, peer in sorted(self.peers.items()):
            if not peer.apart and now_s - peer.received_s > APART_S:
                peer.apart = True
                self._post(MemberApart(number, round(now_s, 3)))
        self._budget += (now_s - self._budget_s) * BYTES_A_MINUTE / 60.0
        self._budget = min(self._budget, BURST_BYTES)
        self._budget_s = now_s
        for errand in self._seal.errands():
            self._send(errand)
        message = self._message(now_s)
        sealed_bytes = HEADER_BYTES + len(encode(message))
        spare = int(self._budget) - self._radio.overhead_bytes - sealed_bytes
        if spare < 0 and not self._urgent and now_s - self._beaten_s < MAX_SILENCE_S - 1e-6:
            return
        self._beaten_s, self._urgent = now_s, False
        if message.parts and self._state is not None and self._state.allotment is not None:
            self._parts_s = (self._state.allotment.made_s, now_s)
        self._messages += 1
        room = min(spare, MAX_BYTES)
        message = replace(message, batches=self._sender.batches(self.knowledge, now_s, room))
        datagram = self._seal.sealed(encode(message))
        self._send(datagram)
        if len(datagram) > MAX_BYTES / 2 and self._budget > MAX_BYTES / 2:
            self.beat_soon()  # there is more to send, and enough was saved

    def _message(self, now_s: float) -> Message:
        return Message(
            now_s,
            self._presence(),
            self.knowledge.have if self._messages % KNOWLEDGE_INTERVAL == 0 else {},
            words=tuple(self._orders[vehicle] for vehicle in sorted(self._orders)),
            begun=self._clock.begun or self._clock.agreed,
            ask=self._airspace.question,
            promised=self._airspace.promises(self._state),
            parts=self._parts(now_s),
            pad=self._pad,
        )

    def _parts(self, now_s: float) -> tuple[Part, ...]:
        found = None if self._state is None else self._state.allotment
        if found is None or found.by != self._number or found.made_s == self._parts_s[0]:
            return ()
        if now_s < self._parts_s[1] + PARTS_EVERY_S:
            return ()
        return tuple(Part(number, places) for number, places in sorted(found.parts.items()))

    def _send(self, datagram: bytes) -> None:
        self._budget -= len(datagram) + self._radio.overhead_bytes
        self._radio.send(datagram)

    def _presence(self) -> Presence | None:
        state = self._state
        if state is None or self._number not in state.vehicles:
            return None
        return presence_of(state, state.vehicles[self._number])

    # --- hearing -------------------------------------------------------------------------------
    def receive(self, datagram: bytes) -> None:
        """Handle a received datagram."""
        opened = self._seal.opened(datagram)
        if opened is None:
            return
        sender, body = opened
        try:
            message = decode(body)
        except BytesError:
            return
        now_s = self._now_s()
        peer = self.peers.setdefault(sender, Peer(now_s))
        peer.received_s, peer.apart = now_s, False
        self._clock.note_time(peer, message.t_s, now_s, begun=message.begun)
        for word in message.words:
            self.order(word)
        # only the last message has the present state and requests: facts alone may come late
        latest = not self._seal.overtaken
        if latest:
            self._receive_state(sender, peer, message, now_s)
        if not self._clock.agreed or self._clock.is_elsewhere(sender):
            return  # refused facts are sent again
        for batch in message.batches:
            if batch.origin == self._number or not self._is_vehicle(batch.origin):
                continue
            for run in self.knowledge.add(batch.origin, batch.first, batch.facts):
                self._post(FactsShared(batch.origin, round(now_s, 3), run.first, run.facts))
        if latest and message.presence is not None and self._is_vehicle(sender):
            self._post(member_report(self._setting, sender, now_s, message.presence))
            if message.parts:
                self._post(PartsAllotted(sender, round(now_s, 3), message.parts))

    def _receive_state(self, sender: int, peer: Peer, message: Message, now_s: float) -> None:
        before = peer.have
        peer.pad = message.pad or peer.pad
        if message.have:
            peer.have, peer.have_s = message.have, now_s
        if message.presence is not None:
            peer.done = message.presence.does in ("ended", "down")
        else:  # one that flies a vehicle, and has just started, does not know its activity yet
            peer.done = not self._is_vehicle(sender)
        peer.reported_all = peer.done and (peer.reported_all or bool(message.have))
        peer.begun = message.begun
        missing = self.knowledge.missing(peer.have)
        got = {
            origin
            for origin in missing
            if peer.have.get(origin, NOTHING).top > before.get(origin, NOTHING).top
        }
        peer.lacks_since_s = {
            origin: now_s if origin in got else peer.lacks_since_s.get(origin, now_s)
            for origin in missing
        }
        if self._clock.agreed:
            self._airspace.receive_request(sender, message.ask, message.t_s, now_s)
            self._airspace.receive_promise(sender, message.promised.get(self._number, -1))

    def _is_vehicle(self, number: int) -> bool:
        return 0 < number <= len(self._setting.mission.vehicles)

    def end(self) -> None:
        """Send nothing more."""
        if self._soon is not None:
            self._soon.cancel()

    @property
    def all_done(self) -> bool:
        """True if every member that was ever received is done."""
        return all(peer.done for peer in self.peers.values())

    @property
    def level(self) -> bool:
        """True if all in contact know all facts of this member, and none knows more."""
        return all(
            peer.done
            and (peer.reported_all or not self.knowledge.have)
            and not self.knowledge.missing(peer.have)
            and not self.knowledge.lacking(peer.have)
            for peer in self.peers.values()
            if not peer.apart
        )
