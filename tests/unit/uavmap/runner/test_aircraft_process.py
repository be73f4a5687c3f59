"""The two processes of a flight, each with a fake of the other end."""

from __future__ import annotations

import asyncio
import os
import socket
import stat
import struct
import subprocess
import threading
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path

import pytest

from missions.errors import AircraftError, LinkError
from missions.events import Event, LinkLost, Recalled
from missions.orders import Hold
from tests.support.field import mission_of
from tests.support.running import by, in_real_time
from uavmap.aircraft.guardian.last_watch import run_with_keeper
from uavmap.aircraft.imaging.classifier import PictureJudge
from uavmap.aircraft.process import messages as msg
from uavmap.aircraft.process.host import Host
from uavmap.aircraft.process.port import Port
from uavmap.aircraft.reporter import Report
from uavmap.base.atomic_write import write_text
from uavmap.base.clock import MissionClock
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL, FlightOptions, FlightPlan
from uavmap.runner import aircraft_process, aircraft_takeover
from uavmap.runner.aircraft_child import END_REQUESTED, AircraftChild
from uavmap.runner.aircraft_process import AircraftProcess
from uavmap.runner.aircraft_side import AircraftSide
from uavmap.runner.aircraft_takeover import ADDRESS, RECORD, Address, Attachment, take_over_aircraft

BEGIN = msg.Begin(0.0, {}, None, False, False)
FIRST, SECOND = LinkLost(1, 1.0), LinkLost(1, 2.0)


def plan() -> FlightPlan:
    options = FlightOptions(mission_source="small", urls=("udpin://127.0.0.1:14550",))
    return FlightPlan.make(options, mission_of("ardupilot"), 0.0)


class Mission:
    """A port, and all that it has posted."""

    def __init__(self) -> None:
        self.posted: asyncio.Queue[Event] = asyncio.Queue()
        self.sent: list[msg.Message] = []
        self.port = Port(
            (1,), lambda: 0.0, PictureJudge({}), self.posted.put_nowait, self.posted.join,
            self._swap, self._ask,
        )  # fmt: skip
        self.port.connect(self.sent.append)

    def accept_reports(self) -> list[Event]:
        """Accept the posted reports, as the service does."""
        found = []
        while not self.posted.empty():
            found.append(self.posted.get_nowait())
            self.posted.task_done()
        return found

    async def _swap(self, vehicle: int) -> None:
        raise AssertionError

    async def _ask(self, question: str) -> bool | None:
        raise AssertionError


