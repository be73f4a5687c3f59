"""Legs to a target: over ground that is not flat, and at the speed that was ordered.

An autopilot flies straight to its target, and may climb or descend first. So its targets lie no
farther ahead than the ground keeps nearly level, at the height of the highest ground until there;
on the way it gets the next one. Without another it stops there. An autopilot may put its own speed
back at a target, and a pilot may set another: the speed of a long leg is watched.
"""

from __future__ import annotations

from typing import Final

from missions.mission.energy import CLIMB_SPEED_M_S, EnergyModel
from missions.units import GridPoint
from uavmap.mavlink.vehicle_view import VehicleView

HEIGHT_M: Final = 1.0
"""Error of its height within which a vehicle, still descending, has arrived over ground, m."""
OTHER_LAYER_M: Final = 1.5
"""An order whose height is farther from the vehicle's changes its layer."""
FULL_SPEED_S: Final = 5.0
"""By then a leg is flown at its full speed."""
ACCEL_M_S2: Final = 2.0
FAR_SHARE: Final = 0.3
FAR_M_S: Final = 1.0
"""A speed is far from the order if it is off by more than both."""
MOST_RESENT: Final = 2
"""Number of times in a leg that the speed is sent again: a wind that is too strong stays."""


def aim_over_ground(
    view: VehicleView, here: GridPoint, target: GridPoint, height_m: float
) -> tuple[GridPoint, float]:
    """The target to send on a leg at a height above ground, and its height, as far ahead as may
    be."""
    if view.ground is None:
        return target, height_m
    return view.ground.terrain.told(here, view.height_m, target, height_m)


def leg_over_ground_s(
    view: VehicleView, energy: EnergyModel, here: GridPoint, target: GridPoint
) -> float:
    """About how long a leg takes, in seconds, from rest to rest; on steep ground it is slow."""
    level_s = energy.leg_s(here.distance_to(target))
    if view.ground is None:
        return level_s
    climb_m = view.ground.terrain.ups_and_downs_m((here, target), energy.speed_m_s, CLIMB_SPEED_M_S)
    return level_s + climb_m / CLIMB_SPEED_M_S


def at_height(view: VehicleView, height_m: float, *, always: bool = False) -> bool:
    """Whether a vehicle is as high as it should be; over flat ground its layer is its height, but
    where it changes its layer (`always`)."""
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
        """What is wrong, for the operator; empty while nothing is, or nothing can be known. Called
        now and then; `left_m` is left of the leg, at whose end the vehicle brakes."""
        braking_m = self._speed_m_s**2 / (2.0 * ACCEL_M_S2)
        soon_m = braking_m + self._speed_m_s * FULL_SPEED_S
        if now_s - self._begin_s < FULL_SPEED_S or left_m < soon_m or self._sent >= MOST_RESENT:
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
