"""Input and output of path planning: vehicles, waypoints, tours, and weights.

No kernel is loaded here, which takes a second; the first plan does that
(`missions.planning.sweep.memo`). Lengths are metres in the frame of the region.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.geo.trajectory import Trajectory
from missions.units import GridPoint

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Route:
    """The waypoints of a path: (east, north, maximum cut of its corner); the last ends it."""

    waypoints: tuple[tuple[float, float, float], ...]
    passed_m: tuple[float, ...] = ()
    """Position along its path where the vehicle has passed each waypoint, m."""


Valued = tuple[Floats, Ints, Ints, int]
"""Worth by cell, frames needed by cell, cells with worth, and how many of them are work."""


@dataclass(frozen=True, slots=True)
class Tuning:
    """The weights of the search; found on grown regions that no test or benchmark uses."""

    penalty_s: float = 30.0
    """Cost of a needed cell without its frames, s; more if it is far away.

    See `missions.planning.sweep.sweep_planner`.
    """
    prize_s: float = 2.0
    """Worth of deciding a cell that will certainly be needed, s."""
    fade_1_s: float = 0.04
    """Fading of that worth with the time of the frame, 1/s: uncertain cells come early."""
    last_share: float = 0.95
    """Share of the last vehicle in a team's time; the rest is the mean."""
    rings: int = 4
    """Number of cells beyond the work that are considered."""
    least_chance: float = 0.08
    moves: int = 700
    tour_moves: int = 5000
    """Moves from the waypoints of tours, which come every few seconds and are a rough beginning."""
    tour_moves_each: int = 100
    """Moves per waypoint of the tour of one vehicle alone, `moves` to `tour_moves` in all."""
    hot_s: float = 0.6
    cold_s: float = 0.03
    keep_s: float = 0.5
    """Minimum gain of another path over the one under way, s."""
    cut_m: float = 1.0
    """First cut of a new waypoint, m."""
    turn_m_s: float = 2.4
    """Minimum speed of a turn on the way, m/s."""
    turn_wide_m_s: float = 4.0


@dataclass(frozen=True, slots=True)
class Kinematics:
    """The kinematics of a vehicle, and the view of its frames."""

    speed_m_s: float
    accel_m_s2: float
    frame_s: float
    half_east_m: float
    """Maximum distance of a whole cell's centre from the middle of the frame, m."""
    half_north_m: float
    tilt_m_s2: float = 0.0
    """Shift of the frame per thrust, m per m/s^2: height / g if the camera tilts with the airframe.

    0 for a gimbal.
    """
    drag_1_s: float = 0.0
    """Thrust per airspeed, m/s^2 for each m/s."""
    wind_east_m_s: float = 0.0
    wind_north_m_s: float = 0.0

    def reach(self, cell_m: float) -> tuple[int, int]:
        """Return the number of whole columns and rows that a frame shows to either side of a
        cell."""
        return math.floor(self.half_east_m / cell_m), math.floor(self.half_north_m / cell_m)


@dataclass(frozen=True, slots=True)
class Flyer:
    """A vehicle that takes part in a plan."""

    kinematics: Kinematics
    place: GridPoint
    """Its place if it flies no path."""
    end: GridPoint
    """End of its path."""
    path: Trajectory | None = None
    route: Route | None = None
    """Route of the path."""
    blind_s: float = 0.0
    """Time from the beginning of a plan until a frame counts, s: the vehicle still descends."""


@dataclass(frozen=True, slots=True)
class Plan:
    """The result of planning: paths that begin now, or None where the present one continues."""

    paths: tuple[Trajectory | None, ...]
    routes: tuple[Route, ...]
    work: int
    """Number of cells that are needed and not decided."""
    cost_s: float


MIN_WORK: Final = 24
"""Minimum number of cells for a tour; fewer are left to annealing alone."""
MIN_TOUR_GAIN_S: Final = 2.0
"""Minimum gain of new tours over the last ones, s."""
CUT_M: Final = 5.0
"""First cut of a corner of a tour, m; pictures from a height tolerate it."""

Tour = tuple[tuple[float, float, float], ...]
Waypoints = tuple[Tour, ...]
"""Waypoints of each vehicle without the end: (east, north, maximum cut of its corner)."""


@dataclass(frozen=True, slots=True)
class Tours:
    """Tours to begin a plan with."""

    waypoints: Waypoints
    mine: Ints
    """By cell of the chart: the vehicle that is to see it; -1 if none has to."""
    cost_s: float
