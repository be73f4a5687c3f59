"""A vehicle that is not where its path is by now.

Wind that it cannot fly against at the speed of its path, or a place that its satellite navigation
has corrected, leaves it behind. A path is an exact function of time, so it does not wait: the
vehicle is stopped, and the next path begins where it then is, no faster than the wind allows
(`missions.mission_file.views.path_speed_m_s`). Its guardian looks on, and is more patient.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from missions.events import Tracked
from missions.flight.lane_progress import lane_left
from missions.motion.trajectory import Trajectory
from missions.orders import FlyPath
from missions.state import Phase, Setting, VehicleState
from missions.units import GridPoint

OFF_PATH_M: Final = 6.0
"""A path is followed within a metre, a PX4's corners within 3 m; a report is half a second old."""
OFF_PATH_S: Final = 1.0
"""For so long: a gust is often made up for."""


def off_path(setting: Setting, vehicle: VehicleState, event: Tracked) -> VehicleState:
    """The vehicle after a report: stopped, if it has been off the path that it explores on."""
    order = vehicle.order
    if (
        not isinstance(order, FlyPath)
        or vehicle.phase is not Phase.AIRBORNE
        or vehicle.return_reason is not None
        or _due(order.trajectory, event.t_s).distance_to(event.position) <= OFF_PATH_M
    ):
        return vehicle if vehicle.off_path_s is None else replace(vehicle, off_path_s=None)
    since_s = event.t_s if vehicle.off_path_s is None else vehicle.off_path_s
    if event.t_s - since_s < OFF_PATH_S:
        return replace(vehicle, off_path_s=since_s)
    stopped = lane_left(vehicle.interrupted(event.t_s), setting.grid.cell_m)
    return replace(stopped, off_path_s=None)


def _due(path: Trajectory, t_s: float) -> GridPoint:
    """Where a path has the vehicle at a time, also in the second before it begins.

    The path that it replaces ends in its first motion, so that is reckoned back: what the
    acceleration of one second adds is a metre.
    """
    motion, early_s = path.at(t_s), max(path.begin_s - t_s, 0.0)
    return GridPoint(
        motion.east_m - motion.v_east_m_s * early_s, motion.north_m - motion.v_north_m_s * early_s
    )
