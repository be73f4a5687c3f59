"""Wind, measured by how far a multicopter has to tilt.

At rest over ground or at a steady speed the thrust leans against the drag, so the tilt tells the
speed through the air, and the difference to the speed over ground is the wind. The drag of small
quadcopters is alike enough for a warning: 4 degrees in a wind of 3.6 m/s, 30 degrees at 13 m/s
(linear and quadratic in the airspeed). Speeding up is subtracted.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

GRAVITY_M_S2: Final = 9.80665
DRAG_LINEAR_1_S: Final = 0.10
DRAG_QUADRATIC_1_M: Final = 0.025
WINDOW_S: Final = 8.0
LEAST_S: Final = 6.0
"""A mean over less says nothing: a single braking tilts as much as a gale."""


def airspeed_m_s(drag_m_s2: float) -> float:
    """The speed through the air at which the drag is so large.

    >>> round(airspeed_m_s(0.684), 1)
    3.6
    """
    a, b = DRAG_QUADRATIC_1_M, DRAG_LINEAR_1_S
    return (math.sqrt(b * b + 4.0 * a * max(drag_m_s2, 0.0)) - b) / (2.0 * a)


class WindEstimate:
    """The mean wind of the last seconds, from attitudes and velocities."""

    def __init__(self) -> None:
        self._tilt: tuple[float, float] | None = None
        # when, thrust to the north and east (m/s2), velocity to the north and east (m/s)
        self._window: deque[tuple[float, float, float, float, float]] = deque()

    def forget(self) -> None:
        """Begin anew: it stands on the ground."""
        self._tilt = None
        self._window.clear()

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
        if self._window and t_s < self._window[-1][0]:
            self._window.clear()
        self._window.append((t_s, *self._tilt, north_m_s, east_m_s))
        while t_s - self._window[0][0] > WINDOW_S:
            self._window.popleft()

    @property
    def speed_m_s(self) -> float | None:
        """The mean wind, to a decimetre a second; None while nothing can be said."""
        if len(self._window) < 2:
            return None
        first, last = self._window[0], self._window[-1]
        elapsed_s = last[0] - first[0]
        if elapsed_s < LEAST_S:
            return None
        count = len(self._window)
        north, east, v_north, v_east = (
            sum(sample[i] for sample in self._window) / count for i in range(1, 5)
        )
        north -= (last[3] - first[3]) / elapsed_s
        east -= (last[4] - first[4]) / elapsed_s
        drag = math.hypot(north, east)
        share = airspeed_m_s(drag) / drag if drag > 1e-6 else 0.0
        return round(math.hypot(v_north - share * north, v_east - share * east), 1)
