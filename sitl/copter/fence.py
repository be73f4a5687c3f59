"""The geofence: a height, a circle around home, uploaded polygons and circles."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.copter.mission_items import CIRCLES, POLYGONS, Item
from sitl.copter.params import Parameters

# bits of FENCE_TYPE
ALT_MAX, CIRCLE, POLYGON, ALT_MIN = 1, 2, 4, 8
_NAMES = {ALT_MAX: "Max Alt", CIRCLE: "Circle", POLYGON: "Polygon", ALT_MIN: "Min Alt"}

Place = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Zone:
    """A polygon (`ring`) or a circle (a point and a radius) to stay inside, or outside."""

    ring: tuple[tuple[float, float], ...]
    radius_m: float
    inclusion: bool

    def broken_at(self, east_m: float, north_m: float) -> bool:
        """Return whether a place is forbidden."""
        e0, n0 = self.ring[-1]
        inside = len(self.ring) == 1 and math.hypot(east_m - e0, north_m - n0) < self.radius_m
        for e1, n1 in self.ring:
            if (n0 > north_m) != (n1 > north_m) and (
                east_m < e0 + (north_m - n0) / (n1 - n0) * (e1 - e0)
            ):
                inside = not inside
            e0, n0 = e1, n1
        return inside != self.inclusion


def zones(
    items: list[Item], to_plane: Callable[[int, int], tuple[float, float]]
) -> tuple[Zone, ...]:
    """Return the zones of an accepted fence; `to_plane` takes degrees times 1e7."""
    found, at = [], 0
    while at < len(items):
        item = items[at]
        count = int(item.p[0]) if item.command in POLYGONS else 1
        ring = tuple(to_plane(i.x, i.y) for i in items[at : at + count])
        if item.command in POLYGONS:
            found.append(Zone(ring, 0.0, item.command == POLYGONS[0]))
        elif item.command in CIRCLES:
            found.append(Zone(ring, item.p[0], item.command == CIRCLES[0]))
        at += count  # a return point is kept, and is not used by copters
    return tuple(found)


class Fence:
    """The zones, and which of them are broken at present."""

    def __init__(self) -> None:
        self.zones: tuple[Zone, ...] = ()
        self.broken = 0  # bits of FENCE_TYPE
        self.count = 0
        self.at_s = 0.0
        self._risen = False

    def enabled(self, parameters: Parameters) -> bool:
        """Return whether FENCE_ENABLE is set."""
        return parameters["FENCE_ENABLE"] != 0.0

    def violations(
        self, parameters: Parameters, home: Place, place: Place, *, low: bool = True
    ) -> int:
        """Return the bits of the fences that a place breaks; 0 while the fence is off.

        With `low` it also checks FENCE_ALT_MIN.
        """
        if not self.enabled(parameters):
            return 0
        wanted, lowest_m, highest_m, farthest_m = self._limits(parameters)
        height_m = place[2] - home[2]
        away_m = math.hypot(place[0] - home[0], place[1] - home[1])
        broken = ALT_MAX * (height_m > highest_m) | CIRCLE * (away_m > farthest_m)
        if low and height_m < lowest_m:
            broken |= ALT_MIN
        if wanted & POLYGON and any(z.broken_at(place[0], place[1]) for z in self.zones):
            broken |= POLYGON
        return broken & wanted

    def _limits(self, parameters: Parameters) -> tuple[int, float, float, float]:
        """Return which fences there are, the lowest and highest height, the farthest distance."""
        low_m, high_m = parameters["FENCE_ALT_MIN"], parameters["FENCE_ALT_MAX"]
        return int(parameters["FENCE_TYPE"]), low_m, high_m, parameters["FENCE_RADIUS"]

    def watch(
        self, parameters: Parameters, home: Place, place: Place, now_s: float, *, flying: bool
    ) -> int:
        """Return the bits that were broken since the last call.

        The lowest height is watched once the vehicle was above it.
        """
        if not (flying and self.enabled(parameters)):
            self.broken, self._risen = 0, False
            return 0
        self._risen = self._risen or place[2] - home[2] > self._limits(parameters)[1]
        broken = self.violations(parameters, home, place, low=self._risen)
        fresh = broken & ~self.broken
        self.broken = broken
        if fresh:
            self.count += 1
            self.at_s = now_s
        return fresh

    @property
    def breach_type(self) -> int:
        """FENCE_BREACH of FENCE_STATUS."""
        if self.broken & (POLYGON | CIRCLE):
            return int(mav.FENCE_BREACH_BOUNDARY)
        if self.broken & ALT_MAX:
            return int(mav.FENCE_BREACH_MAXALT)
        return int(mav.FENCE_BREACH_MINALT if self.broken else mav.FENCE_BREACH_NONE)


def names(bits: int) -> str:
    """Return the names of the fences."""
    return ", ".join(name for bit, name in _NAMES.items() if bits & bit)
