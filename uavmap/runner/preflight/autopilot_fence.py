"""The fence of the autopilot that fits a mission: its polygon, its heights, its parameters.

It lies outside of the mission's own, by as far as our own vehicle can get before the guardian has
stopped it: the mission and its guardian come first, the autopilot is what is left when this
computer does not act.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import shapely
from pymavlink.dialects.v20 import ardupilotmega as mav
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from missions.flight.setting import Setting
from missions.guardian.thresholds import OUTSIDE_S
from missions.mission.height_and_speed import LEAST_HEIGHT_M
from missions.units import GridPoint, LatLon
from uavmap.mavlink.autopilots import PX4, Autopilot
from uavmap.mavlink.mission_transfer import Item

LEAST_OUTSIDE_M: Final = 5.0
"""Two receivers of satellite navigation, a home that arming moves, a gust."""
ABOVE_M: Final = 10.0
"""The ceiling lies so far above the highest that is flown: a climb overshoots, barometers drift."""
MITRE: Final = 2.0
INCLUSION: Final = int(mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION)
EXCLUSION: Final = int(mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION)
ARDUPILOT_FENCE: Final = (
    "FENCE_ENABLE", "FENCE_TYPE", "FENCE_ACTION", "FENCE_ALT_MAX", "FENCE_RADIUS", "FENCE_ALT_MIN",
)  # fmt: skip
PX4_FENCE: Final = ("GF_ACTION", "GF_MAX_VER_DIST", "GF_MAX_HOR_DIST")
TYPE_ALT_MAX, TYPE_CIRCLE, TYPE_POLYGON, TYPE_ALT_MIN = 1, 2, 4, 8
"""Bits of FENCE_TYPE."""
_RETURN: Final = 1
_PX4_RETURN: Final = 3


@dataclass(frozen=True, slots=True)
class FencePlan:
    """What is to be set on the autopilot of one vehicle."""

    fence: tuple[Item, ...]
    rally: tuple[Item, ...]
    parameters: Mapping[str, float]
    outside_m: float
    """How far its polygon lies outside of the mission's."""
    holes_left_out: int
    """Holes of the mission's fence that are too narrow to be made smaller by as much."""
    columns_left_out: tuple[int, ...] = ()
    """Other vehicles of a fleet, the air over whose pads is too narrow for that."""


def outside_m(speed_m_s: float, accel_m_s2: float) -> float:
    """How far outside of the mission's fence a vehicle of ours may get, in metres.

    The guardian takes it after 2 s outside; then it brakes.

    >>> round(outside_m(6.0, 2.0), 1)
    21.0
    """
    brakes_m = speed_m_s**2 / (2.0 * accel_m_s2)
    return max(LEAST_OUTSIDE_M, speed_m_s * OUTSIDE_S + brakes_m)


def fence_plan(
    setting: Setting,
    number: int,
    home: LatLon,
    kind: Autopilot,
    found: Mapping[str, float],
) -> FencePlan:
    """What fits vehicle `number` (from 1), which stands at `home`.

    Args:
        found: Its parameters.
    """
    by_m = outside_m(setting.mission.flight.speed_m_s, setting.energy.accel_m_s2)
    rings = [_ring(Polygon(setting.fence.outer.exterior).buffer(
        by_m, join_style="mitre", mitre_limit=MITRE))]  # fmt: skip
    holes, columns = 0, list[int]()
    for ring in setting.fence.outer.interiors:
        hole = Polygon(ring)
        smaller = hole.buffer(-by_m, join_style="mitre", mitre_limit=MITRE)
        if smaller.is_empty:
            pads = _others_inside(setting, hole)
            columns += pads
            holes += not pads
        rings += [_ring(part) for part in _parts(smaller)]
    fence = [
        Item(EXCLUSION if index else INCLUSION, setting.grid.position(point), float(len(ring)))
        for index, ring in enumerate(rings)
        for point in ring
    ]
    # at the height of the ground: PX4 adds its return height, an ArduPilot takes the higher of both
    rally = Item(
        mav.MAV_CMD_NAV_RALLY_POINT, home, frame=mav.MAV_FRAME_GLOBAL_RELATIVE_ALT, height_m=0.0
    )
    parameters = _parameters(setting, number, home, kind, found)
    return FencePlan(tuple(fence), (rally,), parameters, by_m, holes, tuple(sorted(columns)))


