"""The driver flies paths without stopping, against simulated vehicles, as bytes."""

import asyncio
import itertools
import math
import random

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions import events as ev
from missions.flight.strategy.sweep_paths import PLAN_LEAD_S
from missions.geo.trajectory import rounded_path
from missions.mission.sim_section import SimQuirks
from missions.orders import FlyPath, FlyTo, Hold, Land, Look, StandDown, Sweep, TakeOff
from missions.units import Cell, GridPoint
from sitl.copter.modes import Mode
from sitl.px4.modes import Px4Mode
from tests.benchmarks.path_following import followed, mean, quantile_95
from tests.support.flights import fly, fly_up, small_mission
from tests.support.running import by

UP_M = 12.0
EVERY_S = 0.2
MIN_M_S = 3.0
SETPOINT = "SET_POSITION_TARGET_GLOBAL_INT"
START_CAPTURE = mav.MAV_CMD_IMAGE_START_CAPTURE

both = pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])


def corner(begin_s, **how):
    points = [GridPoint(0, 0), GridPoint(30, 0), GridPoint(30, 30)]
    return rounded_path(points, begin_s, speed_m_s=6.0, cut_m=2.5, **how)


def order(plan, every_s=EVERY_S):
    return FlyPath(plan, UP_M, 0.0, every_s)


def straight(flight, end):
    return order(rounded_path([place_of(flight), end], flight.now_s() + PLAN_LEAD_S, speed_m_s=6.0))


def speed_of(flight):
    return math.hypot(*flight.vehicle.truth.velocity_m_s[:2])


def place_of(flight):
    return flight.setting.grid.fixed(flight.vehicle.truth.position)


async def on_the_way(flight, seconds=5.5):
    await flight.after(TakeOff(UP_M), ev.Airborne)
    plan = corner(flight.now_s() + PLAN_LEAD_S)
    flight.driver.give(order(plan))
    await asyncio.sleep(seconds)
    return plan


def turned_off(plan, begin_s):
    """Return a path from the planned position on for some metres, and back beside the region."""
    here = plan.at(begin_s)
    speed_m_s = math.hypot(here.v_east_m_s, here.v_north_m_s)
    east, north = here.v_east_m_s / speed_m_s, here.v_north_m_s / speed_m_s
    ahead = GridPoint(here.east_m + 14.0 * east, here.north_m + 14.0 * north)
    points = [here.place, ahead, GridPoint(ahead.east_m, 18.0), GridPoint(8.0, 18.0)]
    return rounded_path(points, begin_s, speed_m_s=6.0, cut_m=2.5, begin_speed_m_s=speed_m_s)


def count(flight, command):
    return sum(getattr(m, "command", None) == command for _, m in flight.sent)


def kinds(flight, kind):
    return [(t_s, m) for t_s, m in flight.sent if m.get_type() == kind]


@both
@by(fly, small_mission)
async def test_path_replaced_midway_is_continued(flight, /, autopilot):
    speeds = []
    announced = set()

    def note(message):
        if message.get_type() == "CAMERA_IMAGE_CAPTURED":
            announced.add(message.image_index)
        return True

    flight.to_driver = note
    first = await on_the_way(flight)
    second = turned_off(first, flight.now_s() + PLAN_LEAD_S)
    flight.driver.give(order(second))
    while flight.now_s() < second.end_s - 2.5:
        await asyncio.sleep(0.05)
        speeds.append(speed_of(flight))
    arrived = await flight.sees(ev.Arrived, within_s=12.0)
    end = second.at(second.end_s).place
    assert arrived.t_s >= second.end_s
    assert arrived.position.distance_to(end) < 0.7
    assert place_of(flight).distance_to(end) < 0.5
    follows = Px4Mode.HOLD if autopilot == "px4" else Mode.GUIDED
    assert flight.vehicle.truth.mode == follows
    assert abs(math.remainder(flight.vehicle.truth.yaw_rad, math.tau)) < 0.1
    await flight.after(FlyTo((GridPoint(0, 0),), None, stop=True, height_m=UP_M), ev.Arrived)
    await flight.after(Land(), ev.Landed)
    assert min(speeds) > MIN_M_S
    seen = flight.seen(ev.FrameSeen)
    assert {event.vantage for event in seen} == {None}
    assert len(seen) == len(announced)
    gaps = [b.t_s - a.t_s for a, b in itertools.pairwise(seen)]
    assert gaps == pytest.approx([EVERY_S] * len(gaps), abs=0.051)
    assert any(vote.positive for event in seen for vote in event.votes)
    assert count(flight, START_CAPTURE) == 1
    assert len(flight.seen(ev.Arrived)) == 2
    for kind in (ev.OrderFailed, ev.Overridden, ev.FrameLost):
        assert not flight.seen(kind)
    stream = [t_s for t_s, _ in kinds(flight, SETPOINT)]
    assert max(b - a for a, b in itertools.pairwise(stream)) < 0.11
    assert not flight.service_lines


