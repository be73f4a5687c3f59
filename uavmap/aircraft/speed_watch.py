"""Whether a long leg is flown at the speed that was ordered.

An autopilot may put its own speed back when a target comes, and a pilot may set another in flight.
"""

from __future__ import annotations

from typing import Final

from uavmap.mavlink.vehicle_view import VehicleView

AFTER_S: Final = 5.0
"""By then a leg is flown at its full speed."""
ACCEL_M_S2: Final = 2.0
FAR_SHARE: Final = 0.3
FAR_M_S: Final = 1.0
"""A speed is far from the order if it is off by more than both."""
MOST: Final = 2
"""So often in a leg it is sent again: a wind that cannot be flown against stays."""


class SpeedWatch:
    """One leg, begun at `begin_s`."""

    def __init__(self, name: str, view: VehicleView, speed_m_s: float, begin_s: float) -> None:
        self._name = name
        self._view = view
        self._speed_m_s = speed_m_s
        self._begin_s = begin_s
        self._sent = 0

    def wrong(self, now_s: float, left_m: float) -> str:
        """What is wrong, in words for the operator; empty while nothing is, or nobody can tell.

        To be called now and then; `left_m` is what is left of the leg: at its end the vehicle
        brakes.
        """
        braking_m = self._speed_m_s**2 / (2.0 * ACCEL_M_S2)
        soon_m = braking_m + self._speed_m_s * AFTER_S
        if now_s - self._begin_s < AFTER_S or left_m < soon_m or self._sent >= MOST:
            return ""
        flown_m_s = self._view.ground_speed_m_s
        if self._view.ground is not None and flown_m_s < self._speed_m_s:
            return ""  # over ground it flies to targets that lie near
        if abs(flown_m_s - self._speed_m_s) <= max(FAR_M_S, FAR_SHARE * self._speed_m_s):
            return ""
        self._begin_s = now_s
        self._sent += 1
        return (
            f"{self._name}: flies {flown_m_s:.1f} m/s instead of the {self._speed_m_s:g} m/s that "
            "were ordered; the speed is sent again"
        )
