"""Legs over ground that is not flat: targets that lie so near that the ground between is cleared.

An autopilot flies straight to its target, and may climb or descend first. So it is told a target
no farther ahead than the ground keeps nearly level, at the height of the highest ground until
there, and while it flies the next one, further on. Should it hear nothing more it stops there.
"""

from __future__ import annotations

from typing import Final

from missions.mission.energy import CLIMB_SPEED_M_S, EnergyModel
from missions.units import GridPoint
from uavmap.mavlink.vehicle_view import VehicleView

HEIGHT_M: Final = 1.0
OTHER_LAYER_M: Final = 1.5
"""An order whose height is farther from the vehicle's changes its layer."""
"""A vehicle that is to stop over ground has arrived within so much of its height: it may still
descend when it is over the place."""


def aim_over_ground(
    view: VehicleView, here: GridPoint, target: GridPoint, height_m: float
) -> tuple[GridPoint, float]:
    """What to be told on a leg to `target` at `height_m` above ground: a point, a height there.

    Over flat ground that is the target.
    """
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
    """Whether a vehicle is as high as it should be.

    Over flat ground its layer is its height, but where it changes its layer (`always`).
    """
    flat = view.ground is None and not always
    return flat or abs(view.height_m - height_m) <= HEIGHT_M
