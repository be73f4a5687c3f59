"""Conversion between heights above the ground and heights above home, as bytes, both ways."""

import asyncio

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.events import Airborne, Arrived, Crashed, Landed
from missions.flight.setting_of import setting_of
from missions.geo.terrain import FOLLOW_M
from missions.geo.trajectory import rounded_path
from missions.orders import FlyPath, FlyTo, TakeOff
from missions.units import GridPoint
from tests.support.flights import fly, small_mission
from tests.support.ground.hills import over, slope
from tests.support.running import by
from uavmap.mavlink.autopilots import ARDUPILOT, PX4
from uavmap.runner.preflight.autopilot_fence import VehicleFence

UP_M = 14.0
FAR = GridPoint(0.0, 45.0)
both = pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])


def sloped(autopilot, percent, **how):
    made = over(small_mission(autopilot=autopilot, altitude_m=UP_M, **how), slope(percent, 0.0))
    return made.model_copy(update={"sim": made.sim.model_copy(update={"gps_sigma_m": 0.0})})


def wire_heights_m(flight):
    """Return the heights above home of all targets and setpoints that were sent."""
    found = []
    for _, message in flight.sent:
        kind = message.get_type()
        if kind == "COMMAND_INT" and message.command == mav.MAV_CMD_DO_REPOSITION:
            amsl = message.frame in (mav.MAV_FRAME_GLOBAL, mav.MAV_FRAME_GLOBAL_INT)
            found.append(message.z - (flight.session.view.home_amsl_m if amsl else 0.0))
        elif kind == "SET_POSITION_TARGET_GLOBAL_INT" and not message.type_mask & 0x7:
            amsl = message.coordinate_frame in (0, 5)
            found.append(message.alt - (flight.session.view.home_amsl_m if amsl else 0.0))
    return found


@pytest.mark.parametrize(
    ("autopilot", "percent"), [("ardupilot", 20.0), ("px4", 20.0), ("px4", -20.0)]
)
@by(fly, lambda autopilot, percent: sloped(autopilot, percent, speed_m_s=5.0))
async def test_leg_follows_the_ground_up_and_down(flight, /, autopilot, percent):
    heights = []
    await flight.after(TakeOff(UP_M), Airborne)
    flight.driver.give(FlyTo((FAR,), None, stop=True, height_m=UP_M))
    while not flight.seen(Arrived):
        heights.append(flight.vehicle.truth.height_m)
        await asyncio.sleep(0.1)
    assert flight.driver.view.height_m == pytest.approx(UP_M, abs=1.0)
    assert flight.driver.land_here("a test")
    await flight.sees(Landed)
    assert min(heights) >= UP_M - FOLLOW_M
    assert max(heights) <= UP_M + FOLLOW_M + 0.5
    assert not flight.seen(Crashed)
    assert not flight.vehicle.truth.crashed
    told = wire_heights_m(flight)
    # a PX4 corrects the height of its home in flight
    assert told[-1] == pytest.approx(UP_M + percent / 100.0 * FAR.north_m, abs=0.5)
    assert len(told) > 5


@both
@by(fly, lambda autopilot: sloped(autopilot, 20.0, speed_m_s=5.0))
async def test_setpoints_carry_height_and_climb(flight, /, autopilot):
    heights = []
    await flight.after(TakeOff(UP_M), Airborne)
    plan = rounded_path([GridPoint(0, 0), FAR], flight.now_s() + 1.0, speed_m_s=5.0)
    flight.driver.give(FlyPath(plan, UP_M, 0.0, 0.5))
    while not flight.seen(Arrived):
        heights.append(flight.vehicle.truth.height_m)
        await asyncio.sleep(0.1)
    assert min(heights) >= UP_M - FOLLOW_M
    assert max(heights) <= UP_M + FOLLOW_M
    told = wire_heights_m(flight)
    assert max(told) == pytest.approx(UP_M + 9.0, abs=0.3)
    climbs = [m.vz for _, m in flight.sent if m.get_type() == "SET_POSITION_TARGET_GLOBAL_INT"]
    assert min(climbs) == pytest.approx(-1.0, abs=0.05)  # 5 m/s on 20 %, and down is positive


@pytest.mark.parametrize(
    ("kind", "name", "unit"), [(ARDUPILOT, "RTL_ALT", 100.0), (PX4, "RTL_RETURN_ALT", 1.0)]
)
def test_return_heights_and_ceilings_clear_the_highest_ground(kind, name, unit):
    setting = setting_of(sloped("ardupilot", 20.0, speed_m_s=5.0))
    home = setting.mission.home
    highest_m = setting.mission.highest_ground_m
    assert highest_m == pytest.approx(14.4)  # 70 m north of the start, and the rest of a mesh
    fence = VehicleFence(setting, 1, home, kind, {name: 15.0 * unit})
    plan = fence.plan()
    assert plan.parameters[name] == pytest.approx((highest_m + UP_M) * unit)
    assert fence.return_height_m() == pytest.approx(highest_m + UP_M)
    ceiling = "GF_MAX_VER_DIST" if kind is PX4 else "FENCE_ALT_MAX"
    assert plan.parameters[ceiling] >= highest_m + UP_M + 9.0
    # a home on higher ground needs less above itself
    north = setting.grid.position(GridPoint(0.0, 20.0))
    above_it = VehicleFence(setting, 1, north, kind, {}).plan().parameters[name]
    assert above_it == pytest.approx((highest_m + UP_M - 4.0) * unit, abs=0.05 * unit)
    assert fence.faults(()) == [f"{name} = {15 * unit:g} does not clear the ground: 17 m needed"]
    assert VehicleFence(setting, 1, home, kind, {name: 20.0 * unit}).faults(()) == []
