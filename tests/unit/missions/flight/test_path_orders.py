"""Allowed and refused paths; the air and the energy of vehicles on them."""

from __future__ import annotations

from dataclasses import replace

import pytest
from shapely.geometry import Point

from missions.events import (
    Arrived,
    FrameLost,
    FrameSeen,
    LinkLost,
    OrderFailed,
    Tracked,
    Vote,
)
from missions.flight.path_orders import PLAN_LEAD_S, come_inside
from missions.flight.return_home import turn_back
from missions.flight.strategy.charting import flyer_of
from missions.flight.transitions import BEHIND_S, MAX_CONTINUATIONS_BEHIND
from missions.flight.vehicle_state import ReturnReason
from missions.geo.braking import Course
from missions.geo.fence import Fence
from missions.geo.path_in_fence import BEFORE_S, WORTH_S, allowed, as_far_as_allowed, is_outside
from missions.geo.trajectory import Trajectory, rounded_path
from missions.guardian import Guard, Limits, Snapshot, Task, watch
from missions.guardian.measures import is_behind
from missions.guardian.thresholds import OFF_PLAN_M
from missions.orders import FlyPath, FlyTo, Hold
from missions.planning.sweep.paths import Route
from missions.units import Cell, GridPoint
from tests.support.small_missions import square
from tests.unit.missions.flight.test_step import Service, over

EDGES = [GridPoint(*corner) for corner in square(0, 0, 60, 60)]


def line(*points: tuple[float, float], begin_s: float = 10.0) -> Trajectory:
    return rounded_path([GridPoint(*point) for point in points], begin_s, speed_m_s=6.0)


def flying(vehicles: int = 1, **how: object) -> Service:
    """Return a service with a vehicle in the air, on a path of 90 m along its layer."""
    made = over(vehicles=vehicles, strategy="swath", mounting="gimbal", **how)
    made.connect_all()
    order = FlyPath(line((-40, 30), (50, 30)), 12.0, 90.0, 0.25)
    made.fly(1, GridPoint(-40.0, 30.0), order=order, judged_s=10.0)
    return made


# --- the fence ---------------------------------------------------------------------------------
def test_a_path_lies_inside_the_margin_all_along() -> None:
    fence = Fence.from_rings(EDGES, [], 2.0)
    assert allowed(fence, line((10, 10), (50, 10), (50, 50)))
    assert allowed(fence, line((10, 2), (50, 2)))  # along its rim
    assert not allowed(fence, line((10, 10), (58.5, 10)))
    assert not allowed(fence, line((10, 10), (70, 10), (10, 40)))


def test_path_does_not_cross_a_hole_between_two_samples() -> None:
    thin = [GridPoint(*corner) for corner in square(30, 20, 0.5, 20)]
    fence = Fence.from_rings(EDGES, [thin], 0.0)
    assert not allowed(fence, line((10, 30), (50, 30)))


def test_a_path_may_begin_where_a_gust_has_blown_the_vehicle_if_it_leads_in() -> None:
    fence = Fence.from_rings(EDGES, [], 2.0)
    assert allowed(fence, line((1.2, 30), (30, 30)))
    assert not allowed(fence, line((0.5, 30), (30, 30)))  # too far for a path
    assert not allowed(fence, line((1.5, 30), (1.2, 40), (30, 40)))  # and farther out
    assert not allowed(fence, line((30, 30), (1.2, 30)))  # no path ends there


def test_a_path_over_a_region_that_drifts_is_held_to_where_it_will_be() -> None:
    fence = Fence.from_rings(EDGES, [], 2.0)
    path = replace(line((10, 50), (50, 50), begin_s=0.0), drift_m_s=(0.0, 1.0))
    assert path.end_s > 9.0
    assert not allowed(fence, path)
    assert allowed(fence, replace(path, drift_m_s=(0.0, 0.5)))


def test_vehicle_that_waits_outside_of_the_margin_comes_inside_first() -> None:
    made = flying()
    fence = made.setting.fence
    out, rim = GridPoint(99.5, 30.0), GridPoint(98.5, 30.0)
    assert is_outside(fence, out)
    assert not is_outside(fence, rim)
    made.put(1, order=Hold(), position=out)
    after = come_inside(made.state, made.state.vehicles[1])
    assert after is not None
    order = after.vehicles[1].order
    assert isinstance(order, FlyTo)
    assert order.route[-1].east_m == pytest.approx(96.5)
    made.put(1, position=rim)
    assert come_inside(made.state, made.state.vehicles[1]) is None


