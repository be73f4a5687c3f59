"""Frames that count for a lane, on a path that crosses one lane on its way to another."""

from __future__ import annotations

from dataclasses import replace

from missions.flight.lane_progress import lane_passed
from missions.flight.setting_of import setting_of
from missions.flight.vehicle_state import VehicleState
from missions.geo.trajectory import LANE_CUTS_M, Trajectory, rounded_path
from missions.orders import FlyPath
from missions.planning.search.lanes import unseen_parts
from missions.units import Cell, GridPoint
from tests.support.small_missions import mission, square

FAR = (GridPoint(60.0, 40.0), GridPoint(0.0, 40.0))
NEAR = (GridPoint(0.0, 28.0), GridPoint(60.0, 28.0))
CELL_M = 4.0
MISSION = mission(square(0, 20, 60, 30), square(-40, -20, 140, 100), strategy="swath")
SETTING = replace(setting_of(MISSION), lane_rows=3)


def on_path() -> tuple[VehicleState, Trajectory]:
    """Return a vehicle on a path from the south-east over the second lane to the first."""
    points = [GridPoint(40.0, 0.0), *FAR, *NEAR]
    path = rounded_path(points, 10.0, speed_m_s=6.0, cut_m=LANE_CUTS_M[0])
    order = FlyPath(path, 12.0, 90.0, 0.2)
    return VehicleState(1, 12.0, order=order, lanes=(FAR, NEAR), on_lane=True), path


def fly_lane(until: GridPoint, lost: bool = False) -> VehicleState:
    """Return the vehicle after frames every half second, until the path last passes a place."""
    vehicle, path = on_path()
    times = [path.begin_s + 0.5 * k for k in range(int((path.end_s - path.begin_s) * 2) + 1)]
    passed = [t for t in times if path.at(t).place.distance_to(until) < 2.5]
    judged: set[Cell] = set()
    for t_s in (t for t in times if t <= passed[-1]):
        place = path.at(t_s).place
        if lost and place.north_m > 34.0:
            continue
        east, north = round(place.east_m / CELL_M), round(place.north_m / CELL_M)
        shown = [Cell(east + e, north + n) for e in range(-2, 3) for n in range(-2, 3)]
        judged.update(shown)
        vehicle = lane_passed(SETTING, vehicle, t_s, shown, judged.__contains__)
    return vehicle


def test_a_lane_that_is_crossed_on_the_way_is_not_flown() -> None:
    vehicle = fly_lane(GridPoint(30.0, 40.0))
    assert vehicle.lanes == (FAR, NEAR)
    assert min(vehicle.lane_seen_m) < 4.0
    assert max(vehicle.lane_seen_m) > 25.0


def test_the_second_lane_begins_when_the_first_is_behind() -> None:
    vehicle = fly_lane(GridPoint(30.0, 28.0))
    assert vehicle.lanes == (NEAR,)  # the first is complete
    assert max(vehicle.lane_seen_m) > 25.0


def test_a_first_lane_without_frames_is_flown_again_at_the_end() -> None:
    vehicle = fly_lane(GridPoint(30.0, 28.0), lost=True)
    assert vehicle.lanes == (NEAR, FAR)


def test_a_column_counts_once_all_its_rows_are_judged_by_whichever_frames() -> None:
    path = rounded_path([NEAR[0], NEAR[1]], 10.0, speed_m_s=6.0)
    order = FlyPath(path, 12.0, 90.0, 0.2)
    vehicle = VehicleState(1, 12.0, order=order, lanes=(NEAR,), on_lane=True)
    judged: set[Cell] = set()
    for k in range(17):
        rows = (6, 7) if k % 2 else (7, 8)
        shown = [Cell(k + e, north) for e in (-1, 0, 1) for north in rows if k + e != 9]
        judged.update(shown)
        vehicle = lane_passed(SETTING, vehicle, 10.0 + k, shown, judged.__contains__)
    left = unseen_parts(NEAR, vehicle.lane_seen_m, CELL_M)
    assert [(a.east_m, b.east_m) for a, b in left] == [(32.0, 40.0)]  # the ninth column


def test_a_lane_is_searched_where_a_frame_shows_all_of_its_rows() -> None:
    vehicle = VehicleState(1, 12.0, lanes=((GridPoint(0, 20), GridPoint(40, 20)),), on_lane=True)
    whole = [Cell(e, n) for e in (4, 5, 6) for n in (4, 5, 6)]
    aside = [Cell(e, n) for e in (4, 5, 6) for n in (5, 6, 7)]
    one_m = (20.0,)
    for cells, rows, seen_m in ((whole, 3, one_m), (aside, 3, ()), (aside, 1, one_m), ([], 3, ())):
        setting = replace(SETTING, lane_rows=rows)
        passed = lane_passed(setting, vehicle, 0.0, cells, cells.__contains__)
        assert passed == replace(vehicle, lane_seen_m=seen_m)


def test_unseen_part_of_a_lane_that_lies_behind_is_flown_after_the_others() -> None:
    lanes = ((GridPoint(0, 20), GridPoint(40, 20)), (GridPoint(40, 32), GridPoint(0, 32)))
    vehicle = VehicleState(1, 12.0, lanes=lanes, on_lane=True)
    second = [Cell(e, n) for e in (8, 9, 10) for n in (7, 8, 9)]
    passed = lane_passed(SETTING, vehicle, 0.0, second, second.__contains__)
    assert passed.lanes == (lanes[1], lanes[0])
    assert passed.lane_seen_m == (4.0, 0.0)  # its end also: there is no column behind it