def test_simulated_copter_follows_a_path_like_a_real_one():
    """At 6 m/s a real one deviates 0.18 m on average, and 0.54 m in 95 % of the time."""
    flown = followed("ardupilot", 6.0)
    assert not flown.failed
    assert mean(flown.errors_m) < 0.35
    assert 0.3 < quantile_95(flown.errors_m) <= 0.7
    assert abs(flown.delay_share) <= 0.01


@both
@by(fly, small_mission)
async def test_path_link_loses_setpoints_stays_near(flight, /, autopilot):
    errors = []
    dice = random.Random(7)
    flight.to_vehicle = lambda m: m.get_type() != SETPOINT or dice.random() > 0.2
    plan = await on_the_way(flight, 1.5)
    while flight.now_s() < plan.end_s:
        await asyncio.sleep(0.05)
        errors.append(place_of(flight).distance_to(plan.at(flight.now_s()).place))
    await flight.sees(ev.Arrived, within_s=12.0)
    assert not flight.seen(ev.OrderFailed)
    # a real PX4 lagged by 4 m in the first seconds of a path
    assert max(errors) < (3.0 if autopilot == "px4" else 1.5)


@by(fly)
async def test_timeout_is_short_while_paths_are_flown(flight, /):
    parameters = flight.vehicle._ap.parameters
    assert parameters["GUID_TIMEOUT"] == 3.0
    await on_the_way(flight)
    assert parameters["GUID_TIMEOUT"] == 1.0


@both
@by(fly_up, lambda autopilot: small_mission(autopilot=autopilot))
async def test_path_telemetry_read_late_is_not_off(flight, /, autopilot):
    """A busy computer read the telemetry of a real vehicle 3.4 s late for 12 s.

    It used the old positions as current: the mission ended with "12 m off its path by now",
    although the vehicle was 2.6 m off.
    """
    corners = [(0, 0), (30, 0), (30, 25), (0, 25), (0, 5), (25, 5), (25, 20)]
    points = [GridPoint(east, north) for east, north in corners]
    begin_s = flight.now_s() + PLAN_LEAD_S
    flight.driver.give(order(rounded_path(points, begin_s, speed_m_s=6.0, cut_m=2.5)))
    await asyncio.sleep(3.0)
    deliver, held = flight._deliver, list[bytes]()
    flight._deliver = lambda data, later=False: held.append(data)
    late = round(3.4 / 0.04)
    for _ in range(300):
        await asyncio.sleep(0.04)
        while len(held) > late:
            deliver(held.pop(0))
    assert flight.driver.view.age_s(flight.now_s()) > 2.5
    flight._deliver = deliver
    deliver(b"".join(held))
    assert flight.driver.view.age_s(flight.now_s()) < 0.5
    await flight.sees(ev.Arrived)
    assert not flight.seen(ev.OrderFailed, ev.LinkLost)


# --- what ends a stream --------------------------------------------------------------------------
@by(fly)
async def test_copter_stream_lost_stops_and_is_reported(flight, /):
    await on_the_way(flight, 5.0)
    assert speed_of(flight) > 5.0
    lost_s, lost_at = flight.now_s(), place_of(flight)
    flight.to_vehicle = lambda m: m.get_type() != SETPOINT
    failed = await flight.sees(ev.OrderFailed, within_s=9.0)
    assert failed.order == "FlyPath"
    assert "off its path" in failed.reason
    assert failed.t_s - lost_s < 9.0
    await asyncio.sleep(8.0)
    assert speed_of(flight) < 0.3
    assert place_of(flight).distance_to(lost_at) < 16.0


@by(fly, lambda: small_mission(autopilot="px4", quirks=SimQuirks(stick=False)))
async def test_px4_stream_lost_returns_and_is_left_alone(flight, /):
    await on_the_way(flight, 5.0)
    flight.to_vehicle = lambda m: m.get_type() != SETPOINT
    lost_s = flight.now_s()
    overridden = await flight.sees(ev.Overridden, within_s=3.0)
    assert overridden.mode == "RTL by a failsafe"
    assert overridden.t_s - lost_s < 2.5
    flight.to_vehicle = lambda m: True
    index = len(flight.sent)
    await flight.sees(ev.Landed)
    assert flight.commands_after(index) == []


