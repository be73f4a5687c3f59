"""A fence and rally points as a QGroundControl plan: a file that ground stations open."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from uavmap.link.mission_transfer import Item
from uavmap.results.atomic import write_text

_POLYGONS = {
    mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION: True,
    mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION: False,
}
_CIRCLES = {
    mav.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION: True,
    mav.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION: False,
}
_PX4_FIRMWARE, _ARDUPILOT_FIRMWARE = 12, 3


def write_plan(
    path: Path, fence: Sequence[Item], rally: Sequence[Item], home: LatLon, *, px4: bool
) -> None:
    """Write a fence and rally points as a plan without a mission. Raises `OSError`."""
    write_text(path, json.dumps(plan(fence, rally, home, px4=px4), indent=2) + "\n")


def plan(
    fence: Sequence[Item], rally: Sequence[Item], home: LatLon, *, px4: bool
) -> dict[str, Any]:
    """The values of the file."""
    return {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "uavmap",
        "mission": {
            "version": 2,
            "firmwareType": _PX4_FIRMWARE if px4 else _ARDUPILOT_FIRMWARE,
            "vehicleType": int(mav.MAV_TYPE_QUADROTOR),
            "cruiseSpeed": 5,
            "hoverSpeed": 5,
            "globalPlanAltitudeMode": 1,
            "plannedHomePosition": [home.lat_deg, home.lon_deg, 0],
            "items": [],
        },
        "geoFence": {"version": 2, "polygons": _polygons(fence), "circles": _circles(fence)},
        "rallyPoints": {
            "version": 2,
            "points": [[i.position.lat_deg, i.position.lon_deg, i.height_m] for i in rally],
        },
    }


def _polygons(fence: Sequence[Item]) -> list[dict[str, Any]]:
    found, at = [], 0
    while at < len(fence):
        item = fence[at]
        count = max(int(item.first), 1) if item.command in _POLYGONS else 1
        if item.command in _POLYGONS:
            ring = [[i.position.lat_deg, i.position.lon_deg] for i in fence[at : at + count]]
            found.append({"inclusion": _POLYGONS[item.command], "polygon": ring, "version": 1})
        at += count
    return found


def _circles(fence: Sequence[Item]) -> list[dict[str, Any]]:
    return [
        {
            "circle": {
                "center": [item.position.lat_deg, item.position.lon_deg],
                "radius": item.first,
            },
            "inclusion": _CIRCLES[item.command],
            "version": 1,
        }
        for item in fence
        if item.command in _CIRCLES
    ]
