"""Where a camera was when it took a picture, by its announcement, if that can be."""

from __future__ import annotations

import math
from typing import Final

from missions.errors import GeodesyError, ImageError
from missions.ground.grid import Grid
from missions.units import LatLon, Pose, Quaternion
from uavmap.link.continuity import FASTEST_M_S, distance_m
from uavmap.link.rules import unit_fault
from uavmap.link.session import Message
from uavmap.link.view import VehicleView

APART_M: Final = 15.0
"""How far the camera's own idea of the place may be from where the autopilot then was."""
SURE_S: Final = 1.0
"""So far from the nearest position in time the vehicle is where its speed has taken it."""
_LOWEST_M, _HIGHEST_M = -500.0, 10_000.0


def pose_of(message: Message, view: VehicleView, grid: Grid, taken_s: float) -> Pose:
    """The pose that a CAMERA_IMAGE_CAPTURED tells, of a picture taken at a time of the loop.

    Raises `ImageError` with what is wrong where it cannot be the camera of this vehicle.
    """
    fault = pose_fault(message, view, grid, taken_s)
    if fault is not None:
        raise ImageError(f"the camera tells no usable pose: {fault}")
    return Pose(
        LatLon(message.lat / 1e7, message.lon / 1e7),
        view.height_of(message),
        Quaternion(*message.q),
    )


def pose_fault(message: Message, view: VehicleView, grid: Grid, taken_s: float) -> str | None:
    """What is wrong with the pose of an announcement; None if nothing is.

    It is held against where the vehicle was when the picture was taken, and not where it is by now.
    """
    position = LatLon(message.lat / 1e7, message.lon / 1e7)
    height_m = view.height_of(message)
    if message.lat == message.lon == 0:
        return "latitude and longitude are zero"
    if abs(position.lat_deg) > 90.0 or abs(position.lon_deg) > 180.0:
        return "the position is not on Earth"
    if not _LOWEST_M <= height_m <= _HIGHEST_M:
        return "the height is out of range"
    if fault := unit_fault(*message.q):
        return fault
    place = view.place_at(taken_s)
    if view.position is None or place is None:
        return "the vehicle has not said where it is"
    most_m = APART_M + FASTEST_M_S * max(place.gap_s - SURE_S, 0.0)
    if distance_m(position, place.position) > most_m:
        return "the position is not where the vehicle was"
    if abs(height_m - place.height_m) > most_m:
        return "the height is not that of the vehicle"
    try:
        finite = all(map(math.isfinite, grid.fixed(position)))
    except GeodesyError:
        finite = False
    return None if finite else "the position is outside of the map"
