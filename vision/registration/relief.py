"""Ground that is not flat, in the metres of a registration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from missions.geo.terrain import Terrain
from missions.units import GridPoint
from vision.registration.views import Floats

_REACH_M: Final = 500.0
_ROUNDS: Final = 8  # of a ray's way to the ground: each leaves slope times obliqueness of the error


@dataclass(frozen=True, slots=True)
class Relief:
    """Heights of the ground above the level that cameras' heights are counted from.

    Attributes:
        terrain: The heights, in metres of a grid.
        matrix: 2 x 2, from metres (true east, true north) to those of the grid.
        offset_m: The middle of the registration in the grid.
        level_m: The terrain's height where cameras' heights are 0: at the start.
    """

    terrain: Terrain
    matrix: Floats
    offset_m: Floats
    level_m: float

    @classmethod
    def of(
        cls, terrain: Terrain, level_m: float, to_grid: Callable[[float, float], GridPoint]
    ) -> Self:
        """Build one from `to_grid`, which takes metres of the registration into the grid.

        Within kilometres it is straight, to millimetres.
        """
        middle = np.array(to_grid(0.0, 0.0))
        east = (np.array(to_grid(_REACH_M, 0.0)) - np.array(to_grid(-_REACH_M, 0.0))) / 2.0
        north = (np.array(to_grid(0.0, _REACH_M)) - np.array(to_grid(0.0, -_REACH_M))) / 2.0
        return cls(terrain, np.stack([east, north], axis=1) / _REACH_M, middle, level_m)

    def at(self, places: Floats) -> Floats:
        """Return the height at places (n, 2), metres (east, north); anything where they are NaN."""
        east, north = (np.nan_to_num(places) @ self.matrix.T + self.offset_m).T
        heights: Floats = self.terrain.at(east, north) - self.level_m
        return heights

    def rise(self, places: Floats) -> Floats:
        """Return how steeply it rises there towards east and north, (n, 2), tangents."""
        step_m = self.terrain.step_m / 2.0
        both = []
        for axis in (0, 1):
            away = np.zeros(2)
            away[axis] = step_m
            both.append((self.at(places + away) - self.at(places - away)) / (2.0 * step_m))
        return np.stack(both, axis=1)

    def met(self, centre_m: Floats, along: Floats) -> Floats:
        """Return the ground's height where rays from `centre_m` (n, 3) meet it.

        `along` (n, 2) is how far each goes over the ground for a metre down.
        """
        height = self.at(centre_m[:, :2])
        for _ in range(_ROUNDS):
            place = centre_m[:, :2] + (centre_m[:, 2] - height)[:, None] * along
            height = self.at(place)
        return height
