"""How much of a lane is searched: as far as frames of it were judged, and no farther."""

from __future__ import annotations

from dataclasses import replace

from missions.ground.grid import Grid
from missions.ground.lanes import along_m, offset_m, unseen
from missions.state import VehicleState
from missions.units import Cell

BESIDE_CELLS = 1.5
"""A frame that was taken farther from a lane shows another one."""


def lane_seen(vehicle: VehicleState, grid: Grid, vantage: Cell, t_s: float) -> VehicleState:
    """The vehicle after a frame over `vantage` was judged: it counts for the lane it flies."""
    if not vehicle.on_lane or not vehicle.lanes:
        return vehicle
    lane = vehicle.lanes[0]
    place = grid.to_fixed(grid.centre_of(vantage), t_s)
    if offset_m(lane, place) > BESIDE_CELLS * grid.cell_m:
        return vehicle
    return replace(vehicle, lane_seen_m=(*vehicle.lane_seen_m, round(along_m(lane, place), 2)))


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
