"""Members exchange an operator's commands, clocks, pads and facts; lost facts are sent again."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, field
from typing import Any

import pytest

from missions.events import Continued, Event, Paused, Recalled, VehicleRecalled
from missions.fleet_events import Fact
from missions.units import Cell, GridPoint, PadHeight
from tests.unit.missions.flight.test_facts import small_setting
from tests.unit.uavmap.fleet.test_members_in_air import setting_for
from uavmap.base.clock import VirtualClock, run
from uavmap.fleet.codec import Batch, Message, OperatorOrder, encode
from uavmap.fleet.knowledge import Holding, Knowledge
from uavmap.fleet.member import Member
from uavmap.fleet.peer import RELAY_S, FactSender, Peer
from uavmap.fleet.sealing import Seal
from uavmap.fleet.simulated_radio import Air, LinkModel

KEY = bytes(range(32))


@dataclass
class Station:
    """A member without a service: it keeps each report that a service would get."""

    number: int
    air: Air
    place: GridPoint
    late_s: float = 0.0
    """Delay of its clock, s."""
    start: int = 1
    """Number of starts of its program."""
    events: list[Event] = field(default_factory=list)
    member: Member = field(init=False)

    def __post_init__(self) -> None:
        setting = small_setting(self.number)
        radio = self.air.radio(self.number, lambda: (self.place, 0.0))
        self.member = Member(
            setting, Seal(KEY, self.number, self.start), radio, self.now_s, self.events.append
        )
        self.member.observe(Continued(0.0), setting.initial_state())

    def now_s(self) -> float:
        """Return its mission time."""
        return asyncio.get_running_loop().time() - self.late_s

    def reports(self, *kinds: type) -> list[type]:
        """Return the reports of some kinds that it got."""
        return [type(event) for event in self.events if isinstance(event, kinds)]


def together(
    stations: Callable[[], list[Station]],
    act: Callable[[list[Station]], Coroutine[Any, Any, None]],
) -> list[Station]:
    """Let stations communicate during an action."""

    async def all_of_it() -> list[Station]:
        those = stations()
        talking = [asyncio.create_task(station.member.run()) for station in those]
        await act(those)
        for task in talking:
            task.cancel()
        await asyncio.gather(*talking, return_exceptions=True)
        return those

    return run(all_of_it(), VirtualClock())


def in_a_row(spacing_m: float, range_m: float, count: int = 3) -> list[Station]:
    """Place the members in a row, with the ground station, 0, at one end."""
    air = Air(LinkModel(range_m=range_m, loss=0.2), seed=4)
    return [Station(k, air, GridPoint(spacing_m * k, 0.0)) for k in range(count + 1)]


def test_command_of_the_station_is_relayed_to_members_out_of_range():
    async def recall_all(stations: list[Station]) -> None:
        await asyncio.sleep(20.0)
        stations[0].member.order(OperatorOrder(7, 0, "recall"))
        await asyncio.sleep(40.0)

    stations = together(lambda: in_a_row(100.0, 150.0), recall_all)
    for station in stations:
        assert station.reports(Recalled) == [Recalled], station.number


def test_newest_command_holds_and_each_is_reported_once():
    async def send_commands(stations: list[Station]) -> None:
        await asyncio.sleep(15.0)
        ground = stations[0].member
        ground.order(OperatorOrder(7, 0, "pause"))
        ground.order(OperatorOrder(9, 2, "recall"))
        await asyncio.sleep(30.0)
        ground.order(OperatorOrder(8, 0, "continue"))
        ground.order(OperatorOrder(6, 0, "recall"))  # an older one, which was under way for long
        await asyncio.sleep(30.0)

    stations = together(lambda: in_a_row(10.0, 100.0), send_commands)
    for station in stations[1:]:
        orders = station.reports(Paused, Continued, Recalled, VehicleRecalled)
        mine = [VehicleRecalled] if station.number == 2 else []
        assert [o for o in orders if o is not VehicleRecalled] == [Paused, Continued]
        assert [o for o in orders if o is VehicleRecalled] == mine


def test_members_take_the_clock_of_the_lowest_number_and_later_that_of_the_fleet():
    found: dict[int, float] = {}

    async def agree(station: Station) -> None:
        by_s = await station.member.agree(15.0, None)
        station.late_s -= by_s
        station.member.clock_moved(by_s)
        found[station.number] = station.now_s()

    async def all_agree(stations: list[Station]) -> None:
        early = stations[2:4]
        early[0].late_s, early[1].late_s = -3600.0, 40.0
        stations[1].place = GridPoint(1e6, 0.0)  # no member receives it yet
        await asyncio.gather(*(agree(station) for station in early))
        assert abs(early[0].now_s() - early[1].now_s()) < 0.1
        assert early[0].now_s() > 3600.0  # the clock of the lower number
        await asyncio.sleep(30.0)
        stations[1].place = GridPoint(1.0, 0.0)
        await agree(stations[1])  # of a lower number, but too late to lead
        await agree(stations[0])
        for station in stations:
            assert abs(station.now_s() - early[0].now_s()) < 0.1, station.number

    together(lambda: in_a_row(1.0, 100.0), all_agree)
    assert len(found) == 4


def test_communication_that_fails_is_reported_once_and_continues(log_lines):
    async def listen(stations: list[Station]) -> None:
        stations[1].late_s = float("nan")  # a clock without a value
        await asyncio.sleep(20.0)
        stations[1].late_s = 0.0
        await asyncio.sleep(20.0)
        stations[0].member.order(OperatorOrder(7, 0, "recall"))
        await asyncio.sleep(20.0)

    stations = together(lambda: in_a_row(1.0, 100.0, 1), listen)
    assert len(log_lines) == 1
    assert "internal error in fleet communication (ValueError" in log_lines[0]
    assert stations[1].reports(Recalled) == [Recalled]


def test_ground_station_with_an_earlier_clock_is_obeyed(monkeypatch):
    """A station 5 minutes ahead commands a hold; another with the right time recalls all."""

    async def two_stations(stations: list[Station]) -> None:
        await asyncio.sleep(20.0)
        monkeypatch.setattr("time.time", lambda: 1_800_000_300.0)
        stations[0].member.command("pause")
        await asyncio.sleep(20.0)
        monkeypatch.setattr("time.time", lambda: 1_800_000_000.0)
        stations[1].member.command("recall")
        await asyncio.sleep(30.0)

    for station in together(lambda: in_a_row(10.0, 100.0), two_stations):
        assert station.reports(Paused, Recalled) == [Paused, Recalled], station.number


def test_resumed_member_ignores_a_recall_that_it_obeyed_before():
    again: list[Station] = []

    async def resumed(stations: list[Station]) -> None:
        await asyncio.sleep(20.0)
        stations[0].member.command("recall")
        await asyncio.sleep(60.0)
        for number, journal in ((2, stations[2].events), (3, [])):
            stations[number].place = GridPoint(1e6, 0.0)
            one = Station(number, stations[0].air, GridPoint(10.0 * number, 0.0), start=2)
            one.member.remember(journal)
            again.append(one)
        talking = [asyncio.create_task(one.member.run()) for one in again]
        await asyncio.sleep(30.0)
        for task in talking:
            task.cancel()

    together(lambda: in_a_row(10.0, 100.0), resumed)
    assert [one.reports(Recalled) for one in again] == [[], [Recalled]]


def test_members_know_the_heights_of_all_pads_before_they_fly():
    pads = {number: PadHeight(500.0 + number, 1.5) for number in (1, 2, 3)}
    known: dict[int, dict[int, PadHeight]] = {}

    async def agree(station: Station) -> None:
        await station.member.agree(15.0, pads.get(station.number))
        known[station.number] = station.member.pads

    async def all_agree(stations: list[Station]) -> None:
        await asyncio.gather(*map(agree, stations))

    together(lambda: in_a_row(10.0, 100.0), all_agree)
    assert known == dict.fromkeys(range(4), pads)


ROOM = 900
FACTS = 200
SLOWEST_S = 30.0
ALL_BELIEVED_S = 20.0
"""Time by which each member has proven to all that it is active, s."""


def fact(k: int) -> Fact:
    return Fact(float(k), ((Cell(k, 0), True),))


def facts(first: int, end: int) -> list[Fact]:
    return [fact(k) for k in range(first, end)]


def fact_numbers(batches: tuple[Batch, ...]) -> list[tuple[int, int]]:
    return [(b.origin, b.first + k) for b in batches for k in range(len(b.facts))]


def size(batches: tuple[Batch, ...]) -> int:
    return len(encode(Message(0.0, batches=batches))) - len(encode(Message(0.0)))


def test_fact_under_way_is_not_sent_again_and_a_lost_one_is():
    peer, known = Peer(0.0), Knowledge()
    telling = FactSender(1, {2: peer})
    known.add(1, 0, facts(0, 6))
    assert fact_numbers(telling.batches(known, 10.0, ROOM)) == [(1, k) for k in range(6)]
    peer.have, peer.have_s = {}, 10.5  # sent before the fact could have arrived
    assert not telling.batches(known, 12.0, ROOM)
    peer.have, peer.have_s = {1: Holding(1, ((3, 4), (5, 6)))}, 13.0
    known.add(1, 6, facts(6, 8))
    again = telling.batches(known, 14.0, ROOM)
    assert fact_numbers(again) == [(1, 1), (1, 2), (1, 4), (1, 6), (1, 7)]


def test_lost_facts_take_half_of_the_room_while_there_is_news():
    peer, known = Peer(0.0), Knowledge()
    telling = FactSender(1, {2: peer})
    known.add(1, 0, facts(0, 60))
    telling.batches(known, 1.0, 10_000)
    peer.have_s = 5.0
    known.add(1, 60, facts(60, 120))
    said = telling.batches(known, 6.0, 200)
    numbers = {number for _, number in fact_numbers(said)}
    assert size(said) <= 200
    assert 60 in numbers
    assert 0 in numbers
    assert telling.batches(known, 6.0, 0) == ()


def test_facts_of_others_are_relayed_to_a_member_that_lacks_them():
    peer, known = Peer(0.0), Knowledge()
    telling = FactSender(1, {2: peer})
    known.add(3, 0, facts(0, 4))
    peer.have, peer.have_s, peer.lacks_since_s = {3: Holding(1)}, 20.0, {3: 20.0}
    assert not telling.batches(known, 20.0 + RELAY_S - 0.1, ROOM)
    assert fact_numbers(telling.batches(known, 20.0 + RELAY_S, ROOM)) == [(3, 1), (3, 2), (3, 3)]
    peer.apart = True
    assert not telling.batches(known, 60.0, ROOM)


def test_restarted_member_sends_only_facts_that_another_lacks():
    peer, known = Peer(0.0), Knowledge()
    peer.have, peer.have_s = {1: Holding(5)}, 3.0
    known.add(1, 0, facts(0, 7))
    assert fact_numbers(FactSender(1, {2: peer}).batches(known, 4.0, ROOM)) == [(1, 5), (1, 6)]


@dataclass(slots=True)
class Talk:
    """Members that each find a fact a second, with the times at which each received each fact."""

    members: list[Member]
    late_s: list[float] = field(default_factory=list)
    known: Counter[tuple[int, int]] = field(default_factory=Counter)

    def record(self, now_s: float) -> None:
        for ours in self.members:
            for origin in range(1, len(self.members) + 1):
                have = ours.knowledge.facts.get(origin, {})
                before = self.known[ours._number, origin]
                news = (have[k].t_s for k in sorted(have)[before:])
                self.late_s.extend(now_s - at_s for at_s in news if at_s >= ALL_BELIEVED_S)
                self.known[ours._number, origin] = len(have)


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_news_is_sent_soon_and_once_and_lost_facts_again(loss):
    async def talk() -> tuple[Talk, int, dict[int, int]]:
        air = Air(LinkModel(loss=loss, delay_s=0.1), seed=3)
        loop = asyncio.get_running_loop()
        members = []
        for number in (1, 2, 3):
            radio = air.radio(number, lambda: (GridPoint(0.0, 0.0), 0.0))
            seal = Seal(KEY, number, 1)
            member = Member(setting_for(number), seal, radio, loop.time, lambda event: None)
            member.clock_moved(0.0)
            members.append(member)
        said = Counter[tuple[int, int]]()
        for member in members:
            tell = member._sender.batches

            def counted(known, now_s, room, tell=tell):
                batches = tell(known, now_s, room)
                said.update(fact_numbers(batches))
                return batches

            member._sender.batches = counted
        tasks = [asyncio.create_task(member.run()) for member in members]
        found = Talk(members)
        for k in range(FACTS + int(SLOWEST_S)):
            if k < FACTS:
                for member in members:
                    member.knowledge.add(member._number, k, [fact(k)])
            await asyncio.sleep(1.0)
            found.record(float(k + 1))
        for task in tasks:
            task.cancel()
        return found, said.total(), air.sent_bytes

    found, said, sent = run(talk(), VirtualClock())
    assert all(found.known[one, other] == FACTS for one in (1, 2, 3) for other in (1, 2, 3))
    late_s = sorted(found.late_s)
    if loss == 0.0:
        assert said <= 3 * FACTS * 1.05  # each once, except for facts that no member trusted yet
        assert late_s[-1] <= 6.0
    else:
        assert said <= 3 * FACTS * 1.8
        assert late_s[len(late_s) * 9 // 10] <= 10.0
        assert late_s[-1] <= SLOWEST_S
    assert max(sent.values()) / (FACTS + SLOWEST_S) * 60 <= 5_000
