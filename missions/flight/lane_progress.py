"""How much of a lane is searched: as far as frames of it were judged, and no farther."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace

from missions.ground.grid import Grid
from missions.ground.lanes import Lane, along_m, offset_m, point_on, unseen
from missions.motion.trajectory import LANE_CUTS_M
from missions.orders import FlyPath
from missions.state import VehicleState
from missions.units import Cell, GridPoint

BESIDE_CELLS = 1.5
"""A frame that was taken farther from a lane shows another one."""
ON_ROW_M = 0.01
"""Lanes lie on rows of cells, or between them, but for rounding."""
STEP_S = 0.25
PASSED_M = 2.0 * LANE_CUTS_M[0]
"""A path passes the end of a lane so near by: it cuts the corner."""


def lane_seen(vehicle: VehicleState, grid: Grid, vantage: Cell, t_s: float) -> VehicleState:
    """The vehicle after a frame over `vantage` was judged: it counts for the lane it flies."""
    if not vehicle.on_lane or not vehicle.lanes:
        return vehicle
    lane = vehicle.lanes[0]
    place = grid.to_fixed(grid.centre_of(vantage), t_s)
    if offset_m(lane, place) > BESIDE_CELLS * grid.cell_m:
        return vehicle
    return replace(vehicle, lane_seen_m=(*vehicle.lane_seen_m, round(along_m(lane, place), 2)))


def lane_passed(
    vehicle: VehicleState, grid: Grid, rows: int, shown: Collection[Cell], t_s: float
) -> VehicleState:
    """The vehicle after a frame was judged on a path along its lanes.

    Args:
        vehicle: On a path along its lanes, or on none.
        grid: Of the mission.
        rows: How many rows of cells a lane decides.
        shown: The cells that the frame has judged.
        t_s: When it was taken.

    It counts for a lane if it shows all rows of it, there where the frame's middle is. When that is
    the second, and the path has passed the end of the first, that one is behind: what nobody saw of
    it is flown again after all others. On the way to the first a path may cross the second, which
    is not flown by that.
    """
    if not vehicle.on_lane or not shown:
        return vehicle
    cell_m = grid.cell_m
    east = sum(cell.east for cell in shown) / len(shown)
    north = sum(cell.north for cell in shown) / len(shown)
    middle = grid.to_fixed(GridPoint(east * cell_m, north * cell_m), t_s)
    for k, lane in enumerate(vehicle.lanes[:2]):
        along = along_m(lane, middle)
        place = point_on(lane, along)
        beside = place.distance_to(middle) > BESIDE_CELLS * cell_m
        if beside or not _across(grid, lane, place, rows, t_s) <= frozenset(shown):
            continue
        if k and not _is_behind(vehicle.lanes[0], vehicle, t_s):
            continue
        if k:
            rest = unseen(vehicle.lanes[0], vehicle.lane_seen_m, cell_m)
            vehicle = replace(vehicle, lanes=(*vehicle.lanes[1:], *rest), lane_seen_m=())
        seen_m = (*vehicle.lane_seen_m, round(along, 2))
        return replace(vehicle, lane_seen_m=seen_m)
    return vehicle


def _is_behind(lane: Lane, vehicle: VehicleState, t_s: float) -> bool:
    """Whether the path of a vehicle has led along a lane by `t_s`: past its start, then its end."""
    if not isinstance(vehicle.order, FlyPath):
        return True
    path = vehicle.order.trajectory
    ahead = list(lane)
    for k in range(math.floor(max(t_s - path.begin_s, 0.0) / STEP_S) + 1):
        near = path.at(path.begin_s + k * STEP_S).place.distance_to(ahead[0]) <= PASSED_M
        if near:
            ahead.pop(0)
        if not ahead:
            return True
    return False


def _across(grid: Grid, lane: Lane, place: GridPoint, rows: int, t_s: float) -> frozenset[Cell]:
    """The cells beside a place of a lane that the lane decides."""
    (start, end), cell_m = lane, grid.cell_m
    at = grid.to_moving(place, t_s)
    reach_m = (rows - 1) / 2 * cell_m + ON_ROW_M
    eastward = abs(end.east_m - start.east_m) >= abs(end.north_m - start.north_m)
    along, across_m = (at.east_m, at.north_m) if eastward else (at.north_m, at.east_m)
    column = math.floor(along / cell_m + 0.5)
    first = math.ceil((across_m - reach_m) / cell_m)
    last = math.floor((across_m + reach_m) / cell_m)
    return frozenset(
        Cell(column, row) if eastward else Cell(row, column) for row in range(first, last + 1)
    )


def lane_left(vehicle: VehicleState, cell_m: float) -> VehicleState:
    """The vehicle after it left its lane before the end: what nobody saw is left to fly."""
    if not vehicle.on_lane or not vehicle.lanes:
        return vehicle
    rest = unseen(vehicle.lanes[0], vehicle.lane_seen_m, cell_m)
    return replace(vehicle, lanes=(*rest, *vehicle.lanes[1:]), on_lane=False, lane_seen_m=())


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
