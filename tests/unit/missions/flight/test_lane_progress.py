"""Which frames count for which lane, on a path that crosses one lane on its way to another."""

from __future__ import annotations

from missions.flight.lane_progress import lane_passed
from missions.flight.state import VehicleState
from missions.geo.grid import Grid
from missions.geo.trajectory import LANE_CUTS_M, Trajectory, rounded_path
from missions.orders import FlyPath
from missions.planning.search.lanes import unseen
from missions.units import Cell, GridPoint, LatLon

FAR = (GridPoint(60.0, 40.0), GridPoint(0.0, 40.0))
NEAR = (GridPoint(0.0, 28.0), GridPoint(60.0, 28.0))
CELL_M = 4.0
GRID = Grid.at(LatLon(48.0, 11.0), CELL_M)


def on_path() -> tuple[VehicleState, Trajectory]:
    """From home in the south-east over the middle of the second lane to the first."""
    points = [GridPoint(40.0, 0.0), *FAR, *NEAR]
    path = rounded_path(points, 10.0, speed_m_s=6.0, cut_m=LANE_CUTS_M[0])
    order = FlyPath(path, 12.0, 90.0, 0.2)
    return VehicleState(1, 12.0, order=order, lanes=(FAR, NEAR), on_lane=True), path


def flown(until: GridPoint, lost: bool = False) -> VehicleState:
    """After a frame every half second, up to where the path passes a place for the last time."""
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
        vehicle = lane_passed(vehicle, GRID, 3, judged.__contains__, shown, t_s)
    return vehicle


def test_a_lane_that_is_crossed_on_the_way_is_not_flown() -> None:
    vehicle = flown(GridPoint(30.0, 40.0))
    assert vehicle.lanes == (FAR, NEAR)
    assert min(vehicle.lane_seen_m) < 4.0
    assert max(vehicle.lane_seen_m) > 25.0


def test_the_second_lane_begins_when_the_first_is_behind() -> None:
    vehicle = flown(GridPoint(30.0, 28.0))
    assert vehicle.lanes == (NEAR,)  # and nothing of the first is left
    assert max(vehicle.lane_seen_m) > 25.0


def test_a_first_lane_without_frames_is_flown_again_at_the_end() -> None:
    vehicle = flown(GridPoint(30.0, 28.0), lost=True)
    assert vehicle.lanes == (NEAR, FAR)


def test_a_column_counts_once_all_its_rows_are_judged_by_whichever_frames() -> None:
    """A lane that is never in one picture in all its breadth is searched all the same."""
    path = rounded_path([NEAR[0], NEAR[1]], 10.0, speed_m_s=6.0)
    order = FlyPath(path, 12.0, 90.0, 0.2)
    vehicle = VehicleState(1, 12.0, order=order, lanes=(NEAR,), on_lane=True)
    judged: set[Cell] = set()
    for k in range(17):
        rows = (6, 7) if k % 2 else (7, 8)
        shown = [Cell(k + e, north) for e in (-1, 0, 1) for north in rows if k + e != 9]
        judged.update(shown)
        vehicle = lane_passed(vehicle, GRID, 3, judged.__contains__, shown, 10.0 + k)
    left = unseen(NEAR, vehicle.lane_seen_m, CELL_M)
    assert [(a.east_m, b.east_m) for a, b in left] == [(32.0, 40.0)]  # the ninth column