def _others_inside(setting: Setting, hole: Polygon) -> list[int]:
    """The other vehicles of a fleet whose pads lie in a hole: it is the air over them."""
    if not setting.member:
        return []
    others = set(range(1, len(setting.mission.vehicles) + 1)) - {setting.member}
    return [n for n in sorted(others) if hole.contains(shapely.Point(setting.pad_of(n)))]


def highest_above_m(setting: Setting, home: LatLon) -> float:
    """The highest ground in the fence above a vehicle's home, at least 0; 0 where it is flat."""
    if setting.ground is None:
        return 0.0
    home_m = setting.ground.height_m(setting.grid.fixed(home))
    above_m = max(setting.mission.highest_ground_m - home_m, 0.0)
    return math.ceil(above_m * 10.0 - 1e-6) / 10.0


def _parameters(
    setting: Setting,
    number: int,
    home: LatLon,
    kind: Autopilot,
    found: Mapping[str, float],
) -> dict[str, float]:
    returns_m = return_height_m(setting, number, home, kind, found)
    highest_m, vehicles = highest_above_m(setting, home), len(setting.mission.vehicles)
    tops_m = [setting.mission.top_altitude_m(i) for i in range(vehicles)]
    highest_flown_m = max(tops_m) + highest_m - min(setting.home_level_m(number), 0.0)
    top_m = float(math.ceil(max(highest_flown_m, returns_m or 0.0) + ABOVE_M))
    sets = vehicles > 1 or setting.ground is not None
    layer_m = returns_m if sets and returns_m is not None else 0.0
    if kind is PX4:
        wanted = {"GF_ACTION": _PX4_RETURN, "GF_MAX_VER_DIST": top_m, "GF_MAX_HOR_DIST": 0.0}
        own = {"RTL_RETURN_ALT": layer_m}
    else:
        types = TYPE_ALT_MAX | TYPE_POLYGON
        wanted = {"FENCE_TYPE": types, "FENCE_ACTION": _RETURN, "FENCE_ALT_MAX": top_m,
                  "FENCE_ENABLE": 1}  # fmt: skip
        own = {"RTL_ALT": round(100.0 * layer_m)}
    return wanted | (own if sets else {})


def return_height_m(
    setting: Setting,
    number: int,
    home: LatLon,
    kind: Autopilot,
    found: Mapping[str, float],
) -> float | None:
    """How high a vehicle will return by itself, above home; None: not known.

    In a team in its own layer, which is counted from the start; over ground that is
    not flat, so high above the highest.
    """
    if len(setting.mission.vehicles) > 1 or setting.ground is not None:
        layer_m = setting.mission.altitude_m(number - 1) - setting.home_level_m(number)
        return max(layer_m, LEAST_HEIGHT_M) + highest_above_m(setting, home)
    if kind is PX4:
        return found.get("RTL_RETURN_ALT")
    return found["RTL_ALT"] / 100.0 if "RTL_ALT" in found else None


def _parts(shape: BaseGeometry) -> list[Polygon]:
    return [part for part in shapely.get_parts(shape) if isinstance(part, Polygon)]


def _ring(polygon: BaseGeometry) -> list[GridPoint]:
    """The corners of the outside of a polygon, not closed."""
    (part,) = _parts(polygon)
    return [GridPoint(float(x), float(y)) for x, y in list(part.exterior.coords)[:-1]]


# --- a fence that is kept ------------------------------------------------------------------------
def leaves_kept_fence(
    setting: Setting,
    number: int,
    home: LatLon,
    kind: Autopilot,
    items: Sequence[Item],
    found: Mapping[str, float],
) -> list[str]:
    """In which ways a mission leaves the fence that is set on an autopilot; empty: it does not.

    All that may be flown over has to lie inside: `fence.polygon` less its margin, which holds the
    lanes, and the homes.
    """
    faults = _return_faults(setting, home, kind, found)
    if not _is_on(kind, found):
        return faults
    room = _room(setting, kind, home, items, found)
    if room is not None:
        box = Polygon([setting.grid.fixed(LatLon(*v)) for v in setting.mission.search.box])
        for name, area in (("search.box", box.intersection(setting.fence.outer)),
                           ("fence.polygon less fence.margin_m", setting.fence.inner)):  # fmt: skip
            beyond = area.difference(room)
            if beyond.area > 1.0:
                faults.append(
                    f"{name}: {beyond.area:.0f} m2 of it lie outside, up to "
                    f"{_farthest_m(beyond, room):.0f} m"
                )
        if not room.covers(shapely.Point(setting.grid.fixed(home))):
            faults.append(f"the home of vehicle {number} lies outside")
    return faults + _height_faults(setting, number, home, kind, found)


