"""Estimates from telemetry: the wind, jumps of satellite navigation, impacts.

Wind is measured by the tilt of a multicopter. At a steady speed the thrust leans against the drag,
which gives the airspeed; its difference to the ground speed is the wind. The drag grows with the
airspeed as that of a small quadcopter (4 degrees in 3.6 m/s, 30 degrees at 13 m/s), times a factor
of the airframe. The factor is learned from its own acceleration and braking, before and after which
the wind is nearly the same.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

from missions.units import LatLon
from uavmap.mavlink.continuity import distance_m
from uavmap.mavlink.position_history import Fix

GRAVITY_M_S2: Final = 9.80665
DRAG_LINEAR_1_S: Final = 0.10
DRAG_QUADRATIC_1_M: Final = 0.025
BLOCK_S: Final = 2.0
BLOCKS: Final = 4
"""Number of blocks of a mean: over fewer a single braking tilts as much as a gale."""
LEARNED_FROM_M_S: Final = 1.5
"""Minimum difference of two mean velocities by which the airframe's drag is learned, m/s."""
DRAG_PRIOR: Final = 1.5
"""Weight of the quadcopter against the learned factor: less than one leg at 6 m/s."""
MAX_LEARNED: Final = 60
"""Maximum number of last legs that are kept."""
FAR_OFF: Final = 2.0
"""Maximum ratio of a leg's drag to the median of the others; beyond it, it is left out."""
MIN_FACTOR: Final = 0.5
MAX_FACTOR: Final = 8.0


def drag_m_s2(airspeed_m_s: float) -> float:
    """Return the deceleration of the quadcopter by its drag, m/s^2.

    >>> round(drag_m_s2(3.6), 2)
    0.68
    """
    return airspeed_m_s * (DRAG_LINEAR_1_S + DRAG_QUADRATIC_1_M * airspeed_m_s)


def airspeed_m_s(drag: float) -> float:
    """Return the airspeed of a drag: the inverse, m/s."""
    a, b = DRAG_QUADRATIC_1_M, DRAG_LINEAR_1_S
    return (math.sqrt(b * b + 4.0 * a * max(drag, 0.0)) - b) / (2.0 * a)


@dataclass(frozen=True, slots=True)
class _Block:
    """Means over two seconds, towards north and east: drag in m/s2, velocity in m/s."""

    drag: tuple[float, float]
    velocity: tuple[float, float]

    def expected(self, wind: tuple[float, float]) -> tuple[float, float]:
        """Return the drag of the quadcopter at this velocity, in a wind towards north and east."""
        north, east = self.velocity[0] - wind[0], self.velocity[1] - wind[1]
        speed_m_s = math.hypot(north, east)
        share = drag_m_s2(speed_m_s) / speed_m_s if speed_m_s > 1e-6 else 0.0
        return share * north, share * east

    def wind(self, factor: float) -> tuple[float, float]:
        """Return the wind towards north and east, for an airframe with this drag factor."""
        drag = math.hypot(*self.drag)
        share = airspeed_m_s(drag / factor) / drag if drag > 1e-6 else 0.0
        return self.velocity[0] - share * self.drag[0], self.velocity[1] - share * self.drag[1]


