"""Legs to a target: over ground that is not flat, and at the ordered speed.

An autopilot flies straight to its target, and may climb or descend first. So its targets lie only
as far ahead as the ground is nearly level, at the height of the highest ground until there. On the
way it gets the next one; without another it stops there. An autopilot may reset its own speed at a
target, and a pilot may set another: the speed of a long leg is watched.
"""

from __future__ import annotations

from typing import Final

from missions.mission.energy import CLIMB_SPEED_M_S, EnergyModel
from missions.units import GridPoint
from uavmap.mavlink.vehicle_view import VehicleView

HEIGHT_M: Final = 1.0
"""Error of its height within which a vehicle, still descending, has arrived over ground, m."""
OTHER_LAYER_M: Final = 1.5
"""Difference of an order's height from the vehicle's that means a change of layer, m."""
FULL_SPEED_S: Final = 5.0
"""Time after which a leg is at its full speed, s."""
ACCEL_M_S2: Final = 2.0
MAX_SPEED_ERROR_SHARE: Final = 0.3
MAX_SPEED_ERROR_M_S: Final = 1.0
"""Limits of a speed's deviation from the order; both must be exceeded."""
MAX_SPEED_RESENDS: Final = 2
"""Maximum number of times in a leg that the speed is sent again: a strong wind persists."""


def aim_over_ground(
    view: VehicleView, here: GridPoint, target: GridPoint, height_m: float
) -> tuple[GridPoint, float]:
    """Return the next target on a leg at a height above ground, and its height, as far as
    possible."""
    if view.ground is None:
        return target, height_m
    return view.ground.terrain.sent_target(here, view.height_m, target, height_m)


def leg_over_ground_s(
    view: VehicleView, energy: EnergyModel, here: GridPoint, target: GridPoint
) -> float:
    """Return the time of a leg from rest to rest, about, s; on steep ground it is slow."""
    level_s = energy.leg_s(here.distance_to(target))
    if view.ground is None:
        return level_s
    climb_m = view.ground.terrain.ups_and_downs_m((here, target), energy.speed_m_s, CLIMB_SPEED_M_S)
    return level_s + climb_m / CLIMB_SPEED_M_S


def at_height(view: VehicleView, height_m: float, *, always: bool = False) -> bool:
    """Return whether a vehicle is at its height.

    Over flat ground its layer is its height, but for a change of layer (`always`).
    """
    flat = view.ground is None and not always
    return flat or abs(view.height_m - height_m) <= HEIGHT_M


class SpeedWatch:
    """One leg, begun at `begin_s`."""

    def __init__(self, name: str, view: VehicleView, speed_m_s: float, begin_s: float) -> None:
        self._name = name
        self._view = view
        self._speed_m_s = speed_m_s
        self._begin_s = begin_s
        self._sent = 0

    def wrong(self, now_s: float, left_m: float) -> str:
        """Return a fault for the operator; empty while there is none, or none can be known.

        Call it regularly; `left_m` is the rest of the leg, at whose end the vehicle brakes.
        """
        braking_m = self._speed_m_s**2 / (2.0 * ACCEL_M_S2)
        soon_m = braking_m + self._speed_m_s * FULL_SPEED_S
        if (
            now_s - self._begin_s < FULL_SPEED_S
            or left_m < soon_m
            or self._sent >= MAX_SPEED_RESENDS
        ):
            return ""
        flown_m_s = self._view.ground_speed_m_s
        if self._view.ground is not None and flown_m_s < self._speed_m_s:
            return ""  # over ground it flies to near targets
        if abs(flown_m_s - self._speed_m_s) <= max(
            MAX_SPEED_ERROR_M_S, MAX_SPEED_ERROR_SHARE * self._speed_m_s
        ):
            return ""
        self._begin_s = now_s
        self._sent += 1
        return (
            f"{self._name}: flies {flown_m_s:.1f} m/s instead of the {self._speed_m_s:g} m/s that "
            "were ordered; the speed is sent again"
        )
