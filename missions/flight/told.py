"""What others of a fleet will see by the paths that they have told: nobody else has to.

A member plans its own vehicle's path only. Were it to plan for the others again, each member would
have others do what they do not know of, and two would map the same outline.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from missions.flight.optics import kinematics
from missions.flight.two_heights import at_map_height
from missions.orders import FlyPath
from missions.state import Phase, Setting, State, VehicleState
from missions.units import GridPoint

if TYPE_CHECKING:
    from missions.swath.chart import Chart, Flags


def mapping_others(setting: Setting, state: State) -> dict[int, VehicleState]:
    """The vehicles of other members that map, as they were last heard, by number."""
    if setting.member is None:
        return {}
    return {
        number: vehicle
        for number, vehicle in sorted(state.vehicles.items())
        if not state.is_ours(number)
        and vehicle.phase is Phase.AIRBORNE
        and vehicle.return_reason is None
        and not vehicle.lanes
    }


def seen_by_others(setting: Setting, state: State, chart: Chart, begin_s: float) -> Flags:
    """A 1 for each cell of a chart that as many pictures of another will show as decide it."""
    closed = np.zeros((chart.rows, chart.columns), np.uint8)
    for vehicle in mapping_others(setting, state).values():
        count = np.zeros_like(closed, dtype=np.int64)
        flown = kinematics(setting, at_map_height(setting, vehicle))
        for place in _places(setting, vehicle, begin_s, flown.frame_s):
            east, north = place.east_m / chart.cell_m, place.north_m / chart.cell_m
            wide, high = flown.half_east_m / chart.cell_m, flown.half_north_m / chart.cell_m
            rows = _span(north - high, north + high, chart.south, chart.rows)
            columns = _span(east - wide, east + wide, chart.west, chart.columns)
            count[rows, columns] += 1
        closed |= (count >= setting.mission.votes.positive).astype(np.uint8)
    return closed.ravel()


def _places(
    setting: Setting, vehicle: VehicleState, begin_s: float, frame_s: float
) -> Iterator[GridPoint]:
    """Where its pictures will be taken, in the frame of the region."""
    if not isinstance(vehicle.order, FlyPath):
        return
    path = vehicle.order.trajectory
    for k in range(max(0, math.ceil((path.end_s - begin_s) / frame_s))):
        t_s = begin_s + k * frame_s
        yield setting.grid.to_moving(path.place_at(t_s), t_s)


def _span(low: float, high: float, first: int, count: int) -> slice:
    """The cells of a row of `count` whose middle lies between two places."""
    begin, end = math.ceil(low) - first, math.floor(high) + 1 - first
    return slice(max(begin, 0), max(min(end, count), 0))
