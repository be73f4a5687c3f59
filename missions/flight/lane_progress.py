"""The searched part of a lane: as far as its frames were judged, and no farther."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import replace

from missions.events import FrameSeen
from missions.flight.state import Setting, State
from missions.flight.vehicle_state import VehicleState
from missions.geo.trajectory import LANE_CUTS_M
from missions.planning.search.lanes import along_m, number_among, offset_m, unseen_parts
from missions.units import Cell, GridPoint

MAX_LANE_OFFSET_CELLS = 1.5
"""Maximum distance of a frame from the lane that it shows, cells."""
MIN_COLUMN_GAP_CELLS = 0.25
"""Minimum distance of two columns that differ by more than the drift, cells."""
STEP_S = 0.25
PASSED_M = 2.0 * LANE_CUTS_M[0]
"""Distance at which a path passes the end of a lane, m; the path cuts the corner."""


def lane_seen(state: State, vehicle: VehicleState, event: FrameSeen, vantage: Cell) -> VehicleState:
    """Count a frame over `vantage` for a vehicle's lane if all rows were judged from there. A
    camera that the wind tilts, or that is off the lane, shows the ground beside it."""
    setting, shown = state.setting, {vote.cell for vote in event.votes}
    if not vehicle.on_lane or not vehicle.lanes:
        return vehicle
    lane, place = vehicle.lanes[0], setting.where(vantage, event.t_s)
    if offset_m(lane, place) > MAX_LANE_OFFSET_CELLS * setting.grid.cell_m:
        return vehicle
    strip = setting.strip(lane, event.t_s)
    column = vantage.east if strip.eastward else vantage.north
    for cell in (strip.cell(column, row) for row in strip.rows):
        if cell not in shown and state.belief.tally(cell, vantage).total == 0:
            return vehicle
    return replace(vehicle, lane_seen_m=(*vehicle.lane_seen_m, round(along_m(lane, place), 2)))


def lane_passed(
    setting: Setting,
    vehicle: VehicleState,
    t_s: float,
    shown: Collection[Cell],
    judged: Callable[[Cell], bool],
) -> VehicleState:
    """Count a frame at `t_s` that judged the cells `shown` for a vehicle's lanes.

    It counts where all rows of a lane are `judged` by now, by any frame. If the path has passed the
    end of the first lane, the unseen rest of that is flown again, last. A path may cross the second
    lane on its way to the first; that does not count.
    """
    if not vehicle.on_lane or not shown:
        return vehicle
    grid, cell_m = setting.grid, setting.grid.cell_m
    east = sum(cell.east for cell in shown) / len(shown)
    north = sum(cell.north for cell in shown) / len(shown)
    lanes_s = setting.lane_time_s(t_s)
    middle = grid.to_fixed(GridPoint(east * cell_m, north * cell_m), lanes_s)
    for k, lane in enumerate(vehicle.lanes[:2]):
        if offset_m(lane, middle) > MAX_LANE_OFFSET_CELLS * cell_m:
            continue
        known_m = () if k else vehicle.lane_seen_m
        new_m = [
            along
            for along in setting.strip(lane, t_s).judged_m(judged, shown)
            if not any(abs(along - other) < MIN_COLUMN_GAP_CELLS * cell_m for other in known_m)
        ]
        if not new_m or (k and not _is_behind(setting, vehicle, t_s)):
            continue
        if k:
            rest = unseen_parts(vehicle.lanes[0], vehicle.lane_seen_m, cell_m)
            vehicle = replace(vehicle, lanes=(*vehicle.lanes[1:], *rest), lane_seen_m=())
        return replace(vehicle, lane_seen_m=(*vehicle.lane_seen_m, *new_m))
    return vehicle


def _is_behind(setting: Setting, vehicle: VehicleState, t_s: float) -> bool:
    """Return whether the path of a vehicle has passed the start of its first lane, then the end."""
    path = vehicle.path
    if path is None:
        return True
    near_m = PASSED_M + (setting.lane_rows - 1) / 2 * setting.grid.cell_m
    ahead = list(vehicle.lanes[0])
    for k in range(math.floor(max(t_s - path.begin_s, 0.0) / STEP_S) + 1):
        at_s = path.begin_s + k * STEP_S
        if setting.to_lanes(path.place_at(at_s), at_s).distance_to(ahead[0]) <= near_m:
            ahead.pop(0)
        if not ahead:
            return True
    return False


def lane_left(vehicle: VehicleState, cell_m: float) -> VehicleState:
    """Have a vehicle leave its lane; the unseen rest stays to be flown."""
    if not vehicle.on_lane or not vehicle.lanes:
        return vehicle
    rest = unseen_parts(vehicle.lanes[0], vehicle.lane_seen_m, cell_m)
    return replace(vehicle, lanes=(*rest, *vehicle.lanes[1:]), on_lane=False, lane_seen_m=())


def set_free(vehicle: VehicleState, cell_m: float) -> VehicleState:
    """Have a vehicle drop its task: lane, observation or return."""
    left = lane_left(vehicle, cell_m)
    return replace(left, return_reason=None, over_home=False, at_target=False)


def lane_flown(vehicle: VehicleState, cell_m: float) -> VehicleState:
    """End a vehicle's first lane; it flies back along the unseen parts, nearest first."""
    rest = unseen_parts(vehicle.lanes[0], vehicle.lane_seen_m, cell_m)
    back = tuple((end, start) for start, end in reversed(rest))
    empty = 0 if vehicle.lane_seen_m else vehicle.empty_lanes + 1
    return replace(
        vehicle,
        lanes=(*back, *vehicle.lanes[1:]),
        on_lane=False,
        lane_seen_m=(),
        empty_lanes=empty,
        fruitless_sorties=vehicle.fruitless_sorties if empty else 0,
    )


def lanes_held(setting: Setting, vehicle: VehicleState) -> tuple[int, ...]:
    """Return the numbers of the lanes that a vehicle has left, in the order of flight."""
    numbers = (number_among(setting.lanes, lane) for lane in vehicle.lanes)
    return tuple(dict.fromkeys(number for number in numbers if number is not None))
