"""Lanes by their number in the mission: what members of a fleet call them."""

from __future__ import annotations

from typing import Final

from missions.flight.setting import Setting
from missions.flight.state import VehicleState
from missions.planning.search.lanes import Lane, along_m, offset_m
from missions.units import GridPoint

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
