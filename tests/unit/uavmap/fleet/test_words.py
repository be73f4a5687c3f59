"""An operator's word reaches all members, by others where it must; clocks are the fleet's."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, field
from typing import Any

import pytest

from missions.events import Continued, Event, Paused, Recalled, VehicleRecalled
from missions.flight.state import State
from missions.units import GridPoint, PadHeight
from tests.support.said import Said
from tests.unit.missions.flight.test_facts import small_setting
from uavmap.base.clock import VirtualClock, run
from uavmap.fleet.codec import Word
from uavmap.fleet.member import Member
from uavmap.fleet.sealing import Seal
from uavmap.fleet.simulated_radio import Air, LinkModel

KEY = bytes(range(32))


@dataclass
class Station:
    """A member without a service: what it would be told is kept."""

    number: int
    air: Air
    place: GridPoint
    late_s: float = 0.0
    """By how much its clock is behind."""
    start: int = 1
    """How often its program has started."""
    events: list[Event] = field(default_factory=list)
    member: Member = field(init=False)

    def __post_init__(self) -> None:
        setting = small_setting(self.number)
        radio = self.air.radio(self.number, lambda: (self.place, 0.0))
        self.member = Member(
            setting, Seal(KEY, self.number, self.start), radio, self.now_s, self.events.append
        )
        self.member.observe(Continued(0.0), State.initial(setting))

    def now_s(self) -> float:
        """Its mission time."""
        return asyncio.get_running_loop().time() - self.late_s

    def told(self, *kinds: type) -> list[type]:
        """What it was told to do, of some kinds."""
        return [type(event) for event in self.events if isinstance(event, kinds)]


def together(
    stations: Callable[[], list[Station]],
    act: Callable[[list[Station]], Coroutine[Any, Any, None]],
) -> list[Station]:
    """Let stations talk while something is done."""

    async def all_of_it() -> list[Station]:
        made = stations()
        talking = [asyncio.create_task(station.member.run()) for station in made]
        await act(made)
        for task in talking:
            task.cancel()
        await asyncio.gather(*talking, return_exceptions=True)
        return made

    return run(all_of_it(), VirtualClock())


def in_a_row(spacing_m: float, range_m: float, count: int = 3) -> list[Station]:
    """The ground station, 0, at one end of a row."""
    air = Air(LinkModel(range_m=range_m, loss=0.2), seed=4)
    return [Station(k, air, GridPoint(spacing_m * k, 0.0)) for k in range(count + 1)]


def test_a_word_from_the_ground_is_passed_on_to_who_cannot_hear_it() -> None:
    async def recall_all(stations: list[Station]) -> None:
        await asyncio.sleep(20.0)
        stations[0].member.order(Word(7, 0, "recall"))
        await asyncio.sleep(40.0)

    stations = together(lambda: in_a_row(100.0, 150.0), recall_all)
    for station in stations:
        assert station.told(Recalled) == [Recalled], station.number


def test_the_newest_word_holds_and_each_is_told_once() -> None:
    async def words(stations: list[Station]) -> None:
        await asyncio.sleep(15.0)
        ground = stations[0].member
        ground.order(Word(7, 0, "pause"))
        ground.order(Word(9, 2, "recall"))
        await asyncio.sleep(30.0)
        ground.order(Word(8, 0, "continue"))
        ground.order(Word(6, 0, "recall"))  # an older one, which was on its way for long
        await asyncio.sleep(30.0)

    stations = together(lambda: in_a_row(10.0, 100.0), words)
    for station in stations[1:]:
        orders = station.told(Paused, Continued, Recalled, VehicleRecalled)
        mine = [VehicleRecalled] if station.number == 2 else []
        assert [o for o in orders if o is not VehicleRecalled] == [Paused, Continued]
        assert [o for o in orders if o is VehicleRecalled] == mine


def test_members_take_the_clock_of_the_lowest_number_and_later_that_of_the_fleet() -> None:
    found: dict[int, float] = {}

    async def agree(station: Station) -> None:
        by_s = await station.member.agree(15.0, None)
        station.late_s -= by_s
        station.member.clock_moved(by_s)
        found[station.number] = station.now_s()

    async def all_agree(stations: list[Station]) -> None:
        early = stations[2:4]
        early[0].late_s, early[1].late_s = -3600.0, 40.0
        stations[1].place = GridPoint(1e6, 0.0)  # nobody hears it yet
        await asyncio.gather(*(agree(station) for station in early))
        assert abs(early[0].now_s() - early[1].now_s()) < 0.1
        assert early[0].now_s() > 3600.0  # the lower number's
        await asyncio.sleep(30.0)
        stations[1].place = GridPoint(1.0, 0.0)
        await agree(stations[1])  # of a lower number, but too late to lead
        await agree(stations[0])
        for station in stations:
            assert abs(station.now_s() - early[0].now_s()) < 0.1, station.number

    together(lambda: in_a_row(1.0, 100.0), all_agree)
    assert len(found) == 4


def test_a_talk_that_fails_is_told_once_and_goes_on(said: Said) -> None:
    async def listen(stations: list[Station]) -> None:
        stations[1].late_s = float("nan")  # a clock that says nothing
        await asyncio.sleep(20.0)
        stations[1].late_s = 0.0
        await asyncio.sleep(20.0)
        stations[0].member.order(Word(7, 0, "recall"))
        await asyncio.sleep(20.0)

    stations = together(lambda: in_a_row(1.0, 100.0, 1), listen)
    assert len(said) == 1
    assert "the talk with the fleet fails (ValueError" in said[0]
    assert stations[1].told(Recalled) == [Recalled]


def test_a_ground_station_whose_clock_went_back_is_heard(monkeypatch: pytest.MonkeyPatch) -> None:
    """A station 5 minutes ahead has all hold; another with the right time calls them home."""

    async def two_stations(stations: list[Station]) -> None:
        await asyncio.sleep(20.0)
        monkeypatch.setattr("time.time", lambda: 1_800_000_300.0)
        stations[0].member.command("pause")
        await asyncio.sleep(20.0)
        monkeypatch.setattr("time.time", lambda: 1_800_000_000.0)
        stations[1].member.command("recall")
        await asyncio.sleep(30.0)

    for station in together(lambda: in_a_row(10.0, 100.0), two_stations):
        assert station.told(Paused, Recalled) == [Paused, Recalled], station.number


def test_a_member_that_is_resumed_is_not_called_home_by_the_word_that_it_has_obeyed() -> None:
    """The others repeat the recall while they wait; "resume" is a later word than that."""
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
    assert [one.told(Recalled) for one in again] == [[], [Recalled]]


def test_members_know_the_heights_of_all_pads_before_they_fly() -> None:
    pads = {number: PadHeight(500.0 + number, 1.5) for number in (1, 2, 3)}
    known: dict[int, dict[int, PadHeight]] = {}

    async def agree(station: Station) -> None:
        await station.member.agree(15.0, pads.get(station.number))
        known[station.number] = station.member.pads

    async def all_agree(stations: list[Station]) -> None:
        await asyncio.gather(*map(agree, stations))

    together(lambda: in_a_row(10.0, 100.0), all_agree)
    assert known == dict.fromkeys(range(4), pads)