class WindEstimate:
    """The mean wind of the last seconds, from attitudes and velocities."""

    def __init__(self) -> None:
        self._tilt: tuple[float, float] | None = None
        # time, thrust to the north and east (m/s2), velocity to the north and east (m/s)
        self._samples: list[tuple[float, float, float, float, float]] = []
        self._blocks: deque[_Block] = deque(maxlen=BLOCKS)
        # drag factors of single legs, with their weights
        self._learned: deque[tuple[float, float]] = deque(maxlen=MAX_LEARNED)

    def forget(self) -> None:
        """Begin anew on the ground; the learned factor of the airframe stays."""
        self._tilt = None
        self._samples.clear()
        self._blocks.clear()

    @property
    def factor(self) -> float:
        """Drag of this airframe, relative to the quadcopter: the mean over its legs.

        Legs far from their median are left out: a gust between two means looks like the airframe's
        drag.
        """
        middle = _median(self._learned)
        near = [(f, w) for f, w in self._learned if middle / FAR_OFF <= f <= middle * FAR_OFF]
        learned = DRAG_PRIOR + sum(factor * weight for factor, weight in near)
        mean = learned / (DRAG_PRIOR + sum(weight for _, weight in near))
        return min(max(mean, MIN_FACTOR), MAX_FACTOR)

    def add_attitude(self, roll_rad: float, pitch_rad: float, yaw_rad: float) -> None:
        """Add an attitude: right side down, nose up, clockwise from true north, rad."""
        if not abs(roll_rad) < 1.3 or not abs(pitch_rad) < 1.3 or not math.isfinite(yaw_rad):
            return
        forward = -GRAVITY_M_S2 * math.tan(pitch_rad)
        right = GRAVITY_M_S2 * math.tan(roll_rad) / math.cos(pitch_rad)
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        self._tilt = (forward * cos - right * sin, forward * sin + right * cos)

    def add_velocity(self, t_s: float, north_m_s: float, east_m_s: float) -> None:
        """Add a velocity over ground, with the last received attitude."""
        if self._tilt is None:
            return
        if self._samples and not 0.0 <= t_s - self._samples[-1][0] <= BLOCK_S:
            self._samples.clear()  # a gap in the telemetry
        self._samples.append((t_s, *self._tilt, north_m_s, east_m_s))
        if t_s - self._samples[0][0] >= BLOCK_S:
            self._add(self._block())
            self._samples = self._samples[-1:]

    def _block(self) -> _Block:
        first, last = self._samples[0], self._samples[-1]
        elapsed_s = last[0] - first[0]
        north, east, v_north, v_east = (
            sum(sample[i] for sample in self._samples) / len(self._samples) for i in range(1, 5)
        )
        # thrust that does not accelerate it works against the drag
        north -= (last[3] - first[3]) / elapsed_s
        east -= (last[4] - first[4]) / elapsed_s
        return _Block((north, east), (v_north, v_east))

    def _add(self, block: _Block) -> None:
        if self._blocks:
            before = self._blocks[-1]
            change = [a - b for a, b in zip(block.velocity, before.velocity, strict=True)]
            if math.hypot(*change) >= LEARNED_FROM_M_S:
                drag = [a - b for a, b in zip(block.drag, before.drag, strict=True)]
                wind = self._wind or (0.0, 0.0)
                now, then = block.expected(wind), before.expected(wind)
                expected = [a - b for a, b in zip(now, then, strict=True)]
                weight = sum(x * x for x in expected)
                if weight > 0.0:
                    along = sum(x * y for x, y in zip(drag, expected, strict=True))
                    self._learned.append((along / weight, weight))
        self._blocks.append(block)

    @property
    def speed_m_s(self) -> float | None:
        """Mean wind, to a decimetre a second; None while it is not known."""
        wind = self._wind
        return None if wind is None else round(math.hypot(*wind), 1)

    @property
    def _wind(self) -> tuple[float, float] | None:
        if len(self._blocks) < BLOCKS:
            return None
        winds = [block.wind(self.factor) for block in self._blocks]
        north, east = (sum(values) / BLOCKS for values in zip(*winds, strict=True))
        return north, east


def _median(weighted: Collection[tuple[float, float]]) -> float:
    """Return the weighted median of (value, weight); 1 without any.

    >>> _median([(9.0, 1.0), (1.0, 1.0), (2.0, 3.0)])
    2.0
    """
    half = sum(weight for _, weight in weighted) / 2.0
    for value, weight in sorted(weighted):
        half -= weight
        if half <= 0.0:
            return value
    return 1.0


LEAP_WINDOW_S: Final = 1.0
LEAP_GAP_S: Final = 1.5
"""Maximum gap over which a jump can be seen, s: the flight in a longer one is unknown."""
LEAP_ACCEL_M_S2: Final = 20.0
"""Acceleration beyond that of a sudden gale and full tilt on a small multicopter, m/s^2."""
LEAP_NOISE_M: Final = 5.0
LEAP_NOISE_M_S: Final = 2.0