@by(fly)
async def test_link_lost_on_a_path_stops_the_vehicle_until_it_is_back(flight, /):
    await on_the_way(flight, 5.0)
    lost_at = place_of(flight)
    flight.to_driver = flight.to_vehicle = lambda message: False
    await flight.sees(ev.LinkLost, within_s=6.0)
    flight.driver.give(StandDown())
    index = len(flight.sent)
    await asyncio.sleep(3.0)
    assert not any(m.get_type() == SETPOINT for _, m in flight.sent[index:])
    assert place_of(flight).distance_to(lost_at) < 16.0  # no message reached it
    assert speed_of(flight) < 0.3
    flight.to_driver = flight.to_vehicle = lambda message: True
    await flight.sees(ev.Connected, 2, within_s=5.0)
    await flight.after(straight(flight, GridPoint(0, 0)), ev.Arrived)
    assert place_of(flight).distance_to(GridPoint(0, 0)) < 0.5
    assert not flight.seen(ev.OrderFailed)


@pytest.mark.parametrize(
    ("autopilot", "mode"),
    [
        ("ardupilot", Mode.LOITER),
        ("ardupilot", Mode.RTL),
        ("px4", Px4Mode.HOLD),  # while it is in OFFBOARD, another sender commanded it
        ("px4", Px4Mode.RTL),
    ],
)
@by(fly, small_mission)
async def test_pilot_takes_over_on_a_path(flight, /, autopilot, mode):
    await on_the_way(flight)
    if isinstance(mode, Px4Mode):
        flight.pilot(mav.MAV_CMD_DO_SET_MODE, 1, mode >> 16 & 0xFF, mode >> 24)
    else:
        flight.pilot(mav.MAV_CMD_DO_SET_MODE, 1, mode)
    assert flight.vehicle.truth.mode == mode
    await flight.sees(ev.Overridden, within_s=1.1)
    await flight.sends_nothing(5.0)
    assert flight.vehicle.truth.mode == mode
    assert not flight.seen(ev.Released, ev.OrderFailed)


# --- other orders on the way ---------------------------------------------------------------------
@both
@by(fly, small_mission)
async def test_hold_brakes_in_the_shortest_distance_and_stays(flight, /, autopilot):
    await on_the_way(flight, 5.0)
    begin, farthest = place_of(flight), 0.0
    assert speed_of(flight) > 5.0
    flight.driver.give(Hold())
    for _ in range(200):
        await asyncio.sleep(0.05)
        farthest = max(farthest, place_of(flight).distance_to(begin))
    assert farthest < 13.0
    assert farthest - place_of(flight).distance_to(begin) < 1.0
    assert abs(place_of(flight).north_m - begin.north_m) < 1.0
    assert speed_of(flight) < 0.2
    if autopilot == "px4":
        assert flight.vehicle.truth.mode == Px4Mode.HOLD
    assert not flight.seen(ev.OrderFailed, ev.Overridden)


@both
@by(fly, lambda autopilot: small_mission(autopilot=autopilot, speed_m_s=3.0))
async def test_path_any_order_may_follow_midway(flight, /, autopilot):
    await on_the_way(flight)
    await flight.after(FlyTo((GridPoint(10, 16),), None, stop=True, height_m=UP_M), ev.Arrived)
    for following, ends in (
        (Look(Cell(2, 4), 5, UP_M), ev.LookEnded),
        (Sweep(GridPoint(20, 16), 4.0, UP_M), ev.Arrived),
    ):
        flight.driver.give(straight(flight, GridPoint(30, 30)))
        await asyncio.sleep(3.0)
        assert speed_of(flight) > 2.0
        await flight.after(following, ends)
    flight.driver.give(straight(flight, GridPoint(0, 0)))
    await asyncio.sleep(3.0)
    await flight.after(Land(), ev.Landed)
    assert not flight.seen(ev.OrderFailed, ev.Overridden)


