"""The position of a vehicle at a moment between its reports, or shortly after the last.

Pictures are taken between two telemetry messages and judged after both. At 8 m/s and five positions
a second a vehicle has flown 1.6 m in between, and 16 m since a picture that took two seconds to
come. Its attitude is interpolated likewise. Times are of the vehicle's own clock, which no delay of
the link shifts.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final, Generic, NamedTuple, TypeVar

from missions.units import LatLon, Quaternion

HISTORY_S: Final = 30.0
"""Maximum age of a picture that is judged, s."""
MAX_KEPT: Final = 1000
_M_PER_DEG: Final = 111_195.0
T = TypeVar("T")


class Fix(NamedTuple):
    """The vehicle's reported position at a time of its clock."""

    boot_s: float
    position: LatLon
    height_m: float
    velocity_ned_m_s: tuple[float, float, float]

    def moved(self, boot_s: float) -> Place:
        """Return its place at another time of its clock, at its reported velocity."""
        passed_s = boot_s - self.boot_s
        north_m_s, east_m_s, down_m_s = self.velocity_ned_m_s
        shrink = max(math.cos(math.radians(self.position.lat_deg)), 1e-6)
        lat_deg = self.position.lat_deg + north_m_s * passed_s / _M_PER_DEG
        lon_deg = self.position.lon_deg + east_m_s * passed_s / (_M_PER_DEG * shrink)
        return Place(
            LatLon(min(max(lat_deg, -90.0), 90.0), math.remainder(lon_deg, 360.0)),
            self.height_m - down_m_s * passed_s,
            abs(passed_s),
        )


class Place(NamedTuple):
    """An estimated place."""

    position: LatLon
    height_m: float
    gap_s: float
    """Time to the nearest fix, at least 0, s; far from fixes the place is a guess."""


class _History(Generic[T]):
    """The values of the last `HISTORY_S`, each with its time on the vehicle's clock."""

    def __init__(self) -> None:
        self._kept: deque[tuple[float, T]] = deque(maxlen=MAX_KEPT)

    @property
    def last_s(self) -> float:
        """Time of the latest, before all times without one."""
        return self._kept[-1][0] if self._kept else -math.inf

    def _keep(self, boot_s: float, value: T) -> None:
        if boot_s < self.last_s:  # old values mean nothing after a restart of the clock
            self._kept.clear()
        self._kept.append((boot_s, value))
        while self._kept[0][0] < boot_s - HISTORY_S:
            self._kept.popleft()

    def _around(self, boot_s: float) -> tuple[tuple[float, T] | None, tuple[float, T] | None]:
        """Return the last value until a time, and the first after it."""
        after = None
        for sample in reversed(self._kept):
            if sample[0] <= boot_s:
                return sample, after
            after = sample
        return None, after


class Whereabouts(_History[Fix]):
    """The positions of the last `HISTORY_S`."""

    def add(self, fix: Fix) -> None:
        """Add a position."""
        self._keep(fix.boot_s, fix)

    def at(self, boot_s: float) -> Place | None:
        """Return its place at a time of its clock; None before the first fix.

        Between two fixes it is on the straight line, outside of all at the velocity of the nearest.
        """
        first, second = self._around(boot_s)
        if first is None or second is None:
            nearest = first or second
            return None if nearest is None else nearest[1].moved(boot_s)
        before, after = first[1], second[1]
        share = (boot_s - before.boot_s) / (after.boot_s - before.boot_s)
        turned_deg = math.remainder(after.position.lon_deg - before.position.lon_deg, 360.0)
        return Place(
            LatLon(
                before.position.lat_deg
                + share * (after.position.lat_deg - before.position.lat_deg),
                math.remainder(before.position.lon_deg + share * turned_deg, 360.0),
            ),
            before.height_m + share * (after.height_m - before.height_m),
            min(boot_s - before.boot_s, after.boot_s - boot_s),
        )


# --- how it was turned -----------------------------------------------------------------------
MAX_GAP_S: Final = 0.5
"""Maximum time to the nearest attitude for an interpolation, s."""
_NEARLY_SAME: Final = 0.9995


class Attitudes(_History[Quaternion]):
    """The attitudes of the last `HISTORY_S`."""

    def add(self, boot_s: float, attitude: Quaternion) -> None:
        """Add an attitude, the first of each time."""
        if boot_s != self.last_s:
            self._keep(boot_s, attitude)

    def at(self, boot_s: float) -> Quaternion | None:
        """Return its attitude at a time of its clock, between two on the shortest turn.

        None if the nearest is more than `MAX_GAP_S` away.
        """
        before, after = self._around(boot_s)
        near = [s for s in (before, after) if s is not None and abs(s[0] - boot_s) <= MAX_GAP_S]
        if not near:
            return None
        if before is None or after is None:
            return near[0][1]
        return between(before[1], after[1], (boot_s - before[0]) / (after[0] - before[0]))


def between(a: Quaternion, b: Quaternion, share: float) -> Quaternion:
    """Return the rotation that is a share of the shortest way from one to the other."""
    cosine = sum(p * q for p, q in zip(a, b, strict=True))
    sign = 1.0 if cosine >= 0.0 else -1.0
    cosine = min(abs(cosine), 1.0)
    if cosine > _NEARLY_SAME:
        of_a, of_b = 1.0 - share, share
    else:
        angle = math.acos(cosine)
        of_a = math.sin((1.0 - share) * angle) / math.sin(angle)
        of_b = math.sin(share * angle) / math.sin(angle)
    mixed = [of_a * p + sign * of_b * q for p, q in zip(a, b, strict=True)]
    length = math.sqrt(sum(x * x for x in mixed))
    return Quaternion(*(x / length for x in mixed))
