"""Lanes that are flown without stops: order, places beside their rows, and vehicles."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import pytest

from missions.events import Arrived, FrameSeen, Vote
from missions.flight.setting_of import setting_of
from missions.flight.state import State
from missions.flight.step import step
from missions.flight.strategy.lane_paths import (
    flown_along,
    give_up_lane,
    search_paths,
    still_open,
)
from missions.flight.vehicle_state import Phase, VehicleState
from missions.geo.path_in_fence import allowed
from missions.mission.fleet_checks import with_own_air
from missions.orders import FlyPath, FlyTo
from missions.planning.search.lanes import turned
from missions.units import Cell, GridPoint
from tests.support.small_missions import square
from tests.unit.missions.flight.test_step import Service, over
from uavmap.load.mission_source import load

BOX, FENCE = square(-10, 16, 90, 40), square(-60, -60, 200, 200)


def service(strategy: str, vehicles: int = 1) -> Service:
    made = over(BOX, FENCE, vehicles=vehicles, strategy=strategy, mounting="gimbal")
    made.connect_all()
    return made


def post_frame(made: Service, t_s: float, cells: Iterable[Cell], vehicle: int = 1) -> None:
    """Post a frame of some cells that are not region."""
    made.post(FrameSeen(vehicle, t_s, None, tuple(Vote(cell, False, 0.0) for cell in cells)))


def rows_of(made: Service, k: int) -> range:
    """Return the rows of a lane, from its place and their number."""
    middle = made.setting.lanes[k][0].north_m / made.setting.grid.cell_m
    rows = made.setting.lane_rows
    return range(round(middle - (rows - 1) / 2), round(middle + (rows - 1) / 2) + 1)


def first(state: State) -> VehicleState:
    return state.vehicles[1]


def test_part_of_a_lane_that_others_have_judged_is_not_flown() -> None:
    made = service("swath")
    lanes, rows = made.setting.lanes, rows_of(made, 0)
    post_frame(made, 5.0, [Cell(e, n) for e in range(-5, 25) for n in rows if not 3 <= e <= 5])
    left = still_open(made.state, lanes)
    assert left[1:] == lanes[1:]
    ((start, end),) = left[:1]
    # the three columns, 10 m to 22 m, and half a cell more to either side
    assert sorted((start.east_m, end.east_m)) == pytest.approx([8.0, 24.0], abs=0.01)


def test_a_rest_is_flown_with_the_missing_row_in_the_middle() -> None:
    made = service("swath")
    lane, rows = made.setting.lanes[1], rows_of(made, 1)
    post_frame(made, 5.0, [Cell(e, n) for e in range(-5, 25) for n in rows if n != rows[-1]])
    start, end = flown_along(made.state, first(made.state), lane)
    assert start.north_m == end.north_m == rows[-1] * made.setting.grid.cell_m
    assert (start.east_m, end.east_m) == (lane[0].east_m, lane[1].east_m)


def test_a_short_rest_is_left_to_the_planner_in_a_survey_and_flown_in_a_search() -> None:
    for strategy, flown in (("survey", False), ("swath", True)):
        made = service(strategy)
        lane = made.setting.lanes[0]
        rest = (lane[0], GridPoint(lane[0].east_m + 12.0, lane[0].north_m))
        left = still_open(made.state, (rest, *made.setting.lanes[1:]))
        assert (rest in left) is flown
        assert left[-1] == made.setting.lanes[-1]


def test_lanes_are_begun_at_the_nearer_end() -> None:
    setting = service("swath").setting
    lanes = tuple((end, start) for start, end in setting.lanes)
    assert turned(setting.lanes[0][0], lanes, keep=setting.aimed_lanes) == setting.lanes


def test_waiting_vehicle_of_a_survey_flies_the_lanes_of_one_that_dropped_out() -> None:
    made = service("survey", vehicles=2)
    failed = replace(first(made.state), phase=Phase.FAILED, lanes=made.setting.lanes)
    made.state = made.state.with_vehicle(failed)
    made.fly(2, GridPoint(40.0, 30.0), lanes=())
    made.track(2, GridPoint(40.0, 30.0), 18.0)
    assert isinstance(made.order(2), FlyPath)
    assert len(made.state.vehicles[2].lanes) == 1
    assert len(first(made.state).lanes) == len(failed.lanes) - 1


def test_lane_of_a_survey_that_a_path_leads_along_is_not_given_to_another() -> None:
    made = service("survey", vehicles=2)
    made.fly(1, GridPoint(0.0, 0.0))
    made.track(1, GridPoint(0.0, 0.0), 12.0)
    assert made.path(1).end_s > made.now_s
    lanes = first(made.state).lanes
    made.fly(2, GridPoint(40.0, 30.0), lanes=())
    made.track(2, GridPoint(40.0, 30.0), 18.0)
    assert first(made.state).lanes == lanes
    assert made.state.vehicles[2].lanes == ()


def test_vehicle_on_lanes_that_others_have_seen_meanwhile_brakes() -> None:
    made = service("survey", vehicles=2)
    made.fly(1, GridPoint(0.0, 0.0))
    made.track(1, GridPoint(0.0, 0.0), 12.0)
    path = made.path(1)
    for k in range(3):
        post_frame(made, made.now_s + 0.1 * (k + 1), made.setting.box_cells, vehicle=2)
        rim = [Cell(e, n) for e in range(-6, 26) for n in range(2, 18)]
        post_frame(made, made.now_s + 0.05, rim, vehicle=2)
    assert made.path(1).end_s < path.end_s - 20.0


def test_give_up_lane_the_last_one_leaves_no_lane_to_end() -> None:
    made = service("swath")
    lane, here = made.setting.lanes[0], GridPoint(0.0, 0.0)
    vehicle = replace(
        first(made.state), phase=Phase.AIRBORNE, landed=False, lanes=(lane,), on_lane=True,
        lane_seen_m=(3.0,),
    )  # fmt: skip
    state = give_up_lane(made.state, vehicle)
    assert state.unreachable_lanes == (lane,)
    assert (first(state).lanes, first(state).on_lane, first(state).lane_seen_m) == ((), False, ())
    after, _ = step(state, Arrived(1, 30.0, here))
    assert first(after).position == here


@pytest.mark.parametrize("t_s", [20.0, 90.0, 300.0])
def test_path_round_the_pads_of_others_is_always_found_in_a_drift(t_s: float) -> None:
    flown = with_own_air(load("bay"))
    for number in range(1, 6):
        setting = setting_of(flown, number)
        state = replace(setting.initial_state(), t_s=t_s)
        vehicle = replace(
            state.vehicles[number], phase=Phase.AIRBORNE, landed=False, order=None, height_m=90.0,
            position=setting.pad_of(number), remaining_wh=60.0, lanes=setting.shares[number - 1],
        )  # fmt: skip
        after = search_paths(state.with_vehicle(vehicle), vehicle).vehicles[number]
        if isinstance(after.order, FlyPath):
            assert allowed(setting.fence, after.order.trajectory)
        else:
            assert isinstance(after.order, FlyTo)
            assert after.order.route[-1].distance_to(after.lanes[0][0]) < 120.0
