"""A position or a speed that leaps: what no aircraft can do, satellite navigation has done.

The gate refuses what no aircraft can do at all (`uavmap.mavlink.continuity`), and believes it once
it stays. Here a smaller leap is noticed, too, and one that a navigation filter has smoothed, which
shows in the speed: a map whose places cannot be trusted is no map. A slow drift cannot be noticed
so; it looks like wind.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from missions.units import LatLon
from uavmap.mavlink.continuity import distance_m
from uavmap.mavlink.position_history import Fix

WINDOW_S: Final = 1.0
LONGEST_S: Final = 1.5
"""Over a longer gap nothing can be said: nobody knows how it flew meanwhile."""
ACCEL_M_S2: Final = 20.0
"""More than a gale at once, with full tilt, does to a small multicopter."""
NOISE_M: Final = 5.0
NOISE_M_S: Final = 2.0


class Leaps:
    """Looks for leaps in the positions of one vehicle, by its own clock."""

    def __init__(self) -> None:
        self._fixes: deque[tuple[float, LatLon, tuple[float, float]]] = deque()
        self.leapt = ""
        """What leapt last, in words; whoever takes note of it empties it."""

    def forget(self) -> None:
        """Begin anew: it stands on the ground, where it may be carried about."""
        self._fixes.clear()
        self.leapt = ""

    def take(self, boot_s: float, position: LatLon, velocity_ne_m_s: tuple[float, float]) -> None:
        """Take in where it was at a time of its clock, and how fast."""
        fixes = self._fixes
        if fixes and boot_s <= fixes[-1][0]:
            fixes.clear()
        fixes.append((boot_s, position, velocity_ne_m_s))
        while len(fixes) > 2 and fixes[1][0] <= boot_s - WINDOW_S:
            fixes.popleft()
        first_s, start, (north_m_s, east_m_s) = fixes[0]
        passed_s = boot_s - first_s
        if passed_s > LONGEST_S:
            return
        flown = Fix(first_s, start, 0.0, (north_m_s, east_m_s, 0.0)).moved(boot_s)
        off_m = distance_m(flown.position, position)
        if off_m > NOISE_M + 0.5 * ACCEL_M_S2 * passed_s**2:
            self._noted(f"its position has leapt by {off_m:.0f} m")
            return
        for told_s, _, before in fixes:
            change_m_s = math.dist(before, velocity_ne_m_s)
            if change_m_s > NOISE_M_S + ACCEL_M_S2 * (boot_s - told_s):
                self._noted(f"its speed has leapt by {change_m_s:.0f} m/s")
                return

    def _noted(self, what: str) -> None:
        self.leapt = what
        self._fixes.clear()  # what comes next goes on from here
