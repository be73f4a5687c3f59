"""PX4's geofence: on as soon as there is one."""

from __future__ import annotations

import math

from sitl.copter.fence import ALT_MAX, CIRCLE, POLYGON, Fence, Place
from sitl.copter.params import Parameters


class Px4Fence(Fence):
    """Uploaded polygons and circles, GF_MAX_HOR_DIST and GF_MAX_VER_DIST."""

    def enabled(self, parameters: Parameters) -> bool:
        """Whether there is anything to break, and GF_ACTION says that it matters."""
        there = self.zones or parameters["GF_MAX_HOR_DIST"] or parameters["GF_MAX_VER_DIST"]
        return bool(there) and parameters["GF_ACTION"] != 0.0

    def floor_m(self, parameters: Parameters) -> float:
        """There is none."""
        return -math.inf

    def violations(
        self, parameters: Parameters, home: Place, place: Place, *, low: bool = True
    ) -> int:
        """Bits of `sitl.copter.fence` that a place breaks."""
        if not self.enabled(parameters):
            return 0
        broken = 0
        highest_m, farthest_m = parameters["GF_MAX_VER_DIST"], parameters["GF_MAX_HOR_DIST"]
        if highest_m > 0.0 and place[2] - home[2] > highest_m:
            broken |= ALT_MAX
        if farthest_m > 0.0 and math.dist(place[:2], home[:2]) > farthest_m:
            broken |= CIRCLE
        if any(zone.broken_at(place[0], place[1]) for zone in self.zones):
            broken |= POLYGON
        return broken
