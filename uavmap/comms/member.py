"""A member of a fleet: tells the others what it knows and does, and takes in what they tell.

Every `BEAT_S` or so it says who it is and where, what it holds, and how many facts of each member
it knows; then facts that were not told yet, then those that somebody lacks, as many as the budget
of bytes allows. What it hears becomes events for its service: `Shared`, `Heard`, `Apart`. So a
member is as a vehicle to the service, and the journal holds what others have seen, with its origin.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import AsyncIterator, Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Final

from missions.events import (
    Apart,
    Asked,
    Continued,
    Event,
    FrameSeen,
    Heard,
    Leased,
    LiftedOff,
    Paused,
    Recalled,
    Shared,
    Tracked,
    VehicleRecalled,
)
from missions.fleet.bits import BytesError
from missions.fleet.codec import Ask, Batch, Does, Message, Presence, Word, decode, encode
from missions.fleet.knowledge import Knowledge
from missions.flight.deconfliction import meets
from missions.flight.joined import Facts
from missions.flight.lane_numbers import lanes_held
from missions.flight.members import may_close
from missions.orders import FlyPath
from missions.state import Column, Phase, Setting, State, VehicleState
from missions.units import GridPoint
from uavmap.comms.radio import Radio
from uavmap.comms.sealing import CODE_BYTES, Seal

BEAT_S: Final = 2.0
QUIET_S: Final = 6.0
"""So long a member is silent at most while it saves bytes for what it has to tell."""
HAVE_EVERY: Final = 2
"""Every so many messages tell what the sender knows."""
APART_S: Final = 12.0
"""Who was not heard for so long is out of contact."""
BYTES_A_MINUTE: Final = 4_500
"""What a member may send, headers included: 5 kB is what a narrow radio has for each."""
BURST_BYTES: Final = 900
"""So much may be saved up; a datagram stays below what any network carries whole."""
HEADER_BYTES: Final = CODE_BYTES + 12
"""Of a seal."""
PATH_S: Final = 8.0
"""The places of a path that are told lie so far apart..."""
PATH_PLACES: Final = 4
"""... and are so many."""
LINGER_S: Final = 600.0
"""So long after its landing a member waits for others that still fly."""
LINGER_APART_S: Final = 120.0
"""... and so long for those of them that are out of contact."""
AGREE_S: Final = 15.0
"""For so long others are listened for before a first take-off."""
AGREE_STEP_S: Final = 0.5
ELSEWHERE_CELLS: Final = 0.25
"""Cells that lie farther off than so many of their edges are other ground."""
MOST_ASK_S: Final = 600.0
"""Nobody needs air for longer, and nobody keeps out of it for longer."""
SOON_S: Final = 0.5
"""What somebody waits for is said at most so often."""
RELAY_S: Final = 8.0
"""What somebody lacks of a third one's facts for so long is told by whoever has it."""


@dataclass(slots=True)
class _Peer:
    """What is known of another member."""

    heard_s: float
    have: dict[int, int] = field(default_factory=dict)
    lacks_since_s: dict[int, float] = field(default_factory=dict)
    apart: bool = False
    done: bool = False
    told_all: bool = False
    """Whether it has told what it knows since it was done."""
    begun: bool = False
    ask: Ask | None = None
    promised: int = -1
    """Which of our questions for air it has promised."""
    ahead_s: float = -math.inf
    """By how much its clock is ahead of ours, at least: what comes late seems less."""