class Leaps:
    """Jumps of a position or a speed: satellite navigation errs, for no aircraft can do it.

    The gate (`uavmap.mavlink.continuity`) refuses larger jumps until they persist. This class
    notices smaller jumps, and by the speed those that a filter has smoothed. A slow drift looks
    like wind, and is not noticed. Times are of the vehicle's own clock.
    """

    def __init__(self) -> None:
        self._fixes: deque[tuple[float, LatLon, tuple[float, float]]] = deque()
        self.leapt = ""
        """Text on the last jump; its reader empties it."""

    def forget(self) -> None:
        """Begin anew on the ground, where it may be carried about."""
        self._fixes.clear()
        self.leapt = ""

    def add(self, boot_s: float, position: LatLon, velocity_ne_m_s: tuple[float, float]) -> None:
        """Add its position and velocity at a time of its clock."""
        fixes = self._fixes
        if fixes and boot_s <= fixes[-1][0]:
            fixes.clear()
        fixes.append((boot_s, position, velocity_ne_m_s))
        while len(fixes) > 2 and fixes[1][0] <= boot_s - LEAP_WINDOW_S:
            fixes.popleft()
        first_s, start, (north_m_s, east_m_s) = fixes[0]
        passed_s = boot_s - first_s
        if passed_s > LEAP_GAP_S:
            return
        flown = Fix(first_s, start, 0.0, (north_m_s, east_m_s, 0.0)).moved(boot_s)
        off_m = distance_m(flown.position, position)
        if off_m > LEAP_NOISE_M + 0.5 * LEAP_ACCEL_M_S2 * passed_s**2:
            self._note_leap(f"its position has jumped by {off_m:.0f} m")
            return
        for told_s, _, before in fixes:
            change_m_s = math.dist(before, velocity_ne_m_s)
            if change_m_s > LEAP_NOISE_M_S + LEAP_ACCEL_M_S2 * (boot_s - told_s):
                self._note_leap(f"its speed has jumped by {change_m_s:.0f} m/s")
                return

    def _note_leap(self, what: str) -> None:
        self.leapt = what
        self._fixes.clear()  # the next values count from here


REST_M_S: Final = 0.3
"""Sink rate below which a vehicle does not descend, m/s."""
DESCENT_END_S: Final = 0.6
"""End of a descent, s: a vehicle that comes to rest in the air was slow this long before."""
IMPACT_KEPT_S: Final = 5.0
"""Time for which an impact is kept, s: until motors off is reported, and over a bounce."""
MIN_FALL: Final = 0.3
MAX_FALL: Final = 1.5
"""Shares of gravity with which a free fall gains speed by its messages."""
FALLS_S: Final = 2.0
"""Time for which a vehicle that reports its landing may still fall, s: from 20 m."""


class Impact:
    """The speed at which a vehicle met the ground, by its reported vertical speeds, by its own
    clock.

    A landing ends at half a metre a second. A vehicle whose motors stop in the air also reports a
    landing: disarmed, on the ground. Only its speed shows the difference. One wrong message is no
    impact: the second of the greatest speeds counts. The greatest counts only at the end of a free
    fall, which three messages in a row show.

    >>> impact = Impact()
    >>> for tenth, sink_m_s in enumerate([0.5, 0.5, 1.5, 2.5, 3.4, 4.4, 0.0]):
    ...     impact.add(tenth / 10, sink_m_s)
    >>> impact.speed_m_s, impact.sinks
    (4.4, False)
    >>> for tenth, sink_m_s in enumerate([0.5, 0.5, 4.4, 0.5, 0.0], start=100):
    ...     impact.add(tenth / 10, sink_m_s)
    >>> impact.speed_m_s
    0.5
    """

    def __init__(self) -> None:
        self.sinks = False
        """True if it descends now."""
        self.speed_m_s = 0.0
        """Speed at the end of its fastest descent in the last `IMPACT_KEPT_S`, m/s downwards."""
        self._descent: deque[tuple[float, float]] = deque()
        self._rested_s = float("-inf")

    def add(self, t_s: float, sink_m_s: float) -> None:
        """Add its sink rate at a time of its clock, in s and m/s."""
        descent = self._descent
        if descent and t_s < descent[-1][0]:  # its clock restarted
            descent.clear()
            self.speed_m_s = 0.0
        descent.append((t_s, sink_m_s))
        while descent[0][0] < t_s - DESCENT_END_S:
            descent.popleft()
        if t_s - self._rested_s > IMPACT_KEPT_S:
            self.speed_m_s = 0.0
        sank, self.sinks = self.sinks, sink_m_s > REST_M_S
        if sank and not self.sinks and len(descent) > 1:
            ended_m_s = sorted(speed for _, speed in descent)[-2]
            before_rest = [descent[-4], descent[-3], descent[-2]] if len(descent) > 3 else []
            if before_rest and all(_falls(a, b) for a, b in itertools.pairwise(before_rest)):
                ended_m_s = max(ended_m_s, descent[-2][1])
            if ended_m_s > self.speed_m_s:
                self.speed_m_s, self._rested_s = ended_m_s, t_s


def _falls(one: tuple[float, float], other: tuple[float, float]) -> bool:
    """Return whether it gained speed as in a free fall, or nearly, with some thrust and drag."""
    elapsed_s, gained_m_s = other[0] - one[0], other[1] - one[1]
    most_m_s = GRAVITY_M_S2 * elapsed_s
    return MIN_FALL * most_m_s <= gained_m_s <= MAX_FALL * most_m_s