@both
@by(fly, lambda autopilot: small_mission(autopilot=autopilot, speed_m_s=3.0))
async def test_leg_after_path_has_speed_of_mission(flight, /, autopilot):
    """A new kind of target resets an ArduCopter to its own speed, 10 m/s."""
    fastest = []
    await on_the_way(flight)
    await flight.sees(ev.Arrived, within_s=20.0)
    flight.driver.give(FlyTo((GridPoint(0, 0),), None, stop=True, height_m=UP_M))
    for _ in range(140):
        await asyncio.sleep(0.05)
        fastest.append(speed_of(flight))
    assert 2.5 < max(fastest) < 3.6


# --- replacements at the seams -------------------------------------------------------------------
@pytest.mark.parametrize(
    ("autopilot", "after_end_s"),
    [("ardupilot", -0.5), ("px4", -0.5), ("px4", 0.3), ("ardupilot", 0.8), ("px4", 1.5)],
)
def test_path_given_at_the_end_loses_no_picture(autopilot, after_end_s):
    """The camera still takes pictures, is being stopped, or is done."""

    async def body(flight):
        plan = await on_the_way(flight, 0.0)
        await asyncio.sleep(plan.end_s + after_end_s - flight.now_s())
        here = plan.at(plan.end_s).place
        back = [here, GridPoint(here.east_m, here.north_m - 20.0)]
        again = rounded_path(back, flight.now_s() + 1.2, speed_m_s=6.0)
        arrived = len(flight.seen(ev.Arrived))
        flight.driver.give(order(again))
        await flight.sees(ev.Arrived, arrived + 1, within_s=20.0)
        assert place_of(flight).distance_to(back[-1]) < 0.5
        late = [event for event in flight.seen(ev.FrameSeen) if event.t_s > again.begin_s]
        assert len(late) > 15

    flight = fly(body, small_mission(autopilot=autopilot))
    assert not flight.seen(ev.FrameLost, ev.OrderFailed)
    times = [event.t_s for event in flight.seen(ev.FrameSeen)]
    assert times == sorted(set(times))


@by(fly)
async def test_path_with_another_interval_changes_pace_of_pictures(flight, /):
    plan = await on_the_way(flight)
    second = turned_off(plan, flight.now_s() + PLAN_LEAD_S)
    flight.driver.give(order(second, every_s=0.5))
    await flight.sees(ev.Arrived, within_s=20.0)
    late = [e.t_s for e in flight.seen(ev.FrameSeen) if e.t_s > second.begin_s + 0.5]
    gaps = [b - a for a, b in itertools.pairwise(late)]
    assert gaps == pytest.approx([0.5] * len(gaps), abs=0.051)
    assert not flight.seen(ev.FrameLost)


@by(fly)
async def test_path_called_off_is_not_resumed(flight, /):
    """Two orders at the same instant: the path after them begins anew."""
    await on_the_way(flight)
    flight.driver.give(Hold())
    plan = rounded_path([GridPoint(25, 0), GridPoint(25, 20)], flight.now_s() + 5.0, speed_m_s=6.0)
    flight.driver.give(order(plan))
    await flight.sees(ev.Arrived, within_s=20.0)
    assert place_of(flight).distance_to(GridPoint(25, 20)) < 0.5


@both
@by(fly_up, lambda autopilot: small_mission(autopilot=autopilot, drift_m_s=0.4, toward_deg=60.0))
async def test_path_over_drifting_region_moves(flight, /, autopilot):
    grid = flight.setting.grid
    drift = (grid.drift_east_m_s, grid.drift_north_m_s)
    begin_s = flight.now_s() + PLAN_LEAD_S
    start = grid.to_moving(place_of(flight), begin_s)
    points = [start, GridPoint(start.east_m, start.north_m + 25.0)]
    plan = rounded_path(points, begin_s, speed_m_s=6.0, drift_m_s=drift)
    flight.driver.give(order(plan))
    await flight.sees(ev.Arrived, within_s=20.0)
    off_m = place_of(flight).distance_to(grid.to_fixed(points[-1], flight.now_s()))
    assert off_m < 0.8
    assert not flight.seen(ev.OrderFailed)


@by(fly_up)
async def test_camera_that_refuses_ends_the_order_and_the_stream(flight, /):
    flight.vehicle.fail.reject(START_CAPTURE)
    plan = corner(flight.now_s() + PLAN_LEAD_S)
    flight.driver.give(order(plan))
    failed = await flight.sees(ev.OrderFailed, within_s=30.0)
    assert "IMAGE_START_CAPTURE was refused" in failed.reason
    await asyncio.sleep(0.2)
    index = len(kinds(flight, SETPOINT))
    await asyncio.sleep(2.0)
    assert len(kinds(flight, SETPOINT)) == index
