"""What paths are planned for, and plans: vehicles, waypoints, tours, and what is weighed.

No kernel is loaded here, which takes a second: that is done by the first plan
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
    """The waypoints of a path: (east, north, how far its corner may be cut); the last ends it."""

    waypoints: tuple[tuple[float, float, float], ...]
    passed_m: tuple[float, ...] = ()
    """How far along its path each is behind the vehicle."""


Valued = tuple[Floats, Ints, Ints, int]
"""Worth by cell, frames needed by cell, cells with worth, and how many of them are work."""


@dataclass(frozen=True, slots=True)
class Tuning:
    """What the search weighs; found on grown regions that no test or benchmark uses."""

    penalty_s: float = 30.0
    """What it costs to leave a cell that is needed without its frames; more where it is far away
    (`missions.planning.sweep.sweep_planner`)."""
    prize_s: float = 2.0
    """What it is worth to decide a cell that will be needed for certain."""
    fade_1_s: float = 0.04
    """How fast that fades the later it is seen, a second: what is uncertain comes early."""
    last_share: float = 0.95
    """How much of a team's time is that of the last vehicle; the rest is the mean."""
    rings: int = 4
    """How many cells beyond the work are considered."""
    least_chance: float = 0.08
    moves: int = 700
    tour_moves: int = 5000
    """From the waypoints of tours, which come every few seconds and are a rough beginning."""
    tour_moves_each: int = 100
    """For each waypoint of the tour of one vehicle alone, `moves` to `tour_moves` in all."""
    hot_s: float = 0.6
    cold_s: float = 0.03
    keep_s: float = 0.5
    """A path under way is kept unless another is better by this."""
    cut_m: float = 1.0
    """By how much a new waypoint is cut at first."""
    turn_m_s: float = 2.4
    """The slowest speed of a turn on the way."""
    turn_wide_m_s: float = 4.0


@dataclass(frozen=True, slots=True)
class Kinematics:
    """What a vehicle can fly, and what its frames show."""

    speed_m_s: float
    accel_m_s2: float
    frame_s: float
    half_east_m: float
    """A cell is seen whole when its centre is no farther than this from the middle of the frame."""
    half_north_m: float
    tilt_m_s2: float = 0.0
    """By how many metres the frame shifts for each m/s^2 of thrust: height / g of a camera that
    tilts with the airframe, 0 of one in a gimbal."""
    drag_1_s: float = 0.0
    """Thrust that a speed through the air takes."""
    wind_east_m_s: float = 0.0
    wind_north_m_s: float = 0.0

    def reach(self, cell_m: float) -> tuple[int, int]:
        """How many whole columns and rows of cells a frame shows to either side of a cell."""
        return math.floor(self.half_east_m / cell_m), math.floor(self.half_north_m / cell_m)


@dataclass(frozen=True, slots=True)
class Flyer:
    """A vehicle that takes part in a plan."""

    kinematics: Kinematics
    place: GridPoint
    """Where it stands if it flies no path."""
    end: GridPoint
    """Where its path ends."""
    path: Trajectory | None = None
    route: Route | None = None
    """Of the path."""
    blind_s: float = 0.0
    """Time from the beginning of a plan until a frame counts, s: the vehicle still descends."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What comes of it: paths that begin now, or None where the one under way is flown on."""

    paths: tuple[Trajectory | None, ...]
    routes: tuple[Route, ...]
    work: int
    """Cells that are needed and not decided."""
    cost_s: float


LEAST_WORK: Final = 24
"""Cells; less is left to annealing alone."""
KEEP_S: Final = 2.0
"""Least gain of new tours over the last ones, s."""
CUT_M: Final = 5.0
"""By how much a corner of a tour is cut at first; pictures from on high forgive it."""

Tour = tuple[tuple[float, float, float], ...]
Waypoints = tuple[Tour, ...]
"""Of each vehicle, the end not among them: (east, north, how far its corner may be cut)."""


@dataclass(frozen=True, slots=True)
class Tours:
    """What to begin a plan with."""

    waypoints: Waypoints
    mine: Ints
    """By cell of the chart: which vehicle is to see it; -1 where none has to."""
    cost_s: float
