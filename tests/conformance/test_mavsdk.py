from __future__ import annotations

import asyncio
import contextlib
import os
import signal
from collections import Counter

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import LinkError
from missions.events import Airborne, Arrived, Connected, Landed, OrderFailed
from missions.orders import Land, TakeOff
from tests.conformance.rig import by_each_driver, fly
from tests.conformance.test_drivers import take_over_while_it_waits
from tests.support.flights import UP_M, to
from uavmap.base.clock import ScaledClock, run
from uavmap.mavlink.mavsdk.driver_process import MavsdkProcess
from uavmap.mavlink.mavsdk.mavsdk_session import MavsdkSession


@by_each_driver(drivers=("mavsdk",))
async def test_both_decoders_read_the_same(flight, autopilot):
    logged = []
    read = []
    session = flight.session
    session.listen(read.append)
    session._record = logged.append
    await flight.after(TakeOff(UP_M), Airborne)
    await flight.after(to(6.0, 0.0), Arrived)
    await flight.after(Land(), Landed)
    wire = [m for m in mav.MAVLink(None).parse_buffer(b"".join(logged)) if m.get_srcSystem() == 1]
    ours, others = between(wire, read)
    assert [str(message) for message in others] == [str(message) for message in ours]
    kinds = Counter(message.get_type() for message in others)
    for kind in ("HEARTBEAT", "GLOBAL_POSITION_INT", "SYS_STATUS", "ATTITUDE", "COMMAND_ACK"):
        assert kinds[kind] > 2


def between(wire, read):
    """Keep positions between the first and the last that both have: some are on the way."""
    common = {str(message) for message in wire} & {str(message) for message in read}

    def is_mark(message):
        return message.get_type() == "GLOBAL_POSITION_INT" and str(message) in common

    marks = [[index for index, m in enumerate(all_) if is_mark(m)] for all_ in (wire, read)]
    (a, b), (c, d) = ((found[0], found[-1]) for found in marks)
    return wire[a:b], read[c:d]


@by_each_driver(drivers=("mavsdk",))
async def test_repeats_by_mavsdk_of_a_dead_order_do_not_leave_this_machine(flight, autopilot):
    await take_over_while_it_waits(flight, autopilot)
    outbox = flight.session.outbox
    await flight.until(lambda: outbox.held_back["COMMAND_INT"] > 0)
    # no heartbeat but the guardian's: they would go on when it does not
    assert outbox.held_back["HEARTBEAT"] > 0
    beats = [m for _, m in flight.sent if m.get_type() == "HEARTBEAT"]
    assert mav.MAV_TYPE_GENERIC not in {m.type for m in beats}  # MAVSDK's own numbers


@pytest.mark.parametrize("blow", [signal.SIGKILL, signal.SIGSTOP], ids=["dies", "hangs"])
def test_a_mavsdk_that_fails_in_flight_is_started_again(blow):
    async def body(flight):
        process = flight.session.process
        await flight.after(TakeOff(UP_M), Airborne)
        flight.driver.give(to(20.0, 0.0))
        first = process.pid
        assert first is not None
        os.kill(first, blow)
        await flight.until(lambda: process.starts == 2, within_s=400.0)
        arrived = await flight.sees(Arrived, within_s=400.0)
        assert arrived.position.east_m == pytest.approx(20.0, abs=1.0)
        assert not _lives(first)

    flight = fly(body, "mavsdk", "ardupilot")
    assert [text for text in flight.messages if "is started again" in text]
    assert not flight.seen(OrderFailed)
    assert all(connected.ours for connected in flight.seen(Connected)[1:])


def _lives(pid):
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, 0)
        return True
    return False


def _nothing(_):
    pass


@pytest.mark.parametrize(
    ("source", "why"),
    [
        ("raise ImportError('libcmavsdk.so: wrong ELF class')", "wrong ELF class"),
        ("import os; os._exit(3)", "exit code 3"),
        ("print('hello'); import os; os.write(1, b'x' * 99); os._exit(0)", "an invalid piece"),
    ],
)
def test_mavsdk_that_does_not_start_is_reported_with_the_remedy(source, why, tmp_path, monkeypatch):
    package = tmp_path / "mavsdk"
    package.mkdir()
    (package / "__init__.py").write_text(source, "utf-8")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.getcwd()]))

    async def main():
        process = MavsdkProcess(245, 191, _nothing, _nothing, _nothing)
        with pytest.raises(LinkError, match="MAVSDK does not start") as raised:
            await process.start()
        assert why in str(raised.value)
        assert "--driver pymavlink" in str(raised.value)
        assert process.pid is None

    run(main(), ScaledClock())


def test_request_to_an_ended_mavsdk_is_a_lost_link():
    async def main():
        process = MavsdkProcess(245, 191, _nothing, _nothing, _nothing)
        await process.start()
        assert (await process.ask(do="arm"))["result"] == "NO_SYSTEM"
        waiting = asyncio.create_task(process.ask(do="arm"))
        _fail(process.pid)
        with contextlib.suppress(LinkError):
            await waiting
        await process.close()
        with pytest.raises(LinkError, match="MAVSDK does not run"):
            await process.ask(do="arm")

    run(main(), ScaledClock())


def _fail(pid):
    assert pid is not None
    os.kill(pid, signal.SIGKILL)


def test_session_receives_no_vehicle_before_mavsdk_does():
    """Other bytes than MAVLink, and messages that MAVSDK cannot have read, change nothing."""
    reported = []
    sent = []
    session = MavsdkSession(sent.append, lambda frame: None, say=reported.append)
    take = session._receive_object

    async def main():
        assert session.feed(b"\xfd\x00garbage" * 9) is False
        for fields in ({}, {"autopilot": None}, {"autopilot": [1]}, {"type": "x"}):
            take({"name": "HEARTBEAT", "system": 1, "component": 1, "fields": fields})
        take({"name": "NO_SUCH_MESSAGE", "system": 1, "component": 1, "fields": {}})
        session.heartbeat()

    run(main(), ScaledClock())
    assert session.view.autopilot != mav.MAV_AUTOPILOT_PX4
    assert len(sent) == 1
    assert reported == []