# --- others ------------------------------------------------------------------------------------
def test_vehicle_brakes_along_its_path_before_reserved_air() -> None:
    made = flying(2)
    made.now_s = made.state.vehicles[1].tracked_s + 14.0
    at, low = GridPoint(25.0, 30.0), ReturnReason.BATTERY
    made.fly(2, at, height_m=6.0, home=at, return_reason=low, over_home=True)
    before = made.state.vehicles[1].order
    assert isinstance(before, FlyPath)
    at = before.trajectory.at(15.0).place
    made.post(Tracked(1, 15.0, at, 12.0, 50.0))
    stop = made.path(1)
    assert stop.begin_s == pytest.approx(15.0 + PLAN_LEAD_S)
    assert stop.at(stop.begin_s).place == before.trajectory.at(stop.begin_s).place
    assert stop.at(stop.end_s).east_m < 25.0 - 6.0
    assert made.order(2) != Hold()  # a landing vehicle waits for no vehicle that makes way


def test_air_that_a_silent_vehicle_may_have_reached_along_its_path_stays_reserved() -> None:
    made = flying(2)
    at = GridPoint(-20.0, 30.0)
    made.post(Tracked(1, 15.0, at, 12.0, 50.0), LinkLost(1, 20.0))
    where = GridPoint(20.0, 30.0)  # twelve seconds on, and what it takes to brake
    made.fly(2, where, home=where, return_reason=ReturnReason.BATTERY, over_home=True)
    made.post(Tracked(2, 60.0, where, 18.0, 50.0))
    assert made.order(2) == Hold()


# --- energy ------------------------------------------------------------------------------------
def test_vehicle_turns_back_while_it_can_still_brake_and_come_home() -> None:
    """Its energy is estimated from where it comes to rest, not from where it is."""
    needs = {}
    for outward in (True, False):
        ends = ((-40.0, 30.0), (50.0, 30.0)) if outward else ((50.0, 30.0), (-40.0, 30.0))
        made = flying()
        path = line(*ends)
        at = path.at(18.0)
        made.put(
            1, position=at.place, home=GridPoint(-50.0, 30.0),
            order=FlyPath(path, 12.0, 90.0, 0.25), tracked_s=18.0,
        )  # fmt: skip
        made.state = replace(made.state, t_s=18.0)
        low, high = 0.0, 60.0
        while high - low > 1e-3:
            middle = (low + high) / 2
            made.put(1, remaining_wh=middle)
            back = turn_back(made.state, made.state.vehicles[1])
            if back.vehicles[1].return_reason is None:
                high = middle
            else:
                low = middle
        needs[outward] = (high, at.place.distance_to(GridPoint(-50.0, 30.0)))
    energy = made.setting.energy
    for outward, (need_wh, away_m) in needs.items():
        stop_m = 6.0 + 9.0  # a second, and braking from 6 m/s
        rest_m = away_m + stop_m if outward else away_m - stop_m
        least_wh = energy.home_wh(rest_m, 12.0)
        assert least_wh < need_wh < least_wh + energy.hover_wh(10.0)


# --- the camera --------------------------------------------------------------------------------
def test_camera_may_lose_many_pictures_in_a_second_and_few_in_ten() -> None:
    made = flying()
    for k in range(30):
        made.post(FrameLost(1, 11.0 + 0.1 * k, "black"))
    assert made.state.vehicles[1].return_reason is None
    for k in range(5):  # a silent camera's pictures are reported every few seconds
        made.post(FrameLost(1, 14.0 + 3.4 * k, "no picture was announced"))
    assert made.state.vehicles[1].return_reason is ReturnReason.FAULT


def test_camera_that_is_silent_is_noticed() -> None:
    made = flying()
    path = made.state.vehicles[1].order
    assert isinstance(path, FlyPath)
    slow = replace(path, trajectory=rounded_path(
        [GridPoint(-40, 30), GridPoint(50, 30)], 10.0, speed_m_s=1.0))  # fmt: skip
    made.put(1, order=slow)
    made.post(FrameSeen(1, 12.0, None, (Vote(Cell(-9, 7), False, 0.0),)))
    made.post(Tracked(1, 30.0, slow.trajectory.at(30.0).place, 12.0, 50.0))
    assert made.state.vehicles[1].return_reason is None
    made.post(Tracked(1, 38.0, slow.trajectory.at(38.0).place, 12.0, 50.0))
    vehicle = made.state.vehicles[1]
    assert vehicle.return_reason is ReturnReason.FAULT
    assert "silent" in vehicle.note
    assert isinstance(vehicle.order, Hold)  # it comes to rest first


