"""Whole flights over links that lose, delay and double."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import LinkError
from missions.events import Airborne, Guarded, LinkLost, OrderFailed
from missions.orders import FlyTo, Hold, TakeOff
from missions.units import GridPoint
from tests.benchmarks.watched import WatchedFlight, fly_watched, mission_text
from tests.support.flights import Flight, fly, small_mission, under_way
from tests.support.running import by, on_virtual_time
from uavmap.aircraft.guardian.last_watch import Guardians, run_with_keeper

UP_M = 12.0
FORBIDDEN = frozenset({"air", "lie", "unrep", "end", "tb", "reserve", "breach"})


def flown_with_loss(loss: float, seed: int) -> WatchedFlight:
    """Fly over a link that loses a share of all frames, in both directions."""
    fault = {"kind": "link", "at_s": 0.0, "loss": loss}
    return fly_watched(f"loss {loss} seed {seed}", mission_text("speck", [fault]), seed)


def test_mission_with_a_fifth_of_all_frames_lost_is_complete():
    flight = flown_with_loss(0.2, 2)
    assert flight.code == 0, flight.line()
    assert not flight.columns & FORBIDDEN


def test_mission_with_most_frames_lost_leaves_no_vehicle_in_the_air():
    flight = flown_with_loss(0.6, 4)
    assert flight.kinds["lifted_off"] >= 1, flight.line()
    assert flight.referee.in_the_air == [], flight.line()
    assert flight.code in (0, 3)


def test_vehicle_that_cannot_connect_is_reported_with_the_reason():
    flight = flown_with_loss(0.8, 1)
    assert flight.code == 2, flight.line()
    assert "the link loses too much" in flight.stderr


def commands(flight: Flight, number: int) -> list[Any]:
    return [m for _, m in flight.sent if getattr(m, "command", None) == number]


@by(on_virtual_time)
async def test_stream_that_does_not_come_is_requested_again():
    wanted = mav.MAVLINK_MSG_ID_SYS_STATUS

    def dropped(message: Any) -> bool:
        return getattr(message, "command", None) == mav.MAV_CMD_SET_MESSAGE_INTERVAL and (
            message.param1 == wanted
        )

    flight = Flight(small_mission())
    # it never reaches the vehicle, and yet it is acknowledged
    real = flight.session.send
    flight.session.send = lambda m: _doubled(flight, m) if dropped(m) else real(m)
    async with under_way(flight):
        flight.session.send = real
        received_s = flight.session.received_s.get(wanted, 0.0)
        assert not flight.session.view.prearm_ok
        await flight.until(lambda: flight.session.view.prearm_ok, within_s=40.0)
        assert flight.session.received_s[wanted] > received_s


def _doubled(flight: Flight, message: Any) -> None:
    """Repeat the acknowledgement of the request before, and lose this request."""
    ack = mav.MAVLink_command_ack_message(message.command, 0)
    frame = ack.pack(mav.MAVLink(None, srcSystem=1, srcComponent=1))
    asyncio.get_running_loop().call_soon(flight.session.feed, frame)


@by(fly)
async def test_streams_that_still_come_after_a_gap_are_not_requested(flight, /):
    await flight.after(TakeOff(UP_M), Airborne)
    asked = len(commands(flight, mav.MAV_CMD_SET_MESSAGE_INTERVAL))
    flight.to_driver = lambda message: False
    await flight.sees(LinkLost)
    flight.to_driver = lambda message: True
    await flight.until(lambda: len(flight.events) > 0 and flight.driver._monitor.connected)
    await asyncio.sleep(5.0)
    assert flight.driver._monitor.connected
    assert len(commands(flight, mav.MAV_CMD_SET_MESSAGE_INTERVAL)) == asked


@by(fly)
async def test_hold_acknowledged_by_an_older_ack_is_requested_again(flight, /):
    await flight.after(TakeOff(UP_M), Airborne)
    flight.driver.give(FlyTo((GridPoint(45.0, 30.0),), None, stop=False, height_m=UP_M))
    await asyncio.sleep(6.0)
    swallowed: list[Any] = []

    def swallow(message: Any) -> bool:
        if getattr(message, "command", None) != mav.MAV_CMD_DO_REPOSITION or swallowed:
            return True
        swallowed.append(message)
        _doubled(flight, message)
        return False

    flight.to_vehicle = swallow
    flight.driver.give(Hold())
    await asyncio.sleep(15.0)
    assert swallowed
    assert flight.session.view.ground_speed_m_s < 0.5
    here = flight.setting.grid.fixed(flight.vehicle.truth.position)
    assert here.distance_to(GridPoint(45.0, 30.0)) > 10.0
    assert not flight.seen(OrderFailed)


@by(fly)
async def test_late_frames_are_no_vehicle_blown_off_course(flight, /):
    flight.vehicle.fail.link(jitter_s=2.0)
    await flight.after(TakeOff(UP_M), Airborne, within_s=200.0)
    for goal in (GridPoint(45.0, 30.0), GridPoint(0.0, 10.0), GridPoint(45.0, 0.0)):
        flight.driver.give(FlyTo((goal,), None, stop=False, height_m=UP_M))
        await asyncio.sleep(7.0)
        flight.driver.give(Hold())
        await asyncio.sleep(20.0)
    assert not flight.seen(OrderFailed)
    assert not flight.seen(Guarded)


@by(on_virtual_time)
async def test_vehicle_left_in_the_air_is_brought_home_if_the_connection_fails():
    flight = Flight(small_mission())
    async with under_way(flight):
        await flight.after(TakeOff(UP_M), Airborne)
    # another process took it up there and died; this is the next one
    again = Flight(small_mission())
    again.vehicle = flight.vehicle
    again.driver.resume_flying()
    async with asyncio.TaskGroup() as tasks:
        world = tasks.create_task(again.fly_world())

        async def connect() -> None:
            await again.driver.connect()
            raise LinkError("vehicle 2: no vehicle answered")

        with pytest.raises(LinkError, match="vehicle 2"):
            await run_with_keeper(Guardians({1: again.driver.guardian}), connect(), leave=True)
        world.cancel()
    assert flight.vehicle.truth.landed
    assert again.service_lines == [
        "vehicle 1: the mission failed (vehicle 2: no vehicle answered); it is commanded to "
        "return (RTL)"
    ]
