"""The air that the fake fleet flies in: a given wind, gusts, and storms that nobody gave."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field

ROUGHNESS_M = 0.03
"""Of a meadow: the wind is weaker near the ground."""
REFERENCE_M = 12.0
"""Winds are told for this height."""
STRONGEST_M_S = 25.0
"""At any height, gusts included."""
RAMP_S = 3.0
"""A storm comes up within this time."""
GUST_TAU_S = 4.0

Vector = tuple[float, float]


def profile(height_m: float) -> float:
    """The logarithmic wind profile: the share of the wind at the reference height.

    >>> round(profile(12.0), 2), round(profile(1.0), 2)
    (1.0, 0.59)
    """
    at_m = min(max(height_m, 0.5), 60.0)
    return math.log(at_m / ROUGHNESS_M) / math.log(REFERENCE_M / ROUGHNESS_M)


@dataclass(frozen=True, slots=True)
class Storm:
    """Wind besides the given one, at the reference height, towards east and north."""

    begin_s: float
    end_s: float
    wind_m_s: Vector

    def share(self, t_s: float) -> float:
        """How much of it blows now."""
        return min(max((t_s - self.begin_s) / RAMP_S, 0.0), 1.0) if t_s < self.end_s else 0.0


@dataclass(slots=True)
class Air:
    """Wind by time and height; gusts wander by `rng`."""

    given_m_s: Vector = (0.0, 0.0)
    gust_m_s: float = 0.0
    storms: list[Storm] = field(default_factory=list)
    rng: random.Random = field(default_factory=lambda: random.Random(0))
    _gust: Vector = (0.0, 0.0)

    def step(self, dt_s: float) -> None:
        """Let the gusts wander."""
        if self.gust_m_s > 0.0:
            keep = math.exp(-dt_s / GUST_TAU_S)
            kick = self.gust_m_s * math.sqrt(1.0 - keep * keep)
            self._gust = (
                keep * self._gust[0] + kick * self.rng.gauss(0.0, 1.0),
                keep * self._gust[1] + kick * self.rng.gauss(0.0, 1.0),
            )

    def wind(self, t_s: float, height_m: float) -> Vector:
        """The wind now, towards east and north."""
        east, north = self.given_m_s[0] + self._gust[0], self.given_m_s[1] + self._gust[1]
        for storm in self.storms:
            share = storm.share(t_s)
            east += share * storm.wind_m_s[0]
            north += share * storm.wind_m_s[1]
        strength = math.hypot(east, north)
        if strength == 0.0:
            return 0.0, 0.0
        weaker = min(profile(height_m), STRONGEST_M_S / strength)
        return weaker * east, weaker * north