def test_vehicle_behind_schedule_stops_and_continues_as_fast_as_the_wind_allows() -> None:
    made = flying()
    made.put(1, on_lane=True, lanes=((GridPoint(-40, 30), GridPoint(50, 30)),))
    at = GridPoint(-10.0, 30.0)
    made.post(Tracked(1, 17.0, at, 12.0, 60.0, wind_m_s=8.0))
    made.post(OrderFailed(1, 17.2, "FlyPath", "it is 13 m off its path by now", behind=True))
    vehicle = made.state.vehicles[1]
    assert isinstance(vehicle.order, Hold)
    assert vehicle.return_reason is None
    made.post(Tracked(1, 17.6, at, 12.0, 60.0, wind_m_s=9.5))
    made.post(Tracked(1, 18.0, at, 12.0, 60.0, wind_m_s=9.5))
    again = made.state.vehicles[1].order
    assert isinstance(again, FlyPath)
    assert again.trajectory.at(18.0).place == at
    assert max(piece.speed_m_s for piece in again.trajectory.pieces) <= 2.5  # of 12 m/s


@pytest.mark.parametrize(("every_s", "comes_home"), [(5.0, True), (BEHIND_S + 1.0, False)])
def test_vehicle_behind_schedule_again_and_again_returns(every_s: float, comes_home: bool) -> None:
    made = flying()
    order = made.state.vehicles[1].order
    for k in range(MAX_CONTINUATIONS_BEHIND + 1):
        t_s = 17.0 + every_s * k
        made.put(1, order=order, braking_until_s=None, judged_s=t_s)
        assert made.state.vehicles[1].return_reason is None
        made.post(OrderFailed(1, t_s, "FlyPath", "it is 13 m off its path by now", behind=True))
    assert (made.state.vehicles[1].return_reason is ReturnReason.FAULT) == comes_home


@pytest.mark.parametrize(
    ("east_m", "north_m", "behind"),
    [(-14.0, 0.0, True), (-14.0, 2.5, True), (14.0, 0.0, False), (-14.0, 9.0, False)],
)
def test_vehicle_on_its_path_and_late_is_behind_schedule(
    east_m: float, north_m: float, behind: bool
) -> None:
    made = flying()
    order = made.state.vehicles[1].order
    assert isinstance(order, FlyPath)
    limits = Limits(made.setting.fence, made.setting.energy)
    task = Task("path", 10.0, height_m=12.0, name="FlyPath", course=Course((order.trajectory,)))
    guard, verdicts = Guard().with_task(task), []
    for k in range(6):
        t_s = 15.0 + 0.5 * k
        due = order.trajectory.at(t_s).place
        at = GridPoint(due.east_m + east_m, due.north_m + north_m)
        seen = Snapshot(t_s, at, 12.0, 6.0, GridPoint(0, 0), True, True, "follow", 50.0)
        guard, verdict = watch(limits, guard, seen)
        verdicts.append(verdict)
    reported = [verdict for verdict in verdicts if verdict is not None]
    assert [(verdict.rung, verdict.behind) for verdict in reported] == [("report", behind)]


@pytest.mark.parametrize(("late_s", "aside_m", "behind"), [(4.0, 4.5, True), (4.0, 9.0, False)])
def test_vehicle_that_swung_out_of_a_corner_late_is_behind_schedule(
    late_s: float, aside_m: float, behind: bool
) -> None:
    corner = [GridPoint(0, 0), GridPoint(60, 0), GridPoint(60, 60)]
    path = rounded_path(corner, 0.0, speed_m_s=6.0, cut_m=1.0)
    turn_s = next(t / 4 for t in range(200) if path.place_at(t / 4).north_m > 6.0)
    due = path.place_at(turn_s)
    at = GridPoint(due.east_m + aside_m, due.north_m)
    t_s = turn_s + late_s
    task = Task("path", 0.0, height_m=12.0, name="FlyPath", course=Course((path,)))
    seen = Snapshot(t_s, at, 12.0, 6.0, GridPoint(0, 0), True, True, "follow", 50.0)
    assert at.distance_to(path.place_at(t_s)) > OFF_PLAN_M
    assert is_behind(Guard().with_task(task), seen) is behind


