"""The service between a journal and vehicles whose reports a test determines."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from missions.errors import ImageError, JournalError, MissionFileError
from missions.events import Connected, Crashed, Event, LinkLost, Overridden, Recalled, Tracked
from missions.flight.setting_of import setting_of
from missions.flight.state import State
from missions.flight.vehicle_state import Phase
from missions.mission.sections import DetectorSection
from missions.orders import Order, StandDown, TakeOff
from missions.units import GridPoint
from tests.support.flights import small_mission
from tests.support.folding import fold
from tests.support.running import by, on_virtual_time
from uavmap.aircraft.imaging.classifier import Blind, PictureJudge
from uavmap.aircraft.process import messages as msg
from uavmap.aircraft.process.port import Port
from uavmap.base.clock import VirtualClock, run
from uavmap.journal import event_log
from uavmap.journal.event_log import Journal
from uavmap.runner.service import Observer, Reports, Service
from uavmap.runner.vehicles import judge_of

HOME = GridPoint(0.0, 0.0)
CONNECTED = Connected(1, 0.0, HOME, HOME, 0.0, False, True, 25.0)


class Played:
    """A vehicle that makes given reports, from the event loop as a socket would."""

    def __init__(self, *events: tuple[float, Event]) -> None:
        self.orders: list[Order] = []
        self._events = events

    def play(self, service: Service) -> None:
        self.service = service
        loop = asyncio.get_running_loop()
        for after_s, event in self._events:
            loop.call_later(after_s, service.post, event)

    def give(self, vehicle: int, order: Order) -> None:
        self.orders.append(order)

    def land_here(self, vehicle: int, reason: str) -> None:
        """Do nothing: these vehicles never land here."""


@pytest.fixture
def journal(tmp_path):
    with Journal.create(tmp_path / "journal.jsonl", {}) as journal:
        yield journal


def service_of(
    journal: Journal,
    vehicle: Played,
    observe: Observer = lambda *_: None,
    reports: Reports | None = None,
) -> Service:
    setting = setting_of(small_mission())
    return Service(journal, vehicle, setting.initial_state(), observe, reports)


def serve(journal: Journal, vehicle: Played, act: Callable[[Service], None]) -> State:
    seen: list[Event] = []
    service = service_of(journal, vehicle, lambda e, _: seen.append(e))

    async def main() -> State:
        vehicle.play(service)
        asyncio.get_running_loop().call_later(10.0, act, service)
        async with asyncio.timeout(60.0):
            state = await service.fly()
        assert len(asyncio.all_tasks()) == 1
        return state

    state = run(main(), VirtualClock())
    assert seen == list(journal.events())
    return state


def test_events_are_committed_in_order_and_orders_handed_out(journal):
    vehicle = Played((1.0, CONNECTED), (2.0, LinkLost(1, 2.0)), (12.0, CONNECTED))
    state = serve(journal, vehicle, Service.recall)
    assert [type(o) for o in vehicle.orders] == [TakeOff, StandDown, StandDown]
    assert [type(e) for e in journal.events()] == [Connected, LinkLost, Recalled, Connected]
    assert state.is_over


def test_flight_is_over_when_no_vehicle_has_an_order(journal):
    vehicle = Played((1.0, CONNECTED), (2.0, Overridden(1, 2.0, "LOITER")))
    state = serve(journal, vehicle, lambda service: pytest.fail("it should be over by now"))
    assert state.is_over


def test_order_is_given_after_the_commit(journal):
    committed: list[str] = []

    class Watched(Played):
        def give(self, vehicle: int, order: Order) -> None:
            super().give(vehicle, order)
            committed.append(list(journal.events())[-1].kind)

    vehicle = Watched((1.0, CONNECTED), (2.0, LinkLost(1, 2.0)), (3.0, CONNECTED))
    serve(journal, vehicle, Service.stop)
    assert committed == ["connected", "link_lost", "connected"]


def test_recall_is_posted_once(journal):
    def twice(service: Service) -> None:
        service.recall()
        service.recall()

    vehicle = Played((1.0, CONNECTED), (2.0, LinkLost(1, 2.0)), (12.0, CONNECTED))
    serve(journal, vehicle, twice)
    assert sum(isinstance(e, Recalled) for e in journal.events()) == 1


def test_stop_ends_the_flight_as_it_is(journal):
    state = serve(journal, Played((1.0, CONNECTED)), Service.stop)
    assert not state.is_over


def test_report_during_an_order_is_handled_afterwards(journal):
    depth: list[int] = []

    class Eager(Played):
        def play(self, service: Service) -> None:
            super().play(service)
            service.post(CONNECTED)

        def give(self, vehicle: int, order: Order) -> None:
            depth.append(1)
            assert len(depth) - len(self.orders) == 1
            self.orders.append(order)
            if isinstance(order, TakeOff):
                self.service.post(LinkLost(1, 1.0))
                assert len(self.orders) == 1

    vehicle = Eager()
    serve(journal, vehicle, Service.stop)
    assert [type(order) for order in vehicle.orders] == [TakeOff, StandDown]
    assert [type(e) for e in journal.events()] == [Connected, LinkLost]


@pytest.mark.filterwarnings("error")
def test_journal_that_cannot_be_written_ends_the_mission(journal, monkeypatch, log_lines):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    vehicle = Played(
        (1.0, CONNECTED), *((t_s, Tracked(1, t_s, HOME, 0.0, 25.0)) for t_s in (20.0, 21.0, 22.0))
    )
    noticed: list[Event] = []
    reports = Reports([noticed.append])
    service = service_of(journal, vehicle, reports=reports)

    async def main() -> None:
        loop = asyncio.get_running_loop()
        vehicle.play(service)
        loop.call_later(10.0, monkeypatch.setattr, event_log, "write_at", full)
        try:
            await service.fly()
        finally:
            assert loop.time() == pytest.approx(20.0)
            assert service.ended

    with pytest.raises(JournalError, match="cannot be written: No space left on device"):
        run(main(), VirtualClock())
    service.flush_pending_events()
    monkeypatch.undo()
    assert [type(e) for e in journal.events()] == [Connected]
    assert [e.t_s for e in noticed] == [
        0.0,
        20.0,
    ]  # shown, although no journal holds the last
    assert len(log_lines) == 1
    assert "are not in the journal" in log_lines[0]


def test_report_after_a_failure_is_recorded_and_not_acted_on(journal, monkeypatch):
    flying = Connected(1, 1.0, HOME, HOME, 12.0, True, True, 25.0)
    vehicle = Played((1.0, flying), (5.0, Tracked(1, 5.0, HOME, 12.0, 25.0)))
    service = service_of(journal, vehicle)
    append = journal.append

    def failing(event: Event) -> None:
        if event.t_s == 5.0:
            raise JournalError("the disk is full")
        append(event)

    monkeypatch.setattr(journal, "append", failing)

    async def main() -> None:
        vehicle.play(service)
        await service.fly()

    with pytest.raises(JournalError, match="disk is full"):
        run(main(), VirtualClock())
    monkeypatch.undo()  # the disk has room again
    given = len(vehicle.orders)
    service.post(Crashed(1, 30.0, HOME, "it fell"))
    service.post(Tracked(1, 31.0, GridPoint(float("nan"), 0.0), 0.0, 25.0))
    service.flush_pending_events()
    assert [(type(e), e.t_s) for e in journal.events()] == [
        (Connected, 1.0),
        (Tracked, 5.0),
        (Crashed, 30.0),
    ]
    assert len(vehicle.orders) == given
    assert fold(service.setting, journal.events()).vehicles[1].phase is Phase.DOWN


@by(on_virtual_time)
async def test_aircraft_know_the_events_recorded_after_the_end(journal):
    service = service_of(journal, Played())

    async def unexpected(_: object) -> None:
        raise AssertionError

    port = Port(
        (1,),
        lambda: 0.0,
        PictureJudge({}),
        service.post,
        service._reports.join,
        unexpected,
        unexpected,
    )
    service.stop()
    await service.fly()
    port.receive(msg.EventReport(CONNECTED, 1))
    await asyncio.sleep(0.0)
    assert port.kept == 0
    service.flush_pending_events()
    await asyncio.sleep(0.0)
    assert port.kept == 1
    assert list(journal.events()) == [CONNECTED]


@by(on_virtual_time)
async def test_report_that_no_journal_can_hold_is_refused_with_a_line(journal, log_lines):
    nowhere = GridPoint(float("inf"), 0.0)
    vehicle = Played((1.0, CONNECTED), (2.0, Tracked(1, 2.0, nowhere, 0.0, 25.0)))
    service = service_of(journal, vehicle)
    vehicle.play(service)
    asyncio.get_running_loop().call_later(10.0, service.stop)
    await service.fly()
    assert [type(e) for e in journal.events()] == [Connected]
    assert service.refused == 1
    assert service.state.vehicles[1].position == HOME
    assert "a report was refused" in log_lines[0]


def judge(model: Path, *, recall: bool) -> PictureJudge:
    section = DetectorSection(name="learned", model=str(model), model_sha256="0" * 64)
    made = small_mission().model_copy(update={"detector": section})
    return judge_of(setting_of(made), recall=recall)


@pytest.mark.parametrize("there", [False, True])
def test_flight_without_its_model_can_only_be_recalled(tmp_path, there, log_lines):
    model = tmp_path / "model.json"
    if there:
        model.write_text("another one")
    with pytest.raises(MissionFileError, match=r"put (it|the old one) back: its SHA-256 is 0000"):
        judge(model, recall=False)
    judge(model, recall=True)
    (line,) = log_lines
    assert str(model) in line
    assert line.endswith("the aircraft are brought home without it")


def test_service_without_a_detector_refuses_pictures():
    picture = np.zeros((4, 4, 3), np.uint8)
    for judge in (Blind().mask, Blind().probability):
        with pytest.raises(ImageError, match="only return home"):
            judge(picture)
