"""The ground of a simulated world that is not a level plane: a slope, hills, or measured heights.

Heights are in metres above the ground at the world's origin, in the plane's true east and north.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

Numbers = npt.NDArray[np.float64]

_RELIEF = 5  # keeps its stream of random numbers apart from those of `sitl.world.world`
_WAVES = 6


@dataclass(frozen=True, slots=True, eq=False)
class HeightField:
    """Measured heights on a lattice of the plane, bilinear; beyond its rim as on the rim.

    `heights_m[row, column]` is at (west_m + column * step_m, south_m + row * step_m).
    """

    west_m: float
    south_m: float
    step_m: float
    heights_m: Numbers


@dataclass(frozen=True)
class Relief:
    """A slope that rises towards a true bearing, smooth hills by seed, and measured heights.

    `slope` is rise over way (0.1: 10 %). The hills are waves of `hills_long_m` and more, and of
    `hills_high_m` from the deepest valley to the highest top at most.

    >>> slope = Relief(slope=0.1, rises_toward_deg=90.0)
    >>> round(slope.height_m(50.0, 7.0), 9)
    5.0
    """

    slope: float = 0.0
    rises_toward_deg: float = 0.0
    hills_high_m: float = 0.0
    hills_long_m: float = 100.0
    seed: int = 0
    field: HeightField | None = None

    @cached_property
    def _waves(self) -> list[tuple[float, float, float, float]]:
        """Amplitude, wave numbers along east and north, phase."""
        if self.hills_high_m <= 0.0:
            return []
        rng = np.random.default_rng([self.seed, _RELIEF])
        bearings = rng.uniform(0.0, math.tau, _WAVES)
        lengths = self.hills_long_m * np.geomspace(1.0, 2.0, _WAVES)
        phases = rng.uniform(0.0, math.tau, _WAVES)
        amplitude = self.hills_high_m / 2.0 / _WAVES
        return [
            (amplitude, math.tau / k * math.sin(b), math.tau / k * math.cos(b), p)
            for b, k, p in zip(bearings.tolist(), lengths.tolist(), phases.tolist(), strict=True)
        ]

    @cached_property
    def _origin_m(self) -> float:
        return sum(a * math.sin(p) for a, _, _, p in self._waves)

    @cached_property
    def _rise(self) -> tuple[float, float]:
        toward = math.radians(self.rises_toward_deg)
        return self.slope * math.sin(toward), self.slope * math.cos(toward)

    def height_m(self, east_m: float, north_m: float) -> float:
        """The height at one place."""
        rise_east, rise_north = self._rise
        height = east_m * rise_east + north_m * rise_north - self._origin_m
        for amplitude, k_east, k_north, phase in self._waves:
            height += amplitude * math.sin(k_east * east_m + k_north * north_m + phase)
        if self.field is not None:
            height += float(_bilinear(self.field, np.array(east_m), np.array(north_m)))
        return height

    def heights_m(self, east_m: Numbers, north_m: Numbers) -> Numbers:
        """The heights at many places: arrays of one shape."""
        rise_east, rise_north = self._rise
        height = east_m * rise_east + north_m * rise_north - self._origin_m
        for amplitude, k_east, k_north, phase in self._waves:
            height = height + amplitude * np.sin(k_east * east_m + k_north * north_m + phase)
        if self.field is not None:
            height = height + _bilinear(self.field, east_m, north_m)
        return np.asarray(height, dtype=np.float64)


def _bilinear(field: HeightField, east_m: Numbers, north_m: Numbers) -> Numbers:
    z = field.heights_m
    rows, columns = z.shape
    column = np.clip((east_m - field.west_m) / field.step_m, 0.0, columns - 1.0)
    row = np.clip((north_m - field.south_m) / field.step_m, 0.0, rows - 1.0)
    i = np.minimum(row.astype(np.intp), rows - 2)
    j = np.minimum(column.astype(np.intp), columns - 2)
    up, right = row - i, column - j
    south = z[i, j] * (1.0 - right) + z[i, j + 1] * right
    north = z[i + 1, j] * (1.0 - right) + z[i + 1, j + 1] * right
    return np.asarray(south * (1.0 - up) + north * up, dtype=np.float64)
