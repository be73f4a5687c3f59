"""Who takes part in a plan without stopping: what they can fly and see, and what the search weighs.

Lengths are metres in the frame of the region.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from missions.geo.trajectory import Trajectory
from missions.planning.kernels import swath as kernels
from missions.planning.sweep.paths import Floats, Ints, Route
from missions.units import GridPoint

Valued = tuple[Floats, Ints, Ints, int]
"""Worth by cell, frames needed by cell, cells with worth, and how many of them are work."""

FULL_RATE_S: Final = 20.0
"""Frames that lie farther in the future are counted by twos."""


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

    def row(self, tuning: Tuning, next_frame_s: float) -> Floats:
        """The parameters as the kernels take them."""
        row = np.zeros(kernels.PARAMETERS)
        row[kernels.FADE_1_S] = tuning.fade_1_s
        row[kernels.SPEED], row[kernels.ACCEL] = self.speed_m_s, self.accel_m_s2
        row[kernels.CUT], row[kernels.TURN_V] = tuning.cut_m, tuning.turn_m_s
        row[kernels.FRAME_S], row[kernels.NEXT_FRAME_S] = self.frame_s, next_frame_s
        row[kernels.FULL_RATE_S] = FULL_RATE_S
        row[kernels.HALF_X], row[kernels.HALF_Y] = self.half_east_m, self.half_north_m
        row[kernels.TILT], row[kernels.DRAG] = self.tilt_m_s2, self.drag_1_s
        row[kernels.WIND_X], row[kernels.WIND_Y] = self.wind_east_m_s, self.wind_north_m_s
        return row


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
    """So long after a plan begins it takes no frame that counts: it still comes down."""
