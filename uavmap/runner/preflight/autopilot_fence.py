"""The autopilot's fence for a mission: its polygon, its heights, its parameters.

It lies outside the mission's own fence, by the distance that a vehicle gets before the guardian
stops it. The autopilot is the last safeguard if this computer fails.
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

from missions.guardian.thresholds import OUTSIDE_S
from missions.mission.height_and_speed import MIN_HEIGHT_M
from missions.mission.layout import Layout
from missions.mission.places import drawn
from missions.units import GridPoint, LatLon
from uavmap.mavlink.autopilots import PX4, Autopilot
from uavmap.mavlink.mission_transfer import Item

MIN_OUTSIDE_M: Final = 5.0
"""Minimum distance from the mission's fence, m: two receivers, a home that moves, a gust."""
ABOVE_M: Final = 10.0
"""Height of the ceiling above the highest layer, m: climbs overshoot, barometers drift."""
MITRE: Final = 2.0
INCLUSION: Final = int(mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION)
EXCLUSION: Final = int(mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION)
ARDUPILOT_FENCE: Final = (
    "FENCE_ENABLE", "FENCE_TYPE", "FENCE_ACTION", "FENCE_ALT_MAX", "FENCE_RADIUS", "FENCE_ALT_MIN",
    "RTL_ALT",
)  # fmt: skip
PX4_FENCE: Final = ("GF_ACTION", "GF_MAX_VER_DIST", "GF_MAX_HOR_DIST", "RTL_RETURN_ALT")
"""Parameters of a fence, and of the return height."""
TYPE_ALT_MAX, TYPE_CIRCLE, TYPE_POLYGON, TYPE_ALT_MIN = 1, 2, 4, 8
"""Bits of FENCE_TYPE."""
_RETURN: Final = 1
_PX4_RETURN: Final = 3


@dataclass(frozen=True, slots=True)
class FencePlan:
    """The settings for the autopilot of one vehicle."""

    fence: tuple[Item, ...]
    rally: tuple[Item, ...]
    parameters: Mapping[str, float]
    outside_m: float
    """Distance of its polygon from the mission's, outwards, m."""
    holes_left_out: int
    """Number of holes of the mission's fence that are too narrow to be shrunk by this distance."""
    columns_left_out: tuple[int, ...] = ()
    """Other vehicles of a fleet whose columns over their pads are too narrow for that."""


def outside_m(speed_m_s: float, accel_m_s2: float) -> float:
    """Return the maximum distance of our vehicle outside the mission's fence, m.

    The guardian takes control after 2 s outside; then it brakes.

    >>> round(outside_m(6.0, 2.0), 1)
    21.0
    """
    brakes_m = speed_m_s**2 / (2.0 * accel_m_s2)
    return max(MIN_OUTSIDE_M, speed_m_s * OUTSIDE_S + brakes_m)


