"""Mission items as files of ground stations: a QGroundControl plan, and QGC WPL 110.

A plan is JSON with the mission, the geofence and the rally points of one vehicle. QGC WPL 110 is
the text file of Mission Planner and others: the mission alone, its first row the home.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

from pymavlink.dialects.v20 import common as mav

from missions.mission_file.schema import Mission, positions
from missions.units import LatLon
from uavmap.offline.plan_items import DECIMALS, Above, Item, Profile

_ALTITUDE_MODES: Final = {Above.HOME: 1, Above.SEA: 2}
"""Of QGroundControl: relative to home, above the sea."""


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


@dataclass(frozen=True, slots=True)
class Survey:
    """A part of a plan that QGroundControl knows as a survey, with the items that fly it."""

    fields: dict[str, Any]
    """Of its object in the file, but for the items."""
    transects: tuple[LatLon, ...]
    """The beginning and the end of each line, one after the other."""
    items: tuple[Item, ...]


def plan(
    mission: Mission,
    home: LatLon,
    profile: Profile,
    parts: Sequence[Item | Survey],
    firmware: Firmware,
) -> str:
    """A QGroundControl plan of one vehicle, as text.

    The fence and the home are those of the mission. The rally points are the vehicle's home alone:
    an autopilot returns to the nearest of them, which might be the pad of another.
    """
    relative_m = profile.height_m
    if profile.above is Above.SEA:
        relative_m -= mission.start.amsl_m
    values = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "mission": {
            "version": 2,
            "firmwareType": firmware.number,
            "vehicleType": int(mav.MAV_TYPE_QUADROTOR),
            "globalPlanAltitudeMode": _ALTITUDE_MODES[profile.above],
            "cruiseSpeed": round(profile.speed_m_s, 2),
            "hoverSpeed": round(profile.speed_m_s, 2),
            "plannedHomePosition": [*_degrees(home), round(mission.start.amsl_m, 3)],
            "items": _items(parts),
        },
        "geoFence": {"version": 2, "circles": [], "polygons": _fence(mission)},
        "rallyPoints": {"version": 2, "points": [[*_degrees(home), round(relative_m, 3)]]},
    }
    return json.dumps(values, indent=2, allow_nan=False) + "\n"


def waypoints(mission: Mission, home: LatLon, items: Sequence[Item]) -> str:
    """The mission as QGC WPL 110, for Mission Planner and others; row 0 is the home.

    What the autopilot chooses is written as 0: the file has no word for it.
    """
    lat, lon = _degrees(home)
    first = Item(
        mav.MAV_CMD_NAV_WAYPOINT, int(Above.SEA), x=lat, y=lon, z=round(mission.start.amsl_m, 3)
    )
    rows = ["QGC WPL 110"]
    for number, item in enumerate([first, *items]):
        params = (0.0 if math.isnan(value) else value for value in item.params)
        values = (*(f"{p:.6f}" for p in params), f"{item.x:.8f}", f"{item.y:.8f}", f"{item.z:.6f}")
        head = (str(number), str(int(number == 0)), str(item.frame), str(item.command))
        rows.append("\t".join((*head, *values, "1")))
    return "\n".join(rows) + "\n"


# --- mission ------------------------------------------------------------------------------------
def _items(parts: Sequence[Item | Survey]) -> list[dict[str, Any]]:
    """Simple items and surveys, numbered from 1 through all of them."""
    found: list[dict[str, Any]] = []
    number = 1
    for part in parts:
        if isinstance(part, Item):
            found.append(_simple(part, number))
            number += 1
            continue
        found.append(_complex(part, number))
        number += len(part.items)
    return found


def _simple(item: Item, number: int) -> dict[str, Any]:
    params = [None if math.isnan(value) else value for value in item.params]
    values: dict[str, Any] = {
        "type": "SimpleItem",
        "command": item.command,
        "frame": item.frame,
        "params": [*params, item.x, item.y, item.z],
        "autoContinue": True,
        "doJumpId": number,
    }
    if item.has_place:
        mode = _ALTITUDE_MODES[Above(item.frame)]
        values |= {"AMSLAltAboveTerrain": None, "Altitude": item.z, "AltitudeMode": mode}
    return values


def _complex(survey: Survey, number: int) -> dict[str, Any]:
    inner = {
        **survey.fields["TransectStyleComplexItem"],
        "VisualTransectPoints": [_degrees(place) for place in survey.transects],
        "Items": [_simple(item, number + i) for i, item in enumerate(survey.items)],
    }
    return {**survey.fields, "TransectStyleComplexItem": inner}


# --- fence --------------------------------------------------------------------------------------
def _fence(mission: Mission) -> list[dict[str, Any]]:
    rings = [(mission.fence.polygon, True), *((hole, False) for hole in mission.fence.holes)]
    return [
        {"version": 1, "inclusion": inside, "polygon": ring_of(positions(ring))}
        for ring, inside in rings
    ]


def ring_of(ring: Sequence[LatLon]) -> list[list[float]]:
    """A ring as plans have it: open, clockwise, `[latitude, longitude]` in degrees.

    >>> ring_of([LatLon(0.0, 0.0), LatLon(0.0, 1.0), LatLon(1.0, 1.0), LatLon(0.0, 0.0)])
    [[1.0, 1.0], [0.0, 1.0], [0.0, 0.0]]
    """
    corners = list(ring[:-1] if ring[0] == ring[-1] else ring)
    # longitudes near the first one: a ring over the antimeridian would seem to go around the globe
    east = [math.remainder(c.lon_deg - corners[0].lon_deg, 360.0) for c in corners]
    area = sum(
        east[i - 1] * corner.lat_deg - east[i] * corners[i - 1].lat_deg
        for i, corner in enumerate(corners)
    )
    return [_degrees(corner) for corner in (reversed(corners) if area > 0 else corners)]


def _degrees(place: LatLon) -> list[float]:
    return [round(place.lat_deg, DECIMALS), round(place.lon_deg, DECIMALS)]
