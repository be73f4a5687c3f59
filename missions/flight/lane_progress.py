"""How much of a lane is searched: as far as frames of it were judged, and no farther."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import replace
from typing import Final

from missions.flight.setting import Setting
from missions.flight.state import VehicleState
from missions.geo.grid import Grid
from missions.geo.trajectory import LANE_CUTS_M
from missions.planning.search.lanes import Lane, along_m, offset_m, unseen
from missions.planning.search.strip import Strip
from missions.units import Cell, GridPoint

BESIDE_CELLS = 1.5
"""A frame that was taken farther from a lane shows another one."""
KNOWN_CELLS = 0.25
"""Columns that lie so near to one another are the same, but for a drift."""
STEP_S = 0.25
PASSED_M = 2.0 * LANE_CUTS_M[0]
"""A path passes the end of a lane so near by, or of the rows beside it: it cuts the corner."""


def lane_seen(
    vehicle: VehicleState,
    grid: Grid,
    rows: int,
    vantage: Cell,
    judged: Callable[[Cell], bool],
    t_s: float,
) -> VehicleState:
    """The vehicle after a frame over `vantage` was judged: it counts for the lane it flies.

    Only if all `rows` of the lane are judged there: a camera that leans in the wind, or is off the
    lane, shows what lies beside it. `judged` says of which cells that holds from this vantage.
    """
    if not vehicle.on_lane or not vehicle.lanes:
        return vehicle
    lane = vehicle.lanes[0]
    place = grid.to_fixed(grid.centre_of(vantage), t_s)
    if offset_m(lane, place) > BESIDE_CELLS * grid.cell_m:
        return vehicle
    strip = Strip.of(grid, lane, rows, t_s)
    column = vantage.east if strip.eastward else vantage.north
    if not all(judged(strip.cell(column, row)) for row in strip.rows):
        return vehicle
    return replace(vehicle, lane_seen_m=(*vehicle.lane_seen_m, round(along_m(lane, place), 2)))


def lane_passed(
    vehicle: VehicleState,
    grid: Grid,
    rows: int,
    judged: Callable[[Cell], bool],
    shown: Collection[Cell],
    t_s: float,
    *,
    drifts: bool = False,
) -> VehicleState:
    """The vehicle after a frame was judged on a path along its lanes.

    Args:
        vehicle: On a path along its lanes, or on none.
        grid: Of the mission.
        rows: How many rows of cells a lane decides.
        judged: Whether any frame has judged a cell, this one too.
        shown: The cells that the frame has judged.
        t_s: When it was taken.
        drifts: Whether lanes drift with the cells; else they lie still over ground.

    It counts for a lane there where all rows of it are judged by now. When that is the second, and
    the path has passed the end of the first, that one is behind: what nobody saw of it is flown
    again after all others. On the way to the first a path may cross the second, which is not flown
    by that.
    """
    if not vehicle.on_lane or not shown:
        return vehicle
    cell_m = grid.cell_m
    east = sum(cell.east for cell in shown) / len(shown)
    north = sum(cell.north for cell in shown) / len(shown)
    lanes_s = 0.0 if drifts else t_s
    middle = grid.to_fixed(GridPoint(east * cell_m, north * cell_m), lanes_s)
    for k, lane in enumerate(vehicle.lanes[:2]):
        if offset_m(lane, middle) > BESIDE_CELLS * cell_m:
            continue
        known_m = () if k else vehicle.lane_seen_m
        new_m = [
            along
            for along in Strip.of(grid, lane, rows, lanes_s).judged_m(judged, shown)
            if not any(abs(along - other) < KNOWN_CELLS * cell_m for other in known_m)
        ]
        if not new_m or (k and not _is_behind(vehicle.lanes[0], rows, grid, vehicle, t_s, drifts)):
            continue
        if k:
            rest = unseen(vehicle.lanes[0], vehicle.lane_seen_m, cell_m)
            vehicle = replace(vehicle, lanes=(*vehicle.lanes[1:], *rest), lane_seen_m=())
        return replace(vehicle, lane_seen_m=(*vehicle.lane_seen_m, *new_m))
    return vehicle


def _is_behind(
    lane: Lane, rows: int, grid: Grid, vehicle: VehicleState, t_s: float, drifts: bool
) -> bool:
    """Whether the path of a vehicle has led along a lane by `t_s`: past its start, then its end."""
    path = vehicle.path
    if path is None:
        return True
    near_m = PASSED_M + (rows - 1) / 2 * grid.cell_m
    ahead = list(lane)
    for k in range(math.floor(max(t_s - path.begin_s, 0.0) / STEP_S) + 1):
        at_s = path.begin_s + k * STEP_S
        place = path.place_at(at_s)
        if (grid.to_moving(place, at_s) if drifts else place).distance_to(ahead[0]) <= near_m:
            ahead.pop(0)
        if not ahead:
            return True
    return False


def lane_left(vehicle: VehicleState, cell_m: float) -> VehicleState:
    """The vehicle after it left its lane before the end: what nobody saw is left to fly."""
    if not vehicle.on_lane or not vehicle.lanes:
        return vehicle
    rest = unseen(vehicle.lanes[0], vehicle.lane_seen_m, cell_m)
    return replace(vehicle, lanes=(*rest, *vehicle.lanes[1:]), on_lane=False, lane_seen_m=())


def set_free(vehicle: VehicleState, cell_m: float) -> VehicleState:
    """The vehicle without what it did: it left its lane, and neither looks nor comes home."""
    left = lane_left(vehicle, cell_m)
    return replace(left, return_reason=None, over_home=False, at_target=False)


def lane_flown(vehicle: VehicleState, cell_m: float) -> VehicleState:
    """The vehicle at the end of its lane: stretches without a judged frame are flown again.

    It flies back along them, the nearest first.
    """
    rest = unseen(vehicle.lanes[0], vehicle.lane_seen_m, cell_m)
    back = tuple((end, start) for start, end in reversed(rest))
    empty = 0 if vehicle.lane_seen_m else vehicle.empty_passes + 1
    return replace(
        vehicle,
        lanes=(*back, *vehicle.lanes[1:]),
        on_lane=False,
        lane_seen_m=(),
        empty_passes=empty,
        fruitless_sorties=vehicle.fruitless_sorties if empty else 0,
    )


ON_LANE_M: Final = 0.5
"""A place that lies nearer to a lane lies on it."""


def lane_number(setting: Setting, lane: Lane) -> int | None:
    """Which lane of the mission a lane is, or is a part of, from 0; None for none of them."""
    for number, whole in enumerate(setting.lanes):
        if all(_lies_on(whole, place) for place in lane):
            return number
    return None


def lanes_held(setting: Setting, vehicle: VehicleState) -> tuple[int, ...]:
    """The numbers of the lanes that a vehicle has left, in the order of flight."""
    numbers = (lane_number(setting, lane) for lane in vehicle.lanes)
    return tuple(dict.fromkeys(number for number in numbers if number is not None))


def _lies_on(lane: Lane, place: GridPoint) -> bool:
    length_m, along = lane[0].distance_to(lane[1]), along_m(lane, place)
    return offset_m(lane, place) <= ON_LANE_M and 0.0 <= along <= length_m
