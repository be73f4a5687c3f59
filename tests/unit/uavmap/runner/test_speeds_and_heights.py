"""Both autopilots fly the mission's speeds within 5 %, and its heights by the sea.

A real ArduCopter flew 10 m/s at any order: the speed was sent before the target, which resets it. A
real PX4 corrects the height of its home in flight: its reported heights above home leap.
"""

import asyncio
import itertools
import math
import statistics

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.events import Airborne, Arrived, Overridden, Released
from missions.orders import TakeOff
from sitl.px4.modes import Px4Mode
from tests.support.flights import UP_M, fly, small_mission, to
from tests.support.running import by

BOTH = ("ardupilot", "px4")
WEST, EAST = -30.0, 50.0
LOITER, GUIDED = 5, 4


def on(autopilot, **how):
    return small_mission(autopilot=autopilot, capacity_wh=60.0, **how)


async def speed_of(flight, order):
    """Return the true speed in the middle of a leg: the median of its fastest half."""
    speeds = []
    arrived = len(flight.seen(Arrived))
    flight.driver.give(order)
    async with asyncio.timeout(200.0):
        while len(flight.seen(Arrived)) == arrived:
            await asyncio.sleep(0.1)
            speeds.append(math.hypot(*flight.vehicle.truth.velocity_m_s[:2]))
    speeds.sort()
    return statistics.median(speeds[len(speeds) // 2 :])


@pytest.mark.parametrize("autopilot", BOTH)
@pytest.mark.parametrize("speed_m_s", [1.0, 3.0, 6.0, 10.0])
@by(fly, lambda autopilot, speed_m_s: on(autopilot, speed_m_s=speed_m_s))
async def test_speed_of_the_mission_is_flown_within_5_percent(flight, /, autopilot, speed_m_s):
    await flight.after(TakeOff(UP_M), Airborne)
    await flight.after(to(WEST), Arrived)
    leg = to(EAST if speed_m_s > 3.0 else 0.0)
    assert await speed_of(flight, leg) == pytest.approx(speed_m_s, rel=0.05)


@pytest.mark.parametrize("autopilot", BOTH)
@by(fly, lambda autopilot: on(autopilot, speed_m_s=3.0))
async def test_vehicle_given_back_by_its_pilot_gets_the_speed_again(flight, /, autopilot):
    await flight.after(TakeOff(UP_M), Airborne)
    await flight.after(to(WEST), Arrived)
    modes = {"ardupilot": ((1, LOITER), (1, GUIDED)), "px4": ((1, 4, 5), (1, 4, 3))}
    for mode, kind in zip(modes[autopilot], (Overridden, Released), strict=True):
        flight.pilot(mav.MAV_CMD_DO_SET_MODE, *mode)
        await flight.sees(kind, within_s=2.0)
    assert await speed_of(flight, to(10.0)) == pytest.approx(3.0, rel=0.05)


@by(fly, lambda: on("px4"))
async def test_px4_flies_at_its_height_although_its_home_moves(flight, /):
    told_m, homes_m, true_m = [], [], []

    def listen(message):
        if message.get_type() == "GLOBAL_POSITION_INT" and told_m is not None:
            homes_m.append((message.alt - message.relative_alt) / 1000.0)
        return True

    await flight.after(TakeOff(UP_M), Airborne)
    assert flight.vehicle.truth.mode == Px4Mode.HOLD
    flight.to_driver = listen
    for east_m in itertools.islice(itertools.cycle((10.0, 0.0)), 12):
        await flight.after(to(east_m, 10.0), Arrived)
        told_m.append(flight.session.view.height_m)
        true_m.append(flight.vehicle.truth.height_m)
    assert max(homes_m) - min(homes_m) > 1.0
    assert max(abs(up_m - UP_M) for up_m in true_m) < 0.6
    assert max(abs(told - true) for told, true in zip(told_m, true_m, strict=True)) < 0.3


@by(fly, lambda: on("px4"))
async def test_picture_of_a_px4_is_placed_by_its_height_above_sea(flight, /):
    shot = {}

    def listen(message):
        if message.get_type() == "CAMERA_IMAGE_CAPTURED":
            shot[message.image_index] = (message.alt - message.relative_alt) / 1000.0, message
        return True

    await flight.after(TakeOff(UP_M), Airborne)
    flight.to_driver = listen
    start = mav.MAVLink_command_long_message(1, 100, 2000, 0, 0, 1.0, 0, 0, 0, 0, 0)
    flight.vehicle.receive(start.pack(mav.MAVLink(None, srcSystem=250, srcComponent=190)))
    await asyncio.sleep(60.0)
    view = flight.session.view
    off_m = [abs(home_m - view.home_amsl_m) for home_m, _ in shot.values()]
    assert max(off_m) > 0.5
    for _, message in shot.values():
        assert view.height_of(message) == pytest.approx(UP_M, abs=0.6)
