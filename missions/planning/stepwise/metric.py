"""What a leg costs: the time that a robot needs from the centre of one cell to another's.

The cells move with the ROI. A robot of speed Sr relative to the ground that flies the displacement
d in the frame of an ROI which drifts with velocity p arrives after the time t at which
|d + p t| = Sr t. Along the axes these are the costs of Sung and Tokekar, section 4.2: 1 / (Sr - Sp)
with the drift, 1 / (Sr + Sp) against it, 1 / sqrt(Sr^2 - Sp^2) across.

The solution is a symmetric part plus d . p / (Sr^2 - p^2). The second is linear in d, so over a
closed tour it adds up to nothing: whoever compares closed tours needs the symmetric part only.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from missions.units import Cell


@dataclass(frozen=True, slots=True)
class Metric:
    """Costs in time; lengths are in cells, so speeds are in cells per unit of time.

    The default is a resting ROI and unit speed: a step to a neighbouring cell costs 1.

    >>> Metric(speed=1.0, drift_east=0.5).leg(Cell(0, 0), Cell(1, 0))
    2.0
    """

    speed: float = 1.0
    drift_east: float = 0.0
    drift_north: float = 0.0
    straight: bool = False
    """Whether a move may lead to any known cell, over cells that are not ROI, as in flight;
    otherwise only to one of the four neighbours."""
    look: float = 0.0
    """Time that a robot hovers over a cell to look from it."""
    ramp: float = 0.0
    """Time that speeding up and braking add to a long leg; a short one never gets up to speed.
    For planners (`from_rest`): `leg` and `tour_leg` are at full speed, so bounds from them hold."""
    passable: Callable[[Cell, Cell], bool] | None = None
    """Whether the straight way between two cells is allowed; None allows all."""

    def __post_init__(self) -> None:
        if not self.speed > math.hypot(self.drift_east, self.drift_north):
            raise ValueError(
                f"a robot of speed {self.speed:g} cannot keep up with a drift of "
                f"{math.hypot(self.drift_east, self.drift_north):g}"
            )

    @property
    def drift_speed(self) -> float:
        """Sp, in cells per unit of time."""
        return math.hypot(self.drift_east, self.drift_north)

    @property
    def least_per_length(self) -> float:
        """The least time per length of a closed tour: across the drift, 1 / sqrt(Sr^2 - Sp^2)."""
        return 1.0 / math.sqrt(self.speed**2 - self.drift_east**2 - self.drift_north**2)

    @property
    def most_per_length(self) -> float:
        """The most time per length of a closed tour: along the drift, Sr / (Sr^2 - Sp^2)."""
        return self.speed / (self.speed**2 - self.drift_east**2 - self.drift_north**2)

    def from_rest(self, leg: float) -> float:
        """Time of a leg from rest to rest, given its time at full speed, with even acceleration."""
        return leg + self.ramp if leg >= self.ramp else 2.0 * math.sqrt(leg * self.ramp)

    def leg(self, start: Cell, end: Cell) -> float:
        """Time from the centre of one cell to the centre of another, in a straight line."""
        east, north = end.east - start.east, end.north - start.north
        along = east * self.drift_east + north * self.drift_north
        rest = self.speed**2 - self.drift_east**2 - self.drift_north**2
        return (along + math.sqrt(along**2 + rest * (east**2 + north**2))) / rest

    def tour_leg(self, start: Cell, end: Cell) -> float:
        """The symmetric part of `leg`: what the leg adds to a closed tour."""
        east, north = end.east - start.east, end.north - start.north
        along = east * self.drift_east + north * self.drift_north
        rest = self.speed**2 - self.drift_east**2 - self.drift_north**2
        return math.sqrt(along**2 + rest * (east**2 + north**2)) / rest
