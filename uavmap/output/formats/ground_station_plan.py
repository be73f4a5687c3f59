"""Mission items as files of ground stations: a QGroundControl plan, and QGC WPL 110.

A plan is JSON with the mission, the geofence and the rally points of one vehicle. QGC WPL 110 is
the text file of Mission Planner and others: the mission alone, its first row the home.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from enum import StrEnum
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from uavmap.mavlink.mission_transfer import Item

DECIMALS: Final = 8
"""Decimals of degrees: a millimetre, finer than the 1e-7 degrees that go over the link."""
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
        """MAV_AUTOPILOT.

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

    Args:
        fence: Vertices of polygons and circles, as they are uploaded.
        rally: Rally points, heights above the home.
        items: Of the mission.
        home_amsl_m: Height of the planned home above the sea, m.
        speed_m_s: Over ground.
        frame: MAV_FRAME of the mission's heights.
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

    A parameter that the autopilot chooses is 0: the format has no other value for it.
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