@dataclass(frozen=True, slots=True)
class VehicleFence:
    """The fence of the autopilot of one vehicle of a mission."""

    setting: Layout
    number: int
    """Number of the vehicle, from 1."""
    home: LatLon
    """Its position on the ground."""
    kind: Autopilot
    found: Mapping[str, float]
    """Its parameters."""

    def plan(self) -> FencePlan:
        """Return the settings for the vehicle."""
        setting = self.setting
        by_m = outside_m(setting.mission.flight.speed_m_s, setting.energy.accel_m_s2)
        outer = setting.fence.outer
        rings = [_ring(_grown(Polygon(outer.exterior), by_m))]
        holes, columns = 0, list[int]()
        for ring in outer.interiors:
            hole = Polygon(ring)
            smaller = _grown(hole, -by_m)
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
        # at ground level: PX4 adds its return height, an ArduPilot takes the higher one
        frame = mav.MAV_FRAME_GLOBAL_RELATIVE_ALT
        rally = Item(mav.MAV_CMD_NAV_RALLY_POINT, self.home, frame=frame, height_m=0.0)
        return FencePlan(
            tuple(fence), (rally,), self._parameters(), by_m, holes, tuple(sorted(columns))
        )

    @property
    def _highest_m(self) -> float:
        """Highest ground in the fence above the home, at least 0, m; 0 if it is flat."""
        setting = self.setting
        if setting.ground is None:
            return 0.0
        home_m = setting.ground.height_m(setting.grid.fixed(self.home))
        above_m = max(setting.mission.highest_ground_m - home_m, 0.0)
        return math.ceil(above_m * 10.0 - 1e-6) / 10.0

    @property
    def _level_m(self) -> float:
        """Height of the home above the origin of its layers, m."""
        return self.setting.home_level_m(self.number)

    @property
    def _sets_return(self) -> bool:
        return len(self.setting.mission.vehicles) > 1 or self.setting.ground is not None

    @property
    def _return_name(self) -> tuple[str, float]:
        return ("RTL_RETURN_ALT", 1.0) if self.kind is PX4 else ("RTL_ALT", 100.0)

    def return_height_m(self) -> float | None:
        """Return the return height of the vehicle above home, m; None if unknown.

        In a team that is its own layer; over ground that is not flat it is above the highest
        ground.
        """
        if self._sets_return:
            layer_m = self.setting.mission.altitude_m(self.number - 1) - self._level_m
            return max(layer_m, MIN_HEIGHT_M) + self._highest_m
        name, units = self._return_name
        return self.found[name] / units if name in self.found else None

    def _parameters(self) -> dict[str, float]:
        returns_m, mission = self.return_height_m(), self.setting.mission
        tops_m = [mission.top_altitude_m(i) for i in range(len(mission.vehicles))]
        highest_flown_m = max(tops_m) + self._highest_m - min(self._level_m, 0.0)
        top_m = float(math.ceil(max(highest_flown_m, returns_m or 0.0) + ABOVE_M))
        if self.kind is PX4:
            wanted = {"GF_ACTION": _PX4_RETURN, "GF_MAX_VER_DIST": top_m, "GF_MAX_HOR_DIST": 0.0}
        else:
            types = TYPE_ALT_MAX | TYPE_POLYGON
            wanted = {"FENCE_TYPE": types, "FENCE_ACTION": _RETURN, "FENCE_ALT_MAX": top_m,
                      "FENCE_ENABLE": 1}  # fmt: skip
        if self._sets_return and returns_m is not None:
            name, units = self._return_name
            wanted[name] = returns_m if self.kind is PX4 else round(units * returns_m)
        return wanted

    # --- a fence that is kept --------------------------------------------------------------------
    def faults(self, items: Sequence[Item]) -> list[str]:
        """Return how the mission leaves the fence that is set; empty if it does not.

        Inside must be `fence.polygon` less its margin, and the homes.
        """
        setting, faults = self.setting, self._return_faults()
        if not self.found.get("GF_ACTION" if self.kind is PX4 else "FENCE_ENABLE", 0.0):
            return faults
        room = self._room(items)
        if room is not None:
            box = drawn(setting.mission.search.box, setting.grid)
            flown = {
                "search.box": box.intersection(setting.fence.outer),
                "fence.polygon less fence.margin_m": setting.fence.inner,
            }
            for name, area in flown.items():
                beyond = area.difference(room)
                if beyond.area > 1.0:
                    faults.append(
                        f"{name}: {beyond.area:.0f} m2 of it lie outside, up to "
                        f"{_farthest_m(beyond, room):.0f} m"
                    )
            if not room.covers(shapely.Point(setting.grid.fixed(self.home))):
                faults.append(f"the home of vehicle {self.number} lies outside")
        return faults + self._height_faults()

    @property
    def _types(self) -> int:
        if self.kind is PX4:
            return TYPE_POLYGON | TYPE_CIRCLE | TYPE_ALT_MAX
        return int(self.found.get("FENCE_TYPE", 0.0))

    def _room(self, items: Sequence[Item]) -> BaseGeometry | None:
        """Return the area that the autopilot allows; None: anywhere."""
        setting, types = self.setting, self._types
        radius_m = self.found.get("GF_MAX_HOR_DIST" if self.kind is PX4 else "FENCE_RADIUS", 0.0)
        inside: list[BaseGeometry] = []
        outside: list[BaseGeometry] = []
        if types & TYPE_CIRCLE and radius_m > 0.0:
            inside.append(shapely.Point(setting.grid.fixed(self.home)).buffer(radius_m))
        if types & TYPE_POLYGON:
            for including, shape in shapes_of(setting, items):
                (inside if including else outside).append(shape)
        if not inside and not outside:
            return None
        around = setting.fence.outer.buffer(1000.0)
        return shapely.intersection_all([around, *inside]).difference(shapely.union_all(outside))

    def _height_faults(self) -> list[str]:
        mission, highest_m, types = self.setting.mission, self._highest_m, self._types
        layer_m = mission.top_altitude_m(self.number - 1) + highest_m
        name = "GF_MAX_VER_DIST" if self.kind is PX4 else "FENCE_ALT_MAX"
        ceiling_m = self.found.get(name, 0.0) if types & TYPE_ALT_MAX else 0.0
        faults = []
        if 0.0 < ceiling_m < layer_m + 1.0:
            faults.append(f"its layer, {layer_m:g} m, is not a metre below {name} = {ceiling_m:g}")
        floor_m = self.found.get("FENCE_ALT_MIN", -math.inf) if types & TYPE_ALT_MIN else -math.inf
        low_m = mission.altitude_m(self.number - 1) + highest_m
        if floor_m > low_m - self.setting.relief_m - 1.0:
            faults.append(
                f"its layer, {low_m:g} m, is not a metre above FENCE_ALT_MIN = {floor_m:g}"
            )
        return faults

    def _return_faults(self) -> list[str]:
        """Return a fault of a kept return height that does not clear the ground."""
        name, units = self._return_name
        needed_m, set_to = self._highest_m + MIN_HEIGHT_M, self.found.get(name, 0.0)
        if self.setting.ground is None or set_to / units >= needed_m:
            return []
        return [f"{name} = {set_to:g} does not clear the ground: {needed_m:.0f} m needed"]


def _others_inside(setting: Layout, hole: Polygon) -> list[int]:
    """Return the other vehicles of a fleet whose pads lie in a hole: it is the air over them."""
    if not setting.member:
        return []
    others = set(range(1, len(setting.mission.vehicles) + 1)) - {setting.member}
    return [n for n in sorted(others) if hole.contains(shapely.Point(setting.pad_of(n)))]


def _grown(polygon: Polygon, by_m: float) -> BaseGeometry:
    return polygon.buffer(by_m, join_style="mitre", mitre_limit=MITRE)


def _parts(shape: BaseGeometry) -> list[Polygon]:
    return [part for part in shapely.get_parts(shape) if isinstance(part, Polygon)]


def _ring(polygon: BaseGeometry) -> list[GridPoint]:
    (part,) = _parts(polygon)
    return [GridPoint(float(x), float(y)) for x, y in list(part.exterior.coords)[:-1]]


def _farthest_m(beyond: BaseGeometry, room: BaseGeometry) -> float:
    if room.is_empty:
        return math.inf
    corners = shapely.get_coordinates(beyond)
    return max(float(room.distance(shapely.Point(corner))) for corner in corners)


def shapes_of(setting: Layout, items: Sequence[Item]) -> list[tuple[bool, BaseGeometry]]:
    """Return the polygons and circles of a fence on the mission's ground, and whether to stay
    inside."""
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
