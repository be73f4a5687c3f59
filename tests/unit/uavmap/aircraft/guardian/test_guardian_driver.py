"""The guardian on the wire flies a vehicle whose mission has ended or cannot steer it."""

import asyncio

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav
from shapely.geometry import Point, Polygon

from missions import events as ev
from missions.geo.trajectory import rounded_path
from missions.orders import FlyPath, FlyTo, Hold, Land, ReturnToLaunch, Sweep, TakeOff
from missions.units import GridPoint
from sitl.copter.modes import Mode
from tests.support.flights import UP_M, fly, fly_up, small_mission
from tests.support.mavlink_peer import heartbeat
from tests.support.running import by
from tests.support.small_missions import square

both = pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])


async def out(flight, east_m=25.0, north_m=20.0):
    await flight.after(TakeOff(UP_M), ev.Airborne)
    flight.driver.give(FlyTo((GridPoint(east_m, north_m),), None, stop=False, height_m=UP_M))
    await asyncio.sleep(5.0)


HOUSE = square(10, 6, 6, 16)
"""A hole in the fence between the outward path and home."""


async def behind_the_house(flight):
    await flight.after(TakeOff(UP_M), ev.Airborne)
    route = (GridPoint(24.0, 0.0), GridPoint(24.0, 14.0))
    await flight.after(FlyTo(route, None, stop=True, height_m=UP_M), ev.Arrived)


async def lands_without_touching_the_house(flight):
    nearest_m, hole = list[float](), Polygon(HOUSE)

    def watch():
        at = flight.setting.grid.fixed(flight.vehicle.truth.position)
        nearest_m.append(float(hole.distance(Point(at))))
        return flight.vehicle.truth.landed

    await flight.until(watch, within_s=200.0)
    assert min(nearest_m) > 0.5


def beside_a_house(autopilot):
    return small_mission(autopilot=autopilot, holes=[HOUSE])


@pytest.mark.parametrize(
    ("autopilot", "on_path"), [("ardupilot", False), ("px4", False), ("px4", True)]
)
@by(fly, beside_a_house)
async def test_guardian_mission_fails_flies_around_hole(flight, /, autopilot, on_path):
    """From a leg, and from a path, on which a PX4 is in another mode."""
    await behind_the_house(flight)
    if on_path:
        ahead = [GridPoint(24.0, 14.0), GridPoint(24.0, 60.0)]
        plan = rounded_path(ahead, flight.now_s() + 1.0, speed_m_s=4.0)
        flight.driver.give(FlyPath(plan, UP_M, 0.0, 0.5))
        await flight.until(lambda: flight.session.view.ground_speed_m_s > 3.0)
    homeward = asyncio.create_task(flight.driver.guardian.bring_home("the disk is full"))
    await lands_without_touching_the_house(flight)
    await homeward
    assert flight.driver.guardian.fate() == ""
    assert flight.service_lines == [
        "vehicle 1: the disk is full; it is flown home around the fence",
        "vehicle 1: the disk is full; it is commanded to return (RTL)",
    ]
    assert not flight.seen(ev.Overridden)


@both
@by(fly, beside_a_house)
async def test_return_order_is_flown_around_hole(flight, /, autopilot):
    await behind_the_house(flight)
    flight.driver.give(ReturnToLaunch())
    await lands_without_touching_the_house(flight)
    assert [line.rpartition("; ")[2] for line in flight.service_lines] == [
        "it is flown home around the fence",
        "it is commanded to return (RTL)",
    ]


@by(fly)
async def test_guardian_terminal_is_gone_lands_the_vehicle(flight, /):
    await out(flight)

    def broken(text):
        raise BrokenPipeError(text)

    flight.driver._reporter.operator = broken
    await flight.driver.guardian.bring_home("the terminal was closed")
    assert flight.vehicle.truth.landed


@by(fly)
async def test_guardian_on_the_ground_sends_nothing(flight, /):
    sent = len(flight.sent)
    await flight.driver.guardian.bring_home("the mission failed")
    assert flight.commands_after(sent) == []
    assert flight.lines == []


@pytest.mark.parametrize("seed", range(2))
@by(fly)
async def test_guardian_link_loses_half_comes_home(flight, /, seed):
    await out(flight)
    rng = np.random.default_rng(seed)
    flight.to_driver = flight.to_vehicle = lambda message: rng.random() > 0.5
    await flight.driver.guardian.bring_home("the mission failed (disk full)")
    assert flight.vehicle.truth.landed
    assert flight.driver.guardian.fate() == ""
    assert flight.service_lines[0] == (
        "vehicle 1: the mission failed (disk full); it is commanded to return (RTL)"
    )


