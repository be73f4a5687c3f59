"""The view of a vehicle that does not stop, and the speed of its paths."""

from __future__ import annotations

import math
from typing import Final

from missions.geo.grid import Grid
from missions.mission.height_and_speed import footprint_over, headway_m_s, speed_limits
from missions.mission.schema import Mission

MAX_PATH_SPEED_M_S: Final = 8.0
"""Maximum speed of paths, m/s: faster, an ArduCopter leans over 22 degrees and follows worse."""
TRACK_ERROR_M: Final = 0.3
"""Usual distance of a vehicle from its path, besides the error of its position, m."""
G_M_S2: Final = 9.81
DRAG_1_S: Final = 0.25
"""Thrust of a quadcopter by airspeed near 6 m/s, m/s^2 for each m/s."""
MAX_LEVEL_SPEED_M_S: Final = 10.0
"""Maximum speed with a gimbal camera, which stays level and is higher up, m/s."""
MIN_PATH_SPEED_M_S: Final = 0.3
"""Minimum speed of paths, m/s; slower maps need stops."""
MIN_CELL_SHARE: Final = 0.5
"""Minimum part of `detector.share` that a cell on the map shows, for any error of the pose."""


def path_speed_m_s(mission: Mission, height_m: float, wind_m_s: float = 0.0) -> float:
    """Return the speed of paths at a height, in the frame of the region, m/s.

    `wind_m_s` is the measured wind; the mission file's counts if it is stronger.
    """
    held = mission.camera.mounting == "gimbal"
    most_m_s = min(
        MAX_LEVEL_SPEED_M_S if held else MAX_PATH_SPEED_M_S, headway_m_s(mission, wind_m_s)
    )
    return max(MIN_PATH_SPEED_M_S, min(most_m_s, speed_limits(mission, height_m).least_m_s))


def rim_share(mission: Mission) -> float:
    """Return the mean share of a cell's pixels from which it belongs on the map, at the edge.

    An error of the pose moves the outline by `camera.pose_error_m`, in all frames of a pass alike.
    So it may hide a strip of that width of a cell that is region in `detector.share` of it.

    >>> from types import SimpleNamespace as Of
    >>> camera, detector, grid = Of(pose_error_m=0.5), Of(share=0.25), Of(cell_m=4.0)
    >>> rim_share(Of(camera=camera, detector=detector, grid=grid))
    0.125
    """
    hidden = mission.camera.pose_error_m / mission.grid.cell_m
    return max(mission.detector.share - hidden, MIN_CELL_SHARE * mission.detector.share)


def seen_whole_m(mission: Mission, height_m: float, *, east_ahead: bool) -> tuple[float, float]:
    """Return the distance east and north of a level picture's middle up to which cells are whole,
    m.

    The wide side of the picture is across the lanes: north of lanes along east (`east_ahead`).
    `camera.yaw_deg` turns it.
    """
    footprint = footprint_over(mission, height_m)
    margin_m = mission.camera.pose_error_m + TRACK_ERROR_M
    turn = math.radians(mission.camera.yaw_deg)
    cos, sin = abs(math.cos(turn)), abs(math.sin(turn))
    reach_m = mission.grid.cell_m / 2.0 * (cos + sin) + margin_m
    across_m = footprint.across_m / 2.0 - reach_m
    along_m = footprint.along_m / 2.0 - reach_m
    if sin > 1e-6 and cos > 1e-6:  # the square that fits at any turn
        across_m = along_m = min(across_m, along_m) / (cos + sin)
    elif sin > cos:
        across_m, along_m = along_m, across_m
    return (along_m, across_m) if east_ahead else (across_m, along_m)


def wind_toward(mission: Mission, grid: Grid) -> tuple[float, float]:
    """Return the motion of the mission file's wind along the grid's axes, east and north, m/s."""
    toward = math.radians(mission.wind.from_deg) + math.pi - grid.convergence_rad
    return mission.wind.speed_m_s * math.sin(toward), mission.wind.speed_m_s * math.cos(toward)


def reaches_m(
    mission: Mission, grid: Grid, height_m: float, *, east_ahead: bool
) -> tuple[float, float]:
    """Return the distance of whole cells to either side of a lane (west, east or south, north), m.

    The cell is shown whole in calm air and in the wind of the mission. A camera that tilts with the
    airframe looks downwind, so the windward edge of the picture comes nearer.
    """
    halves = seen_whole_m(mission, height_m, east_ahead=east_ahead)
    level_m = halves[1] if east_ahead else halves[0]
    if mission.camera.mounting != "fixed":
        return level_m, level_m
    blows_m_s = wind_toward(mission, grid)[1 if east_ahead else 0]
    lean_rad = math.atan(DRAG_1_S * abs(blows_m_s) / G_M_S2)
    margin_m = mission.grid.cell_m / 2.0 + mission.camera.pose_error_m + TRACK_ERROR_M
    edge_rad = math.atan((level_m + margin_m) / height_m)
    windward_m = height_m * math.tan(edge_rad - lean_rad) - margin_m
    return (windward_m, level_m) if blows_m_s > 0.0 else (level_m, windward_m)


def rows_across(mission: Mission, grid: Grid, vehicle: int = 0, *, east_ahead: bool) -> int:
    """Return the rows of cells that a lane decides, from the search layer of a vehicle (from 0)."""
    reaches = reaches_m(mission, grid, mission.top_altitude_m(vehicle), east_ahead=east_ahead)
    return max(1, math.floor(max(sum(reaches), 0.0) / mission.grid.cell_m) + 1)


def beside_rows_m(mission: Mission, grid: Grid, height_m: float, *, east_ahead: bool) -> float:
    """Return how far to windward of the middle of its rows a lane is flown, m east or north.

    So the rows are in the picture whether the wind of the mission blows or not.
    """
    low_m, high_m = reaches_m(mission, grid, height_m, east_ahead=east_ahead)
    most_m = max(low_m, high_m, 0.0)
    return min(max((low_m - high_m) / 2.0, -most_m), most_m)