# --- the guardian ------------------------------------------------------------------------------
def test_plans_that_follow_one_another_do_not_stop_the_guardians_clock() -> None:
    course = Course((line((0, 0), (50, 0)),))
    task = Task("path", 10.0, height_m=12.0, course=course)
    guard = replace(Guard().with_task(task), off_since_s=11.0, sunk_since_s=11.5)
    again = guard.with_task(replace(task, since_s=12.0))
    assert (again.off_since_s, again.sunk_since_s) == (11.0, 11.5)
    hover = guard.with_task(Task("hold", 12.0))
    assert (hover.off_since_s, hover.sunk_since_s) == (None, None)


# --- corners -----------------------------------------------------------------------------------
def test_corner_is_cut_by_its_own_distance() -> None:
    points = [GridPoint(0, 0), GridPoint(30, 0), GridPoint(30, 30), GridPoint(0, 30)]
    path = rounded_path(points, 0.0, speed_m_s=6.0, cut_m=[1.0, 0.005, 2.0, 1.0])
    places = [path.at(0.01 * k).place for k in range(round(path.end_s * 100))]
    near = [min(place.distance_to(point) for place in places) for point in points[1:3]]
    assert near == pytest.approx([0.005, 2.0], abs=0.03)
    with pytest.raises(ValueError, match="4 points have 2 cuts"):
        rounded_path(points, 0.0, speed_m_s=6.0, cut_m=[1.0, 1.0])


def test_a_path_that_arrives_leaves_nothing_to_wait_for() -> None:
    """A waiting vehicle gets a new plan, although no picture has come since."""
    made = flying()
    made.exploring(at=Cell(0, 6))
    first = made.path()
    made.post(Arrived(1, 60.0, first.at(first.end_s).place))
    for t_s in (61.0, 62.0, 63.0):
        made.post(Tracked(1, t_s, GridPoint(0.0, 0.0), 12.0, 50.0))
    assert isinstance(made.order(), FlyPath)


# --- as far as the fence allows ----------------------------------------------------------------
def test_a_path_whose_end_the_fence_forbids_is_flown_as_far_as_it_may_be() -> None:
    setting = flying().setting
    inside, outside = GridPoint(0.0, 30.0), GridPoint(900.0, 30.0)
    path = rounded_path([inside, outside], 20.0, speed_m_s=6.0)
    assert not allowed(setting.fence, path)
    short = as_far_as_allowed(setting.fence, path, setting.energy.accel_m_s2)
    assert short is not None
    assert allowed(setting.fence, short)
    assert short.begin_s == path.begin_s
    assert short.end_s > path.begin_s + WORTH_S
    assert all(short.at(20.0 + t / 4) == path.at(20.0 + t / 4) for t in range(8))
    at_rest = short.at(short.end_s)
    assert (at_rest.v_east_m_s, at_rest.v_north_m_s) == (0.0, 0.0)
    rim_m = setting.fence.inner.exterior.distance(Point(short.place_at(short.end_s)))
    assert rim_m < 6.0 * max(BEFORE_S)  # and hardly sooner than it has to


def test_a_path_that_has_to_end_at_once_is_refused_as_a_whole() -> None:
    setting = flying().setting
    near = setting.fence.inner.bounds[2] - 3.0
    path = rounded_path([GridPoint(near, 30.0), GridPoint(900.0, 30.0)], 20.0, speed_m_s=6.0)
    assert as_far_as_allowed(setting.fence, path, setting.energy.accel_m_s2) is None


def test_the_planner_goes_on_from_all_that_it_planned() -> None:
    made = flying()
    setting, vehicle = made.setting, made.state.vehicles[1]
    path = rounded_path([GridPoint(0.0, 30.0), GridPoint(900.0, 30.0)], 20.0, speed_m_s=6.0)
    short = as_far_as_allowed(setting.fence, path, setting.energy.accel_m_s2)
    assert short is not None
    vehicle = replace(vehicle, order=FlyPath(short, 12.0, None, 0.5))
    route = Route(((900.0, 30.0, 1.0),), (900.0,))
    flyer = flyer_of(setting, vehicle, path, route, 22.0)
    assert (flyer.path, flyer.route) == (path, route)
    braking = flyer_of(setting, vehicle, path, route, short.end_s - 0.5)
    assert (braking.path, braking.route) == (short, None)