@by(fly)
async def test_guardian_autopilot_does_not_return_lands(flight, /):
    await out(flight)
    flight.vehicle.fail.reject(command=mav.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    await flight.driver.guardian.bring_home("the mission failed")
    assert flight.vehicle.truth.landed
    assert "from home" in flight.driver.guardian.fate()
    assert [e.action for e in flight.seen(ev.Guarded)] == ["rtl", "land"]


@by(fly)
async def test_guardian_pilot_selects_loiter_stops_sending(flight, /):
    await out(flight)
    home = asyncio.ensure_future(flight.driver.guardian.bring_home("the mission failed"))
    await flight.until(lambda: flight.vehicle.truth.mode == Mode.RTL)
    flight.pilot_mode(Mode.LOITER)
    await asyncio.wait_for(home, 5.0)
    await flight.sends_nothing(10.0)
    assert "flown by a pilot or a failsafe" in flight.driver.guardian.fate()
    assert len(flight.seen(ev.Overridden)) == 1


@both
@by(fly, small_mission)
async def test_quick_descent_lands_from_near_ground(flight, /, autopilot):
    await out(flight)
    begun_s = flight.vehicle.t_s
    flight.driver.guardian.take_over("land", "a test", hurry=True)
    await flight.until(lambda: flight.vehicle.truth.mode.name == "LAND")
    assert 0.3 < flight.vehicle.truth.height_m < 1.2
    await flight.sees(ev.Landed, within_s=20.0)
    assert flight.vehicle.t_s - begun_s < UP_M / 1.5 + 2.0
    assert not flight.vehicle.truth.crashed
    assert not flight.seen(ev.Crashed)


@pytest.mark.parametrize(
    ("refused", "least_s", "most_s"),
    [
        (mav.MAV_CMD_DO_REPOSITION, 0.0, UP_M / 1.5 + 3.0),
        (mav.MAV_CMD_DO_CHANGE_SPEED, UP_M / 1.5, UP_M / 1.5 + 5.0),
    ],
)
@by(fly)
async def test_quick_descent_command_refused_still_sinks(flight, /, refused, least_s, most_s):
    await out(flight)
    flight.vehicle.fail.reject(refused)
    begun_s = flight.vehicle.t_s
    flight.driver.guardian.take_over("land", "a test", hurry=True)
    await flight.sees(ev.Landed, within_s=30.0)
    assert least_s < flight.vehicle.t_s - begun_s < most_s


@by(fly)
async def test_guardian_acting_orders_of_mission_do_nothing(flight, /):
    await out(flight)
    flight.driver.guardian.take_over("rtl", "a test")
    await flight.until(lambda: flight.vehicle.truth.mode == Mode.RTL)
    sent = len(flight.sent)
    flight.driver.give(Hold())
    await asyncio.sleep(3.0)
    assert flight.commands_after(sent) == []
    await flight.sees(ev.Landed)


@by(fly)
async def test_guardian_takes_over_on_the_ground_ends_with_one_landing(flight, /):
    flight.vehicle.fail.reject(command=mav.MAV_CMD_NAV_TAKEOFF)
    flight.driver.give(TakeOff(UP_M))
    await flight.until(lambda: flight.session.view.armed)
    flight.driver.guardian.take_over("land", "a test")
    await flight.sees(ev.Landed, within_s=30.0)
    await asyncio.sleep(10.0)
    assert len(flight.seen(ev.Landed)) == 1
    assert not flight.driver.guardian.acting


@by(fly)
async def test_guardian_link_silent_and_back_acts_again(flight, /):
    await out(flight)
    flight.vehicle.fail.reject(command=mav.MAV_CMD_NAV_RETURN_TO_LAUNCH, for_s=12.0)
    flight.to_driver = flight.to_vehicle = lambda message: False
    flight.driver.guardian.take_over("rtl", "a test")
    await flight.sees(ev.LinkLost, within_s=20.0)
    await asyncio.sleep(5.0)
    flight.to_driver = flight.to_vehicle = lambda message: True
    await flight.sees(ev.Guarded, 2, within_s=30.0)
    await flight.sees(ev.Landed)


@by(fly)
async def test_guardian_link_back_after_mission_failed_lands_it(flight, /):
    loop = asyncio.get_running_loop()
    await out(flight)
    flight.to_driver = flight.to_vehicle = lambda message: False
    await flight.sees(ev.LinkLost, within_s=20.0)
    flight.driving.cancel()  # with it ends the task that reconnects links
    loop.call_later(10.0, setattr, flight, "to_driver", lambda message: True)
    loop.call_later(10.0, setattr, flight, "to_vehicle", lambda message: True)
    begin_s = loop.time()
    await flight.driver.guardian.bring_home("the mission failed (disk full)")
    assert flight.vehicle.truth.landed
    assert loop.time() - begin_s < 90.0
    assert flight.driver.guardian.fate() == ""
    assert len(flight.seen(ev.Connected)) == 2
    assert len(flight.seen(ev.Landed)) == 1


@by(fly_up)
async def test_guardian_fall_on_return_path_is_reported(flight, /):
    flight.driving.cancel()
    loop = asyncio.get_running_loop()

    async def fall():
        await flight.until(lambda: flight.session.view.height_m < 3.0)
        flight.pilot(mav.MAV_CMD_COMPONENT_ARM_DISARM, 0, FORCED)

    falling = loop.create_task(fall())
    await flight.driver.guardian.bring_home("the mission failed (disk full)")
    await falling
    assert flight.vehicle.truth.crashed
    assert len(flight.seen(ev.Crashed)) == 1
    assert not flight.seen(ev.Landed)


FORCED = 21196.0
"""Parameter of MAV_CMD_COMPONENT_ARM_DISARM that stops the motors even in the air."""


@pytest.mark.parametrize(
    ("autopilot", "height_m"), [("ardupilot", 1.5), ("ardupilot", 8.0), ("px4", 1.5), ("px4", 3.0)]
)
@by(fly_up, small_mission)
async def test_motors_stop_over_pad_is_a_crash(flight, /, autopilot, height_m):
    """The vehicle reports that it is disarmed on the ground over its pad, as after a landing."""
    flight.driver.give(Land())
    await flight.until(lambda: flight.session.view.height_m < height_m)
    flight.pilot(mav.MAV_CMD_COMPONENT_ARM_DISARM, 0, FORCED)
    crashed = await flight.sees(ev.Crashed, within_s=5.0)
    assert flight.vehicle.truth.crashed
    assert "struck the ground" in crashed.reason or "it fell" in crashed.reason
    await asyncio.sleep(10.0)
    assert not flight.driver.guardian.responsible
    assert len(flight.seen(ev.Crashed)) == 1
    assert not flight.seen(ev.Landed)
    assert any("is down near" in text for text in flight.lines)


@both
@by(fly_up, small_mission)
async def test_motors_stop_just_above_ground_is_landing(flight, /, autopilot):
    flight.driver.give(Land())
    await flight.until(lambda: flight.vehicle.truth.height_m < 0.1)
    flight.pilot(mav.MAV_CMD_COMPONENT_ARM_DISARM, 0, FORCED)
    await flight.sees(ev.Landed, within_s=5.0)
    await asyncio.sleep(5.0)
    assert not flight.seen(ev.Crashed)


@by(fly)
async def test_crashed_aircraft_that_believes_to_fly_stays_down(flight, /):
    """It is armed and reports that it flies, but has no height: the service notices the crash."""
    await out(flight)
    flight.to_driver = lambda m: m.get_type() not in ("HEARTBEAT", "EXTENDED_SYS_STATE")
    flight.vehicle.fail.motor(share=0.0)
    autopilot = mav.MAVLink(None, srcSystem=1, srcComponent=1)
    for _ in range(20):
        flight.session.feed(heartbeat(Mode.GUIDED, armed=True).pack(autopilot))
        await asyncio.sleep(1.0)
    assert flight.vehicle.truth.crashed
    assert len(flight.seen(ev.LiftedOff)) == len(flight.seen(ev.Crashed)) == 1
    assert not flight.driver.guardian.responsible


@both
@by(fly, small_mission)
async def test_storm_lands_vehicle_near_the_fence(flight, /, autopilot):
    """At most 150 m outside of the fence; a plain landing would end 250 m outside."""
    await out(flight)
    flight.vehicle.fail.wind_gust(m_s=25.0, for_s=None)
    await flight.until(lambda: flight.vehicle.truth.landed, within_s=90.0)
    where = flight.setting.grid.fixed(flight.vehicle.truth.position)
    assert [e.action for e in flight.seen(ev.Guarded)][-1] == "land"
    assert flight.setting.fence.outer.distance(Point(where)) < 150.0


@by(fly_up)
async def test_leg_without_progress_is_reported_to_the_mission(flight, /):
    # accepted, and not carried out: another sender commands the autopilot to stay
    flight.to_vehicle = lambda message: getattr(message, "command", 0) != 192
    flight.driver.give(FlyTo((GridPoint(40.0, 20.0),), None, stop=False, height_m=UP_M))
    failed = await flight.sees(ev.OrderFailed, within_s=60.0)
    assert "no progress" in failed.reason


@by(fly_up)
async def test_sweep_waiting_for_its_camera_is_left_alone(flight, /):
    flight.to_vehicle = lambda message: getattr(message, "command", 0) != 2000
    flight.driver.give(Sweep(GridPoint(30.0, 0.0), 4.0, UP_M))
    await asyncio.sleep(25.0)
    assert not flight.seen(ev.OrderFailed)


@by(fly)
async def test_take_off_without_acknowledgement_is_recognised(flight, /):
    flight.to_driver = lambda message: (
        not (message.get_type() == "COMMAND_ACK" and message.command == mav.MAV_CMD_NAV_TAKEOFF)
    )
    await flight.after(TakeOff(UP_M), ev.Airborne)
    assert len(flight.seen(ev.LiftedOff)) == 1
    assert not flight.seen(ev.OrderFailed)


@by(fly_up)
async def test_impossible_position_stops_no_clock(flight, /):
    """A message that cannot be sent is tried again later, not without end at one instant."""
    nowhere = GridPoint(float("inf"), 0.0)
    flight.driver.give(FlyTo((nowhere,), None, stop=False, height_m=UP_M))
    await asyncio.sleep(5.0)
    flight.driver.guardian.take_over("land", "a test", hurry=True)
    await flight.sees(ev.Landed, within_s=60.0)