@contextmanager
def listening() -> Iterator[tuple[socket.socket, Address]]:
    """Open a socket that accepts, and an address of it."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server, Address(server.getsockname()[1], "word", 0.0, os.getpid())


@contextmanager
def running_process(folder: Path) -> Iterator[tuple[AircraftProcess, socket.socket, socket.socket]]:
    """Find a process of the aircraft as the mission does; yield it, the other end, and its
    listener.
    """
    with listening() as (server, address):
        line = socket.create_connection(("127.0.0.1", address.port))
        other, _ = server.accept()
        with other:
            attachment = Attachment(address, line)
            yield AircraftProcess(plan(), folder, attachment, append=False), other, server


@pytest.mark.parametrize("reset", [False, True])
@by(in_real_time)
async def test_aircraft_that_cannot_restart_end_the_mission(*, reset, tmp_path, monkeypatch):
    starts = []

    def start(self: AircraftProcess) -> Attachment:
        starts.append(self)
        raise LinkError("it does not start")

    monkeypatch.setattr(AircraftProcess, "_begin", start)
    monkeypatch.setattr(AircraftProcess, "_end_process", lambda self: None)
    with running_process(tmp_path) as (process, other, server):
        server.close()
        port = Mission().port
        port.receive(msg.Beat(fates={1: "left to its autopilot in GUIDED at here", 2: ""}))
        async with asyncio.timeout(20.0), process.connected(port, lambda: BEGIN):
            if reset:  # as of a process that was killed with unread input
                other.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            other.close()
            with pytest.raises(AircraftError) as ended:
                await run_with_keeper(port, asyncio.Event().wait(), leave=True)
    assert len(starts) == aircraft_process.STARTS
    cause, fate = str(ended.value).splitlines()
    assert cause == "it does not start"
    assert fate.startswith("vehicle 1: left to its autopilot in GUIDED at here; this was its last")
    assert "take it by radio control" in fate


@by(in_real_time)
async def test_process_without_a_waiting_mission_is_ended(tmp_path, monkeypatch):
    connecting, ended = asyncio.Event(), asyncio.Event()

    async def hangs(**_: object) -> None:
        connecting.set()
        await asyncio.Event().wait()

    monkeypatch.setattr(asyncio, "open_connection", hangs)
    with listening() as (_, address), socket.create_connection(("127.0.0.1", address.port)) as line:
        monkeypatch.setattr(AircraftProcess, "_begin", lambda self: Attachment(address, line))
        monkeypatch.setattr(AircraftProcess, "_end_process", lambda self: ended.set())
        process = AircraftProcess(plan(), tmp_path, None, append=False)
        starting = asyncio.create_task(process._start())
        await connecting.wait()
        starting.cancel()
        await asyncio.wait([starting])
    assert ended.is_set()


@by(in_real_time)
async def test_third_control_c_still_reports_the_state_of_the_aircraft(tmp_path, monkeypatch):
    waiting, over = asyncio.Event(), threading.Event()
    loop = asyncio.get_running_loop()

    def ends_slowly(self: AircraftProcess) -> None:
        loop.call_soon_threadsafe(waiting.set)
        over.wait()

    monkeypatch.setattr(AircraftProcess, "_end", ends_slowly)
    with running_process(tmp_path) as (process, _, _):

        async def left_at_once() -> None:
            async with process.connected(Mission().port, lambda: BEGIN):
                await asyncio.sleep(0)
                raise AircraftError("vehicle 1: left to its autopilot in RTL")

        flight = asyncio.create_task(left_at_once())
        await waiting.wait()
        flight.cancel()
        with pytest.raises(AircraftError, match="left to its autopilot"):
            await flight
        over.set()


@pytest.mark.parametrize("state", ["returning", "refused"])
@by(in_real_time)
async def test_aircraft_that_another_process_brings_home_are_not_reported_as_left(state, tmp_path):
    with running_process(tmp_path) as (process, other, server):
        port = Mission().port
        port.receive(msg.Beat(fates={1: "left to its autopilot in GUIDED at here"}))
        async with asyncio.timeout(20.0), process.connected(port, lambda: BEGIN):
            other.close()
            answering, _ = await asyncio.to_thread(server.accept)
            answering.sendall(msg.encode(msg.Attached(state, "they are in good hands")))
            with pytest.raises(LinkError, match="they are in good hands"):
                await run_with_keeper(port, asyncio.Event().wait(), leave=True)
        answering.close()


@by(in_real_time)
async def test_aircraft_that_send_no_message_end_the_mission_with_a_line(tmp_path, monkeypatch):
    monkeypatch.setattr(AircraftProcess, "_end_process", lambda self: None)
    with running_process(tmp_path) as (process, other, _):
        port = Mission().port
        async with asyncio.timeout(20.0), process.connected(port, lambda: BEGIN):
            other.sendall(b"\xff" * 8)
            with pytest.raises(LinkError, match="do not understand each other: a message of 8"):
                await port.run()


@by(in_real_time)
async def test_last_message_is_sent_to_the_next_process_as_well():
    mission = Mission()
    mission.port.receive(msg.Ready(None))
    mission.port.fly(0.0)
    home = asyncio.create_task(mission.port.bring_home("the mission is over"))
    await asyncio.sleep(0)
    mission.port.report_loss()
    mission.sent.clear()
    mission.port.receive(msg.Ready(None))
    assert mission.sent == [msg.Fly(0.0), msg.Finish("the mission is over")]
    mission.port.receive(msg.Ended({}))
    await home


@by(in_real_time)
async def test_end_that_the_mission_has_not_asked_for_ends_it():
    port = Mission().port
    port.receive(msg.Ended({}))
    with pytest.raises(LinkError, match="asked to end, before the mission has"):
        async with asyncio.timeout(1.0):
            await port.run()


@by(in_real_time)
async def test_aircraft_know_the_events_in_the_journal():
    mission = Mission()
    mission.port.receive(msg.EventReport(FIRST, 1))
    await asyncio.sleep(0.01)
    assert mission.port.kept == 0
    mission.port.receive(msg.EventReport(FIRST, 1))  # from the record, after a stall
    mission.port.receive(msg.EventReport(SECOND, 2))
    assert mission.accept_reports() == [FIRST, SECOND]
    await asyncio.sleep(0.01)
    assert mission.port.kept == 2
    mission.port.report_loss()
    mission.accept_reports()
    mission.port.receive(msg.EventReport(FIRST, 1))  # another process counts from the beginning
    assert mission.accept_reports() == [FIRST]


class Falling:
    """A vehicle whose driver has a defect."""

    async def run(self, report: Report) -> None:
        raise ValueError("a defect")

    def give(self, order: object) -> None:
        raise RuntimeError("a vehicle takes orders only while it runs")

    def land_here(self, reason: str) -> bool:
        raise AssertionError

    def report_again(self) -> None:
        raise AssertionError


@by(in_real_time)
async def test_defect_gives_the_vehicles_to_the_guardians():
    host = Host(lambda message: None)
    host.receive(BEGIN)
    host.receive(msg.Fly(0.0))
    await host.fly({1: Falling()}, msg.Ready(None))
    with pytest.raises(ExceptionGroup):
        await host.carry_out()
    assert host.state == "returning"
    host.receive(msg.GiveOrder(1, Hold()))
    host.receive(msg.Fly(0.0))
    host.hold()


@asynccontextmanager
async def connected(child: AircraftChild, token: str) -> AsyncIterator[asyncio.StreamWriter]:
    """Connect a mission to a process of the aircraft."""
    server = await asyncio.start_server(child._serve, "127.0.0.1", 0)
    reader, writer = await asyncio.open_connection(*server.sockets[0].getsockname())
    writer.write(msg.encode(msg.Attach(msg.VERSION, token)))
    await reader.read(1)
    yield writer
    writer.close()
    await asyncio.sleep(0.1)
    server.close()


@by(in_real_time)
async def test_events_that_a_dead_mission_did_not_keep_are_recorded(tmp_path):
    child = AircraftChild(plan(), tmp_path, 0.0, append=False)
    async with connected(child, child._token) as writer:
        child._send(msg.EventReport(FIRST, 1))
        child._send(msg.EventReport(SECOND, 2))
        writer.write(msg.encode(msg.Beat(kept=1)))
        await asyncio.sleep(0.1)
    found = list(msg.Decoder().feed((tmp_path / RECORD).read_bytes()))
    assert found == [msg.EventReport(SECOND, 2)]


@pytest.mark.parametrize("kept", [False, True])
@by(in_real_time)
async def test_events_that_a_mission_dying_late_did_not_keep_are_recorded(*, kept, tmp_path):
    child = AircraftChild(plan(), tmp_path, 0.0, append=False)
    async with connected(child, child._token) as writer:
        child._send(msg.EventReport(FIRST, 1))
        child._send(msg.Ended({}))
        closing = asyncio.create_task(child._close())
        await asyncio.sleep(0)
        assert not closing.done()
        if kept:
            writer.write(msg.encode(msg.Beat(kept=1)))
    await closing
    assert (tmp_path / RECORD).exists() is not kept


class Flying(Falling):
    """A vehicle that accepts orders."""

    def give(self, order: object) -> None:
        pass


@by(in_real_time)
async def test_aircraft_that_are_asked_to_end_have_the_mission_call_all_home(tmp_path, monkeypatch):
    made = plan()
    child = AircraftChild(made, tmp_path, 0.0, append=False)
    mission = Mission()
    async with connected(child, child._token):
        monkeypatch.setattr(child, "_send", mission.port.receive)
        clock = MissionClock(0.0)
        side = AircraftSide(made, made.known_setting(), tmp_path, (), clock, child._send)
        monkeypatch.setattr(child, "_side", side)
        side.host.receive(BEGIN)
        side.host.receive(msg.Fly(0.0))
        await side.host.fly({1: Flying()}, msg.Ready(None))
        child._stop()
        assert mission.accept_reports() == [Recalled(0.0)]
        assert not side.host.end.done()
        child._stop()
    assert mission.accept_reports() == []
    assert side.host.end.result() == msg.Finish(END_REQUESTED)


@by(in_real_time)
async def test_aircraft_send_signs_of_life_before_their_links_are_open(tmp_path, monkeypatch):
    child = AircraftChild(plan(), tmp_path, 0.0, append=False)
    sent: list[msg.Message] = []
    async with connected(child, child._token):
        monkeypatch.setattr(child, "_send", sent.append)
        watching = asyncio.create_task(child._watch())
        await asyncio.sleep(1.5 * aircraft_process.BEAT_WALL_S)
        watching.cancel()
    assert sent == [msg.Beat()]


def test_record_is_added_to_the_journal_once(tmp_path):
    with Journal.create(tmp_path / JOURNAL, {"plan": plan().as_json()}) as journal:
        journal.append(FIRST)
        record = msg.encode(msg.EventReport(FIRST, 1)) + msg.encode(msg.EventReport(SECOND, 2))
        (tmp_path / RECORD).write_bytes(record)
        assert take_over_aircraft(tmp_path, journal) is None
        assert list(journal.events()) == [FIRST, SECOND]


@pytest.mark.parametrize("lives", [False, True])
def test_silent_process_is_not_joined_by_a_second(*, lives, tmp_path, monkeypatch):
    monkeypatch.setattr(aircraft_takeover, "ATTACH_WALL_S", 0.2)
    with (
        listening() as (_, address),
        Journal.create(tmp_path / JOURNAL, {"plan": plan().as_json()}) as journal,
    ):
        if not lives:
            with subprocess.Popen(["true"]) as process:
                pass
            address = Address(address.port, address.token, 0.0, process.pid)
        write_text(tmp_path / ADDRESS, address.as_json(), private=True)
        assert stat.S_IMODE((tmp_path / ADDRESS).stat().st_mode) == 0o600
        if lives:
            with pytest.raises(LinkError, match="does not answer"):
                take_over_aircraft(tmp_path, journal)
            assert (tmp_path / ADDRESS).exists()
        else:
            assert take_over_aircraft(tmp_path, journal) is None
            assert not (tmp_path / ADDRESS).exists()
