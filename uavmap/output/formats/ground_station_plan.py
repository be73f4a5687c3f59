"""The search of a mission as items that an autopilot flies by itself, and ground stations' files.

A vehicle climbs over its pad, flies its lanes and takes pictures along them. Then it flies back
over its pad by a path inside the fence, and RTL lands it there. RTL alone would fly straight home,
over ground that the fence excludes. The pictures are not judged.

A plan of QGroundControl is JSON with mission, geofence and rally points of one vehicle. QGC WPL 110
is the text file of Mission Planner and others: the mission alone, its first row the home.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import GeodesyError
from missions.flight.state import Setting
from missions.mission.places import homes
from missions.mission.schema import Mission, positions
from missions.mission.views import path_speed_m_s
from missions.planning.search.lanes import Lane
from missions.units import GridPoint, LatLon
from uavmap.mavlink.mission_transfer import Item

_SAME_M: Final = 0.01
"""Distance below which two points of a path are one, m."""
_GROUND_SPEED: Final = 1
"""SPEED_TYPE of MAV_CMD_DO_CHANGE_SPEED: over ground."""


class Pace(NamedTuple):
    """Height above home, m; speed over ground, m/s; distance of two pictures of a lane, m."""

    height_m: float
    speed_m_s: float
    every_m: float


@dataclass(frozen=True, slots=True)
class SearchFlight:
    """The search of one vehicle.

    Attributes:
        vehicle: Number of the vehicle, from 0.
        speed_m_s: Speed over ground.
        fence: Fence of the mission, as corners of polygons.
        rally: The vehicle's home alone: an autopilot returns to the nearest rally point, which
            might be the pad of another vehicle.
        left_out: Lanes to which no path inside the fence leads.
    """

    vehicle: int
    home: LatLon
    speed_m_s: float
    items: tuple[Item, ...]
    fence: tuple[Item, ...]
    rally: tuple[Item, ...]
    left_out: tuple[Lane, ...]


def search_flight(
    setting: Setting, vehicle: int, frame: int = mav.MAV_FRAME_GLOBAL_RELATIVE_ALT
) -> SearchFlight:
    """Plan the share of a vehicle (from 0) of the search lanes, in the order of flight.

    `frame` is the MAV_FRAME of the heights: above home, or above the sea. Raises `GeodesyError` if
    no path inside the fence leads back to the home.
    """
    mission = setting.mission
    height_m = mission.search_altitude_m(vehicle) or mission.altitude_m(vehicle)
    speed_m_s, every_m = mission.flight.speed_m_s, mission.grid.cell_m
    if not setting.strategy.stops:
        speed_m_s = path_speed_m_s(mission, height_m)
        every_m = speed_m_s * mission.camera.interval_s
    pace = Pace(height_m, speed_m_s, every_m)
    return flight_along(setting, vehicle, setting.shares[vehicle], pace, frame)


def flight_along(
    setting: Setting,
    vehicle: int,
    lanes: Sequence[Lane],
    pace: Pace,
    frame: int = mav.MAV_FRAME_GLOBAL_RELATIVE_ALT,
) -> SearchFlight:
    """Plan the flight of a vehicle (from 0) along lanes; otherwise as `search_flight`."""
    mission, grid, fence = setting.mission, setting.grid, setting.fence
    home, height_m = homes(mission)[vehicle], pace.height_m
    at_height_m = height_m + (mission.start.amsl_m if frame == mav.MAV_FRAME_GLOBAL else 0.0)

    def at(place: LatLon, command: int = mav.MAV_CMD_NAV_WAYPOINT) -> Item:
        return Item(command, place, 0.0, frame, round(at_height_m, 3), (0.0, 0.0, math.nan))

    items = [
        at(home, mav.MAV_CMD_NAV_TAKEOFF),
        _order(mav.MAV_CMD_DO_CHANGE_SPEED, _GROUND_SPEED, round(pace.speed_m_s, 2), -1.0),
    ]
    here, left_out = grid.fixed(home), list[Lane]()
    for lane in lanes:
        path = fence.route(here, lane[0])
        if path is None:
            left_out.append(lane)
            continue
        items += [at(grid.position(point)) for point in _new(here, path)]
        items += [_pictures(pace.every_m), at(grid.position(lane[1])), _pictures(0.0)]
        here = lane[1]
    back = fence.route(here, grid.fixed(home))
    if back is None:  # not expected: a path from the pad leads here
        raise GeodesyError("no path inside the fence leads back to the home")
    points = list(_new(here, back))
    items += [at(grid.position(point)) for point in points[:-1]]
    items += [at(home)] if points else []
    items.append(_order(mav.MAV_CMD_NAV_RETURN_TO_LAUNCH))
    rally = Item(mav.MAV_CMD_NAV_RALLY_POINT, home, height_m=height_m)
    return SearchFlight(
        vehicle, home, pace.speed_m_s, tuple(items), _fence(mission), (rally,), tuple(left_out)
    )


def _order(command: int, first: float = 0.0, second: float = 0.0, third: float = 0.0) -> Item:
    frame = mav.MAV_FRAME_MISSION
    return Item(command, LatLon(0.0, 0.0), first, frame, others=(second, third, 0.0))


def _pictures(every_m: float) -> Item:
    """Create the item for a picture now and then every `every_m` metres; 0 stops them."""
    return _order(
        mav.MAV_CMD_DO_SET_CAM_TRIGG_DIST, round(every_m, 3), 0.0, 1.0 if every_m else 0.0
    )


def _new(at: GridPoint, path: Sequence[GridPoint]) -> Iterator[GridPoint]:
    for point in path:
        if at.distance_to(point) > _SAME_M:
            yield point
        at = point


def _fence(mission: Mission) -> tuple[Item, ...]:
    inclusion = mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
    exclusion = mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
    rings = [(inclusion, mission.fence.polygon), *((exclusion, h) for h in mission.fence.holes)]
    return tuple(
        Item(command, corner, float(len(corners)))
        for command, ring in rings
        for corners in [clockwise(positions(ring))]
        for corner in corners
    )


def clockwise(ring: Sequence[LatLon]) -> list[LatLon]:
    """Open a ring and order its corners clockwise, as QGroundControl draws them.

    >>> [c.lat_deg for c in clockwise([LatLon(0.0, 0.0), LatLon(0.0, 1.0), LatLon(1.0, 1.0)])]
    [1.0, 0.0, 0.0]
    """
    corners = list(ring[:-1] if ring[0] == ring[-1] else ring)
    # longitudes near the first one: else a ring over the antimeridian would span the globe
    east = [math.remainder(c.lon_deg - corners[0].lon_deg, 360.0) for c in corners]
    area = sum(
        east[i - 1] * corner.lat_deg - east[i] * corners[i - 1].lat_deg
        for i, corner in enumerate(corners)
    )
    return corners[::-1] if area > 0 else corners


# --- the files ------------------------------------------------------------------------------------
DECIMALS: Final = 8
"""Decimals of degrees: a millimetre, finer than the 1e-7 degrees of MAVLink."""
_ALTITUDE_MODES: Final = {mav.MAV_FRAME_GLOBAL_RELATIVE_ALT: 1, mav.MAV_FRAME_GLOBAL: 2}
"""AltitudeMode of QGroundControl by MAV_FRAME: above home, above the sea."""
_POLYGONS: Final = {
    mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION: True,
    mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION: False,
}
_CIRCLES: Final = {
    mav.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION: True,
    mav.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION: False,
}


class Firmware(StrEnum):
    """The autopilot that a plan is for."""

    ARDUPILOT = "ardupilot"
    PX4 = "px4"

    @property
    def number(self) -> int:
        """Its MAV_AUTOPILOT.

        >>> Firmware.ARDUPILOT.number, Firmware.PX4.number
        (3, 12)
        """
        px4 = self is Firmware.PX4
        return int(mav.MAV_AUTOPILOT_PX4 if px4 else mav.MAV_AUTOPILOT_ARDUPILOTMEGA)


def plan_text(
    firmware: Firmware,
    home: LatLon,
    fence: Sequence[Item],
    rally: Sequence[Item],
    items: Sequence[Item] = (),
    *,
    home_amsl_m: float = 0.0,
    speed_m_s: float = 5.0,
    frame: int = mav.MAV_FRAME_GLOBAL_RELATIVE_ALT,
) -> str:
    """Encode a QGroundControl plan of one vehicle.

    `fence` is in the form of an upload; `rally` has heights above home. `speed_m_s` is the speed
    over ground; `frame` is the MAV_FRAME of the mission's heights.
    """
    circles = [
        {
            "version": 1,
            "inclusion": _CIRCLES[item.command],
            "circle": {"center": _degrees(item.position), "radius": item.first},
        }
        for item in fence
        if item.command in _CIRCLES
    ]
    values = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "mission": {
            "version": 2,
            "firmwareType": firmware.number,
            "vehicleType": int(mav.MAV_TYPE_QUADROTOR),
            "globalPlanAltitudeMode": _ALTITUDE_MODES[frame],
            "cruiseSpeed": round(speed_m_s, 2),
            "hoverSpeed": round(speed_m_s, 2),
            "plannedHomePosition": [*_degrees(home), round(home_amsl_m, 3)],
            "items": [_simple_item(item, number) for number, item in enumerate(items, start=1)],
        },
        "geoFence": {"version": 2, "circles": circles, "polygons": _polygons(fence)},
        "rallyPoints": {
            "version": 2,
            "points": [[*_degrees(point.position), round(point.height_m, 3)] for point in rally],
        },
    }
    return json.dumps(values, indent=2, allow_nan=False) + "\n"


def waypoints_text(home: LatLon, home_amsl_m: float, items: Sequence[Item]) -> str:
    """Encode a mission as QGC WPL 110, for Mission Planner and others; row 0 is the home.

    A parameter that is left to the autopilot is 0: the format has no other value for it.
    """
    first = Item(mav.MAV_CMD_NAV_WAYPOINT, home, height_m=round(home_amsl_m, 3))
    rows = ["QGC WPL 110"]
    for number, item in enumerate([first, *items]):
        params = (0.0 if math.isnan(value) else value for value in (item.first, *item.others))
        lat, lon = _degrees(item.position)
        values = (*(f"{p:.6f}" for p in params), f"{lat:.8f}", f"{lon:.8f}", f"{item.height_m:.6f}")
        head = (str(number), str(int(number == 0)), str(item.frame), str(item.command))
        rows.append("\t".join((*head, *values, "1")))
    return "\n".join(rows) + "\n"


def _simple_item(item: Item, number: int) -> dict[str, Any]:
    params = [None if math.isnan(value) else value for value in (item.first, *item.others)]
    values: dict[str, Any] = {
        "type": "SimpleItem",
        "command": item.command,
        "frame": item.frame,
        "params": [*params, *_degrees(item.position), item.height_m],
        "autoContinue": True,
        "doJumpId": number,
    }
    if item.frame in _ALTITUDE_MODES:
        mode = _ALTITUDE_MODES[item.frame]
        values |= {"AMSLAltAboveTerrain": None, "Altitude": item.height_m, "AltitudeMode": mode}
    return values


def _polygons(fence: Sequence[Item]) -> list[dict[str, Any]]:
    found, at = list[dict[str, Any]](), 0
    while at < len(fence):
        inside = _POLYGONS.get(fence[at].command)
        count = 1 if inside is None else max(int(fence[at].first), 1)
        if inside is not None:
            ring = [_degrees(vertex.position) for vertex in fence[at : at + count]]
            found.append({"version": 1, "inclusion": inside, "polygon": ring})
        at += count
    return found


def _degrees(place: LatLon) -> list[float]:
    return [round(place.lat_deg, DECIMALS), round(place.lon_deg, DECIMALS)]