def _is_on(kind: Autopilot, found: Mapping[str, float]) -> bool:
    if kind is PX4:
        return found.get("GF_ACTION", 0.0) != 0.0
    return found.get("FENCE_ENABLE", 0.0) != 0.0


def _farthest_m(beyond: BaseGeometry, room: BaseGeometry) -> float:
    if room.is_empty:
        return math.inf
    corners = shapely.get_coordinates(beyond)
    return max(float(room.distance(shapely.Point(corner))) for corner in corners)


def _room(
    setting: Setting,
    kind: Autopilot,
    home: LatLon,
    items: Sequence[Item],
    found: Mapping[str, float],
) -> BaseGeometry | None:
    """Where the autopilot lets the vehicle be; None: anywhere."""
    types = TYPE_POLYGON | TYPE_CIRCLE if kind is PX4 else int(found.get("FENCE_TYPE", 0.0))
    radius_m = found.get("GF_MAX_HOR_DIST" if kind is PX4 else "FENCE_RADIUS", 0.0)
    inside: list[BaseGeometry] = []
    outside: list[BaseGeometry] = []
    if types & TYPE_CIRCLE and radius_m > 0.0:
        inside.append(shapely.Point(setting.grid.fixed(home)).buffer(radius_m))
    if types & TYPE_POLYGON:
        for including, shape in shapes_of(setting, items):
            (inside if including else outside).append(shape)
    if not inside and not outside:
        return None
    around = setting.fence.outer.buffer(1000.0)
    room = shapely.intersection_all([around, *inside])
    return room.difference(shapely.union_all(outside)) if outside else room


def shapes_of(setting: Setting, items: Sequence[Item]) -> list[tuple[bool, BaseGeometry]]:
    """The polygons and circles of a fence on the mission's ground, and whether to stay inside."""
    shapes: list[tuple[bool, BaseGeometry]] = []
    at = 0
    while at < len(items):
        item = items[at]
        if item.command in (INCLUSION, EXCLUSION):
            count = max(int(item.first), 1)
            ring = [setting.grid.fixed(i.position) for i in items[at : at + count]]
            if len(ring) >= 3:
                shapes.append((item.command == INCLUSION, Polygon(ring).buffer(0.0)))
            at += count
            continue
        circles = (mav.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, mav.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION)
        if item.command in circles:
            middle = shapely.Point(setting.grid.fixed(item.position))
            shapes.append((item.command == circles[0], middle.buffer(item.first)))
        at += 1
    return shapes


def _height_faults(
    setting: Setting, number: int, home: LatLon, kind: Autopilot, found: Mapping[str, float]
) -> list[str]:
    """The layer of the vehicle against the ceiling and the floor of its autopilot."""
    layer_m, types = setting.mission.top_altitude_m(number - 1), int(found.get("FENCE_TYPE", 0.0))
    layer_m += highest_above_m(setting, home)
    name = "GF_MAX_VER_DIST" if kind is PX4 else "FENCE_ALT_MAX"
    on = kind is PX4 or bool(types & TYPE_ALT_MAX)
    ceiling_m = found.get(name, 0.0) if on else 0.0
    faults = []
    if 0.0 < ceiling_m < layer_m + 1.0:
        faults.append(f"its layer, {layer_m:g} m, is not a metre below {name} = {ceiling_m:g}")
    floor_m = found.get("FENCE_ALT_MIN", -math.inf) if types & TYPE_ALT_MIN else -math.inf
    low_m = setting.mission.altitude_m(number - 1) + highest_above_m(setting, home)
    if floor_m > low_m - setting.relief_m - 1.0:
        faults.append(f"its layer, {low_m:g} m, is not a metre above FENCE_ALT_MIN = {floor_m:g}")
    return faults


def _return_faults(
    setting: Setting, home: LatLon, kind: Autopilot, found: Mapping[str, float]
) -> list[str]:
    """A return height that was kept, and that does not clear the ground."""
    if setting.ground is None:
        return []
    name, unit_m = ("RTL_RETURN_ALT", 1.0) if kind is PX4 else ("RTL_ALT", 0.01)
    needed_m = highest_above_m(setting, home) + LEAST_HEIGHT_M
    returns_m = found.get(name, 0.0) * unit_m
    if returns_m >= needed_m:
        return []
    return [f"{name} = {found.get(name, 0.0):g} does not clear the ground: {needed_m:.0f} m needed"]
