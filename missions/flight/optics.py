"""What a vehicle that does not stop can fly and see, from the mission file, for the planner."""

from __future__ import annotations

from typing import TYPE_CHECKING

from missions.flight.setting import Setting
from missions.flight.state import VehicleState
from missions.mission.views import DRAG_1_S, G_M_S2, path_speed_m_s, seen_whole_m, wind_toward

if TYPE_CHECKING:
    from missions.planning.sweep.planned_team import Kinematics


def kinematics(setting: Setting, vehicle: VehicleState) -> Kinematics:
    """Of one vehicle in its layer, along the grid's axes.

    The nose is held at `setting.yaw_rad`, so the picture's sides lie along the axes.
    """
    from missions.planning.sweep.planned_team import Kinematics  # noqa: PLC0415 - numba takes a second to load

    mission, grid = setting.mission, setting.grid
    height_m = vehicle.cruise_height_m
    half_east_m, half_north_m = seen_whole_m(mission, height_m, east_ahead=setting.east_ahead)
    fixed = mission.camera.mounting == "fixed"
    wind_east, wind_north = wind_toward(mission, grid)
    return Kinematics(
        speed_m_s=path_speed_m_s(mission, height_m, vehicle.wind_m_s),
        accel_m_s2=setting.energy.accel_m_s2,
        frame_s=mission.camera.interval_s,
        half_east_m=max(half_east_m, 0.1),
        half_north_m=max(half_north_m, 0.1),
        tilt_m_s2=height_m / G_M_S2 if fixed else 0.0,
        drag_1_s=DRAG_1_S,
        wind_east_m_s=wind_east - grid.drift_east_m_s,  # relative to the region
        wind_north_m_s=wind_north - grid.drift_north_m_s,
    )
