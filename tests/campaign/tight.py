"""Small missions that press on energy and on the air: batteries that just suffice, crossing paths.

Pads lie among each other's paths, near each other, some in the region. So vehicles take off and
land below others, at the same time, and many times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from missions.errors import MissionFileError
from missions.lab.arena.roi import eden
from missions.units import Cell
from tests.support.small_missions import (
    CELL_M,
    UNKIND_STRATEGIES,
    Scenario,
    mission,
    scattered,
    square,
)

POWER_W: Final = 345.0
"""Power in forward flight by the missions: 1.15 times that of hovering."""
USABLE: Final = 0.85
"""Share of the capacity above the reserve."""
AIRSPEED_M_S: Final = 12.0
LOWEST_M: Final = 14.0
MIN_APART_M: Final = 4.1
"""Distance of two pads; the separation is 4 m."""
RATES_M_S: Final = 1.5
"""Climb and descent of the points of this world, where a mission states them."""


@dataclass(frozen=True, slots=True)
class Tight:
    """A mission, and what its world is like."""

    scenario: Scenario
    draw: float
    """True power as a share of the mission's."""
    wind_m_s: float
    """True wind at the reference height."""
    reports_wind: bool


def tight_scenario(seed: int, strategy: str | None = None) -> Tight:
    """Return the mission of a seed; what cannot be flown is drawn again."""
    rng = np.random.default_rng([seed, 13])
    while True:
        try:
            return _drawn(rng, seed, strategy)
        except MissionFileError:
            continue


def _drawn(rng: np.random.Generator, seed: int, strategy: str | None) -> Tight:
    vehicles = int(rng.choice([1, 2, 3, 4, 5], p=[0.15, 0.15, 0.3, 0.2, 0.2]))
    width_m, depth_m = float(rng.uniform(24, 60)), float(rng.uniform(16, 40))
    away_m = float(rng.choice([0.0, 12.0, 24.0, 120.0], p=[0.4, 0.2, 0.15, 0.25]))
    bearing = float(rng.uniform(0.0, math.tau))
    middle = away_m * math.sin(bearing), away_m * math.cos(bearing)
    box = square(middle[0] - width_m / 2, middle[1] - depth_m / 2, width_m, depth_m)
    homes = _homes(rng, vehicles, float(rng.choice([6.0, 12.0, 20.0])))
    all_m = [*box, *homes]
    west_m, east_m = min(x for x, _ in all_m) - 25, max(x for x, _ in all_m) + 25
    south_m, north_m = min(y for _, y in all_m) - 25, max(y for _, y in all_m) + 25
    given_m_s = float(rng.choice([0.0, 3.0, 6.0, 8.0]))
    reports_wind = bool(rng.random() < 0.7)
    gentle_m_s = given_m_s * float(rng.uniform(0.4, 0.8))
    wind_m_s = float(rng.uniform(0.0, 7.0)) if reports_wind and rng.random() < 0.5 else gentle_m_s
    layer_m, speed_m_s = float(rng.choice([4.5, 6.0])), float(rng.choice([2.5, 5.0, 8.0]))
    rate_m_s = RATES_M_S if rng.random() < 0.5 else None
    drawn = strategy or str(rng.choice(UNKIND_STRATEGIES))
    find = str(rng.choice(["first", "all", "high"])) if drawn == "swath" else "first"
    layers = (2 if find == "high" else 1) * vehicles
    top_m = LOWEST_M + layer_m * (layers - 1) + (10.0 if find == "high" else 0.0)
    out_m = max(math.dist(home, corner) for home in homes for corner in box)
    sortie_s = 2.0 * out_m / min(speed_m_s, AIRSPEED_M_S - given_m_s) + speed_m_s
    sortie_s += top_m / RATES_M_S + 5.0 + 4.0 + 32.0 + (top_m - 10.0) / (rate_m_s or 0.5)
    plenty = float(rng.choice([rng.uniform(0.75, 1.0), rng.uniform(1.0, 1.3)]))
    made = mission(
        box, square(west_m, south_m, east_m - west_m, north_m - south_m), vehicles=vehicles,
        homes=homes, altitude_m=LOWEST_M, mounting="gimbal", layer_m=layer_m,
        wind_m_s=given_m_s, speed_m_s=speed_m_s, rate_m_s=rate_m_s, strategy=drawn,
        capacity_wh=plenty * sortie_s * POWER_W / 3600.0 / USABLE,
    )  # fmt: skip
    seat = Cell(
        round((middle[0] + float(rng.uniform(-0.3, 0.3)) * width_m) / CELL_M),
        round((middle[1] + float(rng.uniform(-0.3, 0.3)) * depth_m) / CELL_M),
    )
    grown = eden(int(rng.integers(8, 50)), rng)
    roi = frozenset(Cell(seat.east + e, seat.north + n) for e, n in grown)
    scenario = Scenario(made, roi)
    if find != "first":
        scenario = scattered(scenario, seed, high=find == "high")
    return Tight(scenario, float(rng.uniform(0.9, 1.3)), wind_m_s, reports_wind)


def _homes(rng: np.random.Generator, vehicles: int, radius_m: float) -> list[tuple[float, float]]:
    """Return pads in a square around the start, not too near to each other."""
    homes: list[tuple[float, float]] = []
    while len(homes) < vehicles:
        east_m, north_m = rng.uniform(-radius_m, radius_m, 2)
        if all(math.hypot(east_m - x, north_m - y) >= MIN_APART_M for x, y in homes):
            homes.append((float(east_m), float(north_m)))
    return homes
