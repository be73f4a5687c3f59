"""Wind, measured by how far a multicopter has to tilt.

At a steady speed the thrust leans against the drag, so the tilt tells the speed through the air,
and the difference to the speed over ground is the wind. The drag is taken to grow with the
airspeed as that of a small quadcopter does (4 degrees in a wind of 3.6 m/s, 30 degrees at 13 m/s),
times a factor of the airframe, which is learned from its own speeding up and braking: whatever the
wind, it is nearly the same before and after.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

GRAVITY_M_S2: Final = 9.80665
DRAG_LINEAR_1_S: Final = 0.10
DRAG_QUADRATIC_1_M: Final = 0.025
BLOCK_S: Final = 2.0
BLOCKS: Final = 4
"""A mean over less says nothing: a single braking tilts as much as a gale."""
LEARNED_FROM_M_S: Final = 1.5
"""Two means whose velocities differ by less say nothing about the airframe."""
PRIOR: Final = 1.5
"""How much the quadcopter counts against what was learned: less than one leg at 6 m/s."""
MOST_LEARNED: Final = 60
"""So many of the last legs are remembered."""
FAR_OFF: Final = 2.0
"""A leg that says so many times more or less than the others says nothing."""
LEAST_FACTOR: Final = 0.5
MOST_FACTOR: Final = 8.0


def drag_m_s2(airspeed_m_s: float) -> float:
    """Deceleration of the quadcopter by its drag.

    >>> round(drag_m_s2(3.6), 2)
    0.68
    """
    return airspeed_m_s * (DRAG_LINEAR_1_S + DRAG_QUADRATIC_1_M * airspeed_m_s)


def airspeed_m_s(drag: float) -> float:
    """The inverse: at which airspeed the drag is so large.

    >>> round(airspeed_m_s(0.684), 1)
    3.6
    """
    a, b = DRAG_QUADRATIC_1_M, DRAG_LINEAR_1_S
    return (math.sqrt(b * b + 4.0 * a * max(drag, 0.0)) - b) / (2.0 * a)


@dataclass(frozen=True, slots=True)
class _Block:
    """Means over two seconds, towards north and east: drag in m/s2, velocity in m/s."""

    drag: tuple[float, float]
    velocity: tuple[float, float]

    def expected(self, wind: tuple[float, float]) -> tuple[float, float]:
        """The drag of the quadcopter at this velocity, in a wind towards north and east."""
        north, east = self.velocity[0] - wind[0], self.velocity[1] - wind[1]
        speed_m_s = math.hypot(north, east)
        share = drag_m_s2(speed_m_s) / speed_m_s if speed_m_s > 1e-6 else 0.0
        return share * north, share * east

    def wind(self, factor: float) -> tuple[float, float]:
        """The wind towards north and east, for an airframe of this drag."""
        drag = math.hypot(*self.drag)
        share = airspeed_m_s(drag / factor) / drag if drag > 1e-6 else 0.0
        return self.velocity[0] - share * self.drag[0], self.velocity[1] - share * self.drag[1]


class WindEstimate:
    """The mean wind of the last seconds, from attitudes and velocities."""

    def __init__(self) -> None:
        self._tilt: tuple[float, float] | None = None
        # when, thrust to the north and east (m/s2), velocity to the north and east (m/s)
        self._samples: list[tuple[float, float, float, float, float]] = []
        self._blocks: deque[_Block] = deque(maxlen=BLOCKS)
        # what single legs say of the airframe's drag, and how much each counts
        self._learned: deque[tuple[float, float]] = deque(maxlen=MOST_LEARNED)

    def forget(self) -> None:
        """Begin anew: it stands on the ground. What was learned of the airframe stays."""
        self._tilt = None
        self._samples.clear()
        self._blocks.clear()

    @property
    def factor(self) -> float:
        """The drag of this airframe, in that of the quadcopter.

        The mean of what its legs say, but for those that say something far from their median: a
        gust between two means is taken for the airframe's own doing.
        """
        middle = _median(self._learned)
        near = [(f, w) for f, w in self._learned if middle / FAR_OFF <= f <= middle * FAR_OFF]
        learned = PRIOR + sum(factor * weight for factor, weight in near)
        mean = learned / (PRIOR + sum(weight for _, weight in near))
        return min(max(mean, LEAST_FACTOR), MOST_FACTOR)

    def tilted(self, roll_rad: float, pitch_rad: float, yaw_rad: float) -> None:
        """An attitude: right side down, nose up, clockwise from true north."""
        if not abs(roll_rad) < 1.3 or not abs(pitch_rad) < 1.3 or not math.isfinite(yaw_rad):
            return
        forward = -GRAVITY_M_S2 * math.tan(pitch_rad)
        right = GRAVITY_M_S2 * math.tan(roll_rad) / math.cos(pitch_rad)
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        self._tilt = (forward * cos - right * sin, forward * sin + right * cos)

    def moved(self, t_s: float, north_m_s: float, east_m_s: float) -> None:
        """A velocity over ground, with the attitude that was heard last."""
        if self._tilt is None:
            return
        if self._samples and not 0.0 <= t_s - self._samples[-1][0] <= BLOCK_S:
            self._samples.clear()  # a gap in the telemetry
        self._samples.append((t_s, *self._tilt, north_m_s, east_m_s))
        if t_s - self._samples[0][0] >= BLOCK_S:
            self._take(self._block())
            self._samples = self._samples[-1:]

    def _block(self) -> _Block:
        first, last = self._samples[0], self._samples[-1]
        elapsed_s = last[0] - first[0]
        north, east, v_north, v_east = (
            sum(sample[i] for sample in self._samples) / len(self._samples) for i in range(1, 5)
        )
        # what the thrust does not put into speeding up, it puts against the drag
        north -= (last[3] - first[3]) / elapsed_s
        east -= (last[4] - first[4]) / elapsed_s
        return _Block((north, east), (v_north, v_east))

    def _take(self, block: _Block) -> None:
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
        """The mean wind, to a decimetre a second; None while nothing can be said."""
        wind = self._wind
        return None if wind is None else round(math.hypot(*wind), 1)

    @property
    def _wind(self) -> tuple[float, float] | None:
        """The mean wind towards north and east, None while nothing can be said."""
        if len(self._blocks) < BLOCKS:
            return None
        winds = [block.wind(self.factor) for block in self._blocks]
        north, east = (sum(values) / BLOCKS for values in zip(*winds, strict=True))
        return north, east


def _median(said: Collection[tuple[float, float]]) -> float:
    """The weighted median of (value, weight); 1 of nothing.

    >>> _median([(9.0, 1.0), (1.0, 1.0), (2.0, 3.0)])
    2.0
    """
    half = sum(weight for _, weight in said) / 2.0
    for value, weight in sorted(said):
        half -= weight
        if half <= 0.0:
            return value
    return 1.0
