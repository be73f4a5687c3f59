"""The stream of setpoints that offboard flight needs."""

from __future__ import annotations

import math

FRESH_S = 0.5
"""At least two setpoints a second: the last is no older than this when the mode is asked for."""


class Setpoints:
    """When SET_POSITION_TARGET_* was heard last, whatever the mode.

    >>> setpoints = Setpoints()
    >>> setpoints.hear(3.0)
    >>> setpoints.fresh(3.4), setpoints.fresh(3.6), setpoints.silent_s(4.0)
    (True, False, 1.0)
    """

    def __init__(self) -> None:
        self._heard_s = -math.inf

    def hear(self, now_s: float) -> None:
        """A setpoint has come."""
        self._heard_s = now_s

    def silent_s(self, now_s: float) -> float:
        """Seconds since the last one."""
        return now_s - self._heard_s

    def fresh(self, now_s: float) -> bool:
        """Whether there is a stream to switch to."""
        return self.silent_s(now_s) <= FRESH_S + 1e-6
