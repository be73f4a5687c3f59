"""Lines for the operator while the service waits for a vehicle, or if it flies at another speed."""

from __future__ import annotations

import asyncio

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import LinkError
from missions.events import Airborne, Arrived, BatterySwapped, OrderFailed
from missions.mission.schema import Mission
from missions.orders import AwaitBattery, FlyTo, TakeOff
from missions.units import GridPoint
from tests.support.flights import Flight, fly, small_mission
from tests.support.running import by, on_virtual_time
from tests.support.small_missions import mission, square
from uavmap.base.clock import ClockRate
from uavmap.mavlink.vehicle_view import VehicleView

UP_M = 12.0


@by(fly)
async def test_reasons_of_the_arming_checks_are_shown_as_they_come(flight, /):
    message = mav.MAVLink_param_set_message(1, 1, b"BATT_ARM_VOLT", 99.0, 9)
    flight.vehicle.receive(message.pack(mav.MAVLink(None, 255, 190)))
    await flight.after(TakeOff(UP_M), OrderFailed, within_s=150.0)
    told = flight.lines
    reason = "[vehicle 1, critical] PreArm: Battery 1 below minimum arming voltage"
    assert told.count(reason) >= 1


@by(on_virtual_time)
async def test_wait_for_a_position_is_shown():
    flight = Flight(small_mission())
    flight.to_driver = lambda message: message.get_type() != "GLOBAL_POSITION_INT"
    async with asyncio.TaskGroup() as tasks:
        world = tasks.create_task(flight.fly_world())
        with pytest.raises(LinkError, match="did not report its position"):
            await flight.driver.connect()
        world.cancel()
    waits = [line for line in flight.lines if "waits for its position, for " in line]
    assert len(waits) >= 4


@by(fly)
async def test_wait_for_the_arming_checks_is_shown(flight, /):
    flight.vehicle.fail.gps(for_s=40.0)
    await asyncio.sleep(10.0)
    assert not flight.session.view.ready_to_arm
    await flight.after(TakeOff(UP_M), Airborne)
    told = flight.lines
    assert "[vehicle 1, critical] PreArm: GPS 1: Bad fix" in told
    assert "sim: waits for the checks before arming, in STABILIZE, for 10 s by now" in told


@by(fly)
async def test_enter_without_a_new_battery_is_answered(flight, /, monkeypatch):
    monkeypatch.setattr(VehicleView, "is_simulator", False)
    flight.session.view.battery_percent = 41
    flight.to_driver = lambda m: m.get_type() not in ("BATTERY_STATUS", "SYS_STATUS")
    flight.driver.give(AwaitBattery())
    await asyncio.sleep(45.0)
    flight.to_driver = lambda message: True
    await flight.sees(BatterySwapped)
    waits = [line for line in flight.service_lines if "waits for a fresh battery" in line]
    assert [line.partition("(")[2].partition(")")[0] for line in waits] == [
        "42% reported, 90% wanted",
        "no charge reported, 90% wanted",
    ]


def long_mission() -> Mission:
    made = mission(square(-4, 10, 160, 16), square(-40, -40, 260, 110))
    return made.model_copy(update={"flight": made.flight.model_copy(update={"speed_m_s": 4.0})})


@by(fly, long_mission)
async def test_speed_changed_by_another_is_restored_and_reported(flight, /):
    await flight.after(TakeOff(UP_M), Airborne)
    view = flight.session.view
    flight.driver.give(FlyTo((GridPoint(180.0, 0.0),), None, stop=True, height_m=UP_M))
    await flight.until(lambda: view.ground_speed_m_s > 3.5)
    flight.pilot(mav.MAV_CMD_DO_CHANGE_SPEED, 1, 1.5, -1)
    await flight.until(lambda: any("instead of the 4 m/s" in line for line in flight.lines))
    await flight.until(lambda: view.ground_speed_m_s > 3.5, within_s=20.0)
    await flight.sees(Arrived)
    assert sum("the speed is sent again" in line for line in flight.lines) == 1


@by(fly, long_mission)
async def test_ordered_speed_is_not_reported(flight, /):
    await flight.after(TakeOff(UP_M), Airborne)
    there = FlyTo((GridPoint(180.0, 0.0),), None, stop=True, height_m=UP_M)
    await flight.after(there, Arrived)
    assert flight.service_lines == []


@by(fly)
async def test_clock_that_runs_fast_is_reported(flight, /):
    flight.driver._clock_rate = ClockRate(10.0, 0.2)
    await asyncio.sleep(30.0)
    assert not [line for line in flight.lines if "speedup" in line]
    vehicle, step = flight.vehicle, flight.vehicle.step
    flight.vehicle = _Faster(vehicle, step)
    await asyncio.sleep(30.0)
    assert [line for line in flight.lines if "vehicle 1: its clock runs 3.0 times" in line]


class _Faster:
    """A vehicle whose time passes three times as fast."""

    def __init__(self, vehicle: object, step: object) -> None:
        self._vehicle, self._step = vehicle, step

    def step(self, dt_s: float) -> bytes:
        return b"".join(self._step(dt_s) for _ in range(3))

    def __getattr__(self, name: str) -> object:
        return getattr(self._vehicle, name)