class Member:
    """One member's part in the talk of its fleet."""

    def __init__(
        self,
        setting: Setting,
        seal: Seal,
        radio: Radio,
        now_s: Callable[[], float],
        post: Callable[[Event], None],
        say: Callable[[str], None] = lambda text: None,
    ) -> None:
        self._setting = setting
        self._seal = seal
        self._radio = radio
        self._now_s = now_s
        self._post = post
        self._say = say
        self._number = seal.member
        self._own = Facts(setting)
        self.knowledge = Knowledge()
        self.peers: dict[int, _Peer] = {}
        self._told = 0
        """How many of our own facts were told once."""
        self._budget = float(BURST_BYTES)
        self._budget_s = now_s()
        self._state: State | None = None
        self._words: dict[int, Word] = {}
        self._begun = False
        self._agreed = False
        """Whether our clock is that of the fleet."""
        self._column: Column | None = None
        """The air that ours asks for..."""
        self._question = 0
        """... with the question of this number."""
        self._leased = -1
        self._beaten_s = -math.inf
        self._messages = 0
        self._urgent = False
        self._soon: asyncio.TimerHandle | None = None
        self._failed = False
        self.damaged = 0
        self._strangers: set[int] = set()

    def remember(self, events: Iterable[Event]) -> None:
        """Take in what the journal of an earlier start holds."""
        for event in events:
            self._note(event)
            if isinstance(event, Shared):
                self.knowledge.take(event.vehicle, event.first, event.frames)

    def observe(self, event: Event, state: State) -> None:
        """Our service has acted on an event."""
        self._state = state
        self._note(event)
        self._ask_for(state.vehicles[self._number].asks if state.ours else None)

    def _note(self, event: Event) -> None:
        if isinstance(event, LiftedOff):
            self._begun = True
        if isinstance(event, FrameSeen | Tracked) and event.vehicle == self._number:
            known = self.knowledge.have.get(self._number, 0)
            self.knowledge.take(self._number, known, self._own.take(event))

    # --- the clock -----------------------------------------------------------------------------
    async def agree(self, wait_s: float) -> float:
        """Listen until all are heard, or for so long; returns by how much our clock has to go on.

        The clock of whoever has taken off is followed, else that of the lowest number: so the
        members count the same seconds, whatever their computers take for the time of day.
        """
        everybody = set(range(1, len(self._setting.mission.vehicles) + 1)) - {self._number}
        waited_s = 0.0
        while waited_s < wait_s and not everybody <= set(self.peers):
            await asyncio.sleep(AGREE_STEP_S)
            waited_s += AGREE_STEP_S
        flying = {n: p for n, p in self.peers.items() if p.begun}
        if self._begun and not flying:
            return 0.0
        clocks = {n: p.ahead_s for n, p in (flying or self.peers).items()}
        if not flying:
            clocks[self._number] = 0.0
        if len(clocks) > 1:  # who only listens follows
            clocks.pop(0, None)
        return round(clocks[min(clocks)], 3) if clocks else 0.0

    def clock_moved(self, by_s: float) -> None:
        """Our clock was put forward, or back, by so much: as `agree` said."""
        self._agreed = True
        self._budget_s += by_s
        for peer in self.peers.values():
            peer.heard_s += by_s
            peer.ahead_s -= by_s
            peer.lacks_since_s = {o: at_s + by_s for o, at_s in peer.lacks_since_s.items()}

    def _is_elsewhere(self, sender: int, peer: _Peer) -> bool:
        """Whether the cells of another are not ours: it began apart, and the region drifts."""
        grid = self._setting.grid
        off_m = abs(peer.ahead_s) * grid.drift_speed_m_s
        elsewhere = self._agreed and peer.begun and off_m > ELSEWHERE_CELLS * grid.cell_m
        if elsewhere and sender not in self._strangers:
            self._strangers.add(sender)
            self._say(
                f"vehicle {sender} began apart from us, its clock is {peer.ahead_s:+.0f} s off, "
                "and the region drifts: its cells are other ground, and are not taken"
            )
        return elsewhere

    # --- an operator's word --------------------------------------------------------------------
    def order(self, word: Word) -> None:
        """Tell all what an operator has ordered, and do it."""
        known = self._words.get(word.vehicle)
        if known is not None and known.stamp >= word.stamp:
            return
        self._words[word.vehicle] = word
        t_s = round(self._now_s(), 3)
        if word.vehicle == 0:
            said = {"recall": Recalled, "pause": Paused, "continue": Continued}
            self._post(said[word.order](t_s))
        elif word.vehicle == self._number and word.order == "recall":
            self._post(VehicleRecalled(self._number, t_s))

    # --- air that is asked for -----------------------------------------------------------------
    def _ask_for(self, column: Column | None) -> None:
        """Ask for the air that our vehicle wants, or no longer."""
        if column == self._column:
            return
        self._column = column
        # by the time, so that what was promised to an earlier start is no answer to this one
        self._question = max(self._question + 1, round(1_000 * self._now_s()))
        self.beat_soon()

    def _hear_ask(self, sender: int, message: Message, now_s: float) -> None:
        """Close the air to ours that another asks for, for as long as it does by its own clock."""
        peer, ask = self.peers[sender], message.ask
        if ask == peer.ask:
            return
        peer.ask = ask
        t_s = round(now_s, 3)
        # (what the message took is added to that: the air is closed longer here, never shorter)
        for_s = 0.0 if ask is None else ask.until_s - message.t_s
        if ask is None or not 0.0 < for_s <= MOST_ASK_S:
            self._post(Asked(sender, t_s, GridPoint(0.0, 0.0), 0.0, 0.0, t_s))
            return
        until_s = round(now_s + for_s, 3)
        self._post(Asked(sender, t_s, ask.place, ask.low_m, ask.high_m, until_s))
        self.beat_soon()

    def _promised(self) -> dict[int, int]:
        """Whose air we keep out of: of those who have asked, and whom our own wish does not meet.

        The reducer has closed it to us when the question came; the promise is given once we are
        out of it. Of two who want the same air the lower number has it first, unless the other has
        it already.
        """
        state, found = self._state, {}
        if state is None:
            return {}
        for number, peer in self.peers.items():
            column = state.closed.get(number)
            if peer.ask is None or column is None or peer.ask.place != column.place:
                continue
            ours = self._column
            first = self._leased == self._question or self._number < number
            wanted = ours is not None and meets(self._setting, ours, column) and first
            if not wanted and may_close(self._setting, state, column):
                found[number] = peer.ask.number
        return found

    def _see_whether_leased(self) -> None:
        """Tell our service once everybody who could be in that air has promised."""
        column = self._column
        if column is None or self._leased == self._question:
            return
        for number in range(1, len(self._setting.mission.vehicles) + 1):
            if number == self._number:
                continue
            peer = self.peers.get(number)
            if peer is None or not (peer.done or peer.promised == self._question):
                return
        self._leased = self._question
        self._post(Leased(self._number, round(self._now_s(), 3), column.place, column.until_s))

    def beat_soon(self) -> None:
        """Speak before the next beat: somebody waits for it."""
        if self._soon is not None:
            return
        loop = asyncio.get_running_loop()
        wait_s = max(self._beaten_s + SOON_S - self._now_s(), 0.05)
        self._soon = loop.call_later(wait_s, self._beat_now)

    def _beat_now(self) -> None:
        self._soon = None
        self._urgent = True
        self._beat_safely()

    # --- speaking ------------------------------------------------------------------------------
    async def run(self) -> None:
        """Talk until cancelled."""
        self._radio.listen(self.heard)
        while True:
            self._beat_safely()
            await asyncio.sleep(BEAT_S)

    def _beat_safely(self) -> None:
        """Aircraft are flown whether the talk fails or not; that it fails is told once."""
        try:
            self.beat()
        except Exception as failure:
            if self._failed:
                return
            self._failed = True
            self._say(
                f"the talk with the fleet fails ({type(failure).__name__}: {failure}), which is a "
                "defect of the program; each aircraft goes on by itself"
            )

    def beat(self) -> None:
        """Say what there is to say, and note who is out of contact."""
        now_s = self._now_s()
        for number, peer in sorted(self.peers.items()):
            if not peer.apart and now_s - peer.heard_s > APART_S:
                peer.apart = True
                self._post(Apart(number, round(now_s, 3)))
        self._budget += (now_s - self._budget_s) * BYTES_A_MINUTE / 60.0
        self._budget = min(self._budget, BURST_BYTES)
        self._budget_s = now_s
        for errand in self._seal.errands():
            self._send(errand)
        message = self._message(now_s)
        sealed_bytes = HEADER_BYTES + len(encode(message))
        spare = int(self._budget) - self._radio.overhead_bytes - sealed_bytes
        if spare < 0 and not self._urgent and now_s - self._beaten_s < QUIET_S - 1e-6:
            return
        self._beaten_s, self._urgent = now_s, False
        self._messages += 1
        message = replace(message, batches=self._batches(now_s, spare))
        self._send(self._seal.sealed(encode(message)))

    def _message(self, now_s: float) -> Message:
        """What is said besides facts."""
        return Message(
            now_s,
            self._presence(),
            self.knowledge.have if self._messages % HAVE_EVERY == 0 else {},
            words=tuple(self._words[vehicle] for vehicle in sorted(self._words)),
            begun=self._begun or self._agreed,
            ask=self._question_now(),
            promised=self._promised(),
        )

    def _question_now(self) -> Ask | None:
        column = self._column
        if column is None:
            return None
        return Ask(
            self._question, column.place, column.low_m, column.high_m, math.floor(column.until_s)
        )

    def _send(self, datagram: bytes) -> None:
        self._budget -= len(datagram) + self._radio.overhead_bytes
        self._radio.send(datagram)

    def _batches(self, now_s: float, room: int) -> tuple[Batch, ...]:
        """Facts to tell, in at most so many bytes: new ones of ours, then what somebody lacks."""
        wanted: list[tuple[int, int]] = []
        mine = self.knowledge.facts.get(self._number, [])
        if self._told < len(mine):
            wanted.append((self._number, self._told))
        for peer in (p for p in self.peers.values() if not p.apart):
            for origin, first in self.knowledge.missing(peer.have).items():
                ours = origin == self._number and first < self._told
                waited = now_s - peer.lacks_since_s.get(origin, now_s) >= RELAY_S
                if ours or (origin != self._number and waited):
                    wanted.append((origin, first))
        batches: list[Batch] = []
        for origin, first in dict.fromkeys(wanted):
            batch, size = self._fitting(origin, first, room)
            if batch is None:
                continue
            batches.append(batch)
            room -= size
            if origin == self._number:
                self._told = max(self._told, first + len(batch.facts))
        return tuple(batches)

    def _fitting(self, origin: int, first: int, room: int) -> tuple[Batch | None, int]:
        """As many facts from `first` on as there is room for."""
        facts = self.knowledge.facts[origin][first:]
        count = len(facts)
        while count > 0:
            batch = Batch(origin, first, tuple(facts[:count]))
            size = len(encode(Message(0.0, batches=(batch,)))) - 4
            if size <= room:
                return batch, size
            count = min(count - 1, count * max(room, 0) // size)
        return None, 0

    def _presence(self) -> Presence | None:
        state = self._state
        if state is None or self._number not in state.vehicles:
            return None
        return presence_of(self._setting, state, state.vehicles[self._number])

    # --- hearing -------------------------------------------------------------------------------
    def heard(self, datagram: bytes) -> None:
        """A datagram has come in."""
        opened = self._seal.opened(datagram)
        if opened is None:
            return
        sender, body = opened
        try:
            message = decode(body)
        except BytesError:
            self.damaged += 1
            return
        now_s = self._now_s()
        peer = self.peers.setdefault(sender, _Peer(now_s))
        peer.heard_s, peer.apart = now_s, False
        if message.begun and not peer.begun:  # its clock may have been moved just now
            peer.ahead_s = -math.inf
        peer.ahead_s = max(peer.ahead_s, message.t_s - now_s)
        for word in message.words:
            self.order(word)
        # what one does or asks for now is told by its last message: facts alone may come late
        latest = not self._seal.overtaken
        if latest:
            self._hear_state(sender, peer, message, now_s)
        if not self._agreed or self._is_elsewhere(sender, peer):
            return  # what is not taken is told again
        for batch in message.batches:
            if batch.origin == self._number:
                continue
            new = self.knowledge.take(batch.origin, batch.first, batch.facts)
            if new:
                first = self.knowledge.have[batch.origin] - len(new)
                self._post(Shared(batch.origin, round(now_s, 3), first, tuple(new)))
        if latest and message.presence is not None and self._is_vehicle(sender):
            self._post(self._heard_of(sender, now_s, message.presence))

    def _hear_state(self, sender: int, peer: _Peer, message: Message, now_s: float) -> None:
        """What another is, knows, asks for and has promised now."""
        peer.have = message.have or peer.have
        if message.presence is not None:
            peer.done = message.presence.does in ("ended", "down")
        else:  # one that flies a vehicle, and has just started, does not know yet what it does
            peer.done = not self._is_vehicle(sender)
        peer.told_all = peer.done and (peer.told_all or bool(message.have))
        peer.begun = message.begun
        missing = self.knowledge.missing(peer.have)
        peer.lacks_since_s = {origin: peer.lacks_since_s.get(origin, now_s) for origin in missing}
        if self._agreed:
            self._hear_ask(sender, message, now_s)
            peer.promised = message.promised.get(self._number, -1)
            self._see_whether_leased()

    def _is_vehicle(self, number: int) -> bool:
        return 0 < number <= len(self._setting.mission.vehicles)

    def _heard_of(self, sender: int, now_s: float, said: Presence) -> Heard:
        capacity_wh = self._setting.mission.battery.capacity_wh
        return Heard(
            sender, round(now_s, 3), said.position, said.height_m,
            round(said.charge * capacity_wh, 2), said.does, self._setting.pad_of(sender),
            said.lanes, said.path, said.layer_m,
        )  # fmt: skip

    def end(self) -> None:
        """Say nothing more."""
        if self._soon is not None:
            self._soon.cancel()

    async def settle(self) -> None:
        """Wait until everybody in contact is done and knows what is known here, or long enough.

        Who is out of contact, and was not done when it was, will come home, where it hears us.
        """
        waited_s = 0.0
        while waited_s < LINGER_S:
            least_s = 2.0 * BEAT_S if self.all_done else LINGER_APART_S
            if self.level and waited_s >= least_s:
                break
            await asyncio.sleep(BEAT_S)
            waited_s += BEAT_S

    @property
    def all_done(self) -> bool:
        """Whether everybody that was ever heard is done."""
        return all(peer.done for peer in self.peers.values())

    @property
    def level(self) -> bool:
        """Whether everybody in contact knows what is known here, and nobody knows more."""
        return all(
            peer.done
            and (peer.told_all or not self.knowledge.have)
            and not self.knowledge.missing(peer.have)
            and not self.knowledge.lacking(peer.have)
            for peer in self.peers.values()
            if not peer.apart
        )


@contextlib.asynccontextmanager
async def talking(
    member: Member | None, say: Callable[[str], None] | None = None
) -> AsyncIterator[None]:
    """Have a member talk while the context lasts, and after it until the others know all of it.

    `say` tells an operator of that wait, who may end it: to cancel it is no failure then.
    """
    if member is None:
        yield
        return
    task = asyncio.create_task(member.run())
    try:
        yield
        if say is not None and not member.level:
            say(
                "ours is done; waiting for what the others of the fleet still find (Ctrl-C ends it)"
            )
        try:
            await member.settle()
        except asyncio.CancelledError:
            waiting = asyncio.current_task()
            if say is None or waiting is None:
                raise
            waiting.uncancel()
            say("not waiting for the others: their journals hold what they find, for uavmap merge")
    finally:
        task.cancel()
        member.end()
        await asyncio.gather(task, return_exceptions=True)


def presence_of(setting: Setting, state: State, vehicle: VehicleState) -> Presence:
    """What a member tells of its vehicle."""
    capacity_wh = setting.mission.battery.capacity_wh
    return Presence(
        _does(vehicle),
        vehicle.position,
        vehicle.height_m,
        vehicle.remaining_wh / capacity_wh,
        vehicle.cruise_altitude_m,
        lanes_held(setting, vehicle),
        _places_ahead(vehicle, state.t_s),
    )


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
