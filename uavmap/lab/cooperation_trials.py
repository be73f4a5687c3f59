"""Exploration by robots that watch each other: terms, run and figures."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from missions.errors import AreaError
from missions.lab.cooperation import trapezoids, triangulation
from missions.lab.cooperation.exploration import Exploration, Figures, unseen
from missions.lab.cooperation.space import Point, Space
from missions.lab.cooperation.tracking import Noise, Outcome, followed
from missions.lab.cooperation.trapezoids import Cover, Pattern

LOOKED_AT: Final = 400
"""Number of points that are checked whether a robot saw them, beside all corners."""
_SPACING: Final = 1.0 / 20.0
"""Spacing of robots' places in that check, in ranges."""


class Mode(StrEnum):
    """How a team explores."""

    TRAPEZOID = "trapezoid"
    TRIANGULATION = "triangulation"
    COLUMN = "column"


@dataclass(frozen=True, slots=True)
class Cooperation:
    """The terms of an exploration. `theta_rad` and `cover` are for stripes only."""

    mode: Mode
    robots: int
    range_m: float
    theta_rad: float
    cover: Cover = Cover.TRIANGLES
    seed: int = 1
    """Of the noise, and of the points that are looked at."""


@dataclass(frozen=True, slots=True)
class Report:
    """The result of an exploration."""

    terms: Cooperation
    exploration: Exploration
    numbers: Figures
    unseen: NDArray[np.float64]
    """Points, of those looked at, that no robot had within range and sight; shape (n, 2)."""
    looked_at: int
    watched: Outcome
    alone: Outcome

    @property
    def complete(self) -> bool:
        """Whether all of the ground is on the map, and was seen."""
        slack_m2 = 1e-6 * self.exploration.space.area_m2
        return self.numbers.missed_m2 <= slack_m2 and not len(self.unseen)

    def figures(self) -> dict[str, Any]:
        """Return all figures for JSON; the same for the same seed."""
        terms, space = self.terms, self.exploration.space
        stripes = terms.mode is not Mode.TRIANGULATION
        numbers = {key: _rounded(value) for key, value in asdict(self.numbers).items()}
        return {
            "cooperate": terms.mode.value,
            "cover": terms.cover.value if terms.mode is Mode.TRAPEZOID else None,
            "robots": terms.robots,
            "range_m": terms.range_m,
            "theta_deg": round(math.degrees(terms.theta_rad), 6) if stripes else None,
            "seed": terms.seed,
            "start_m": list(self.exploration.start),
            "area_m2": _rounded(space.area_m2),
            "holes": len(space.rings) - 1,
            "reflex_corners": space.reflex_corners,
            "complete": self.complete,
            **numbers,
            "points_looked_at": self.looked_at,
            "points_unseen": len(self.unseen),
            "final_places": [
                {
                    "robot": robot + 1,
                    "watched": _end(self.watched, robot),
                    "alone": _end(self.alone, robot),
                }
                for robot in range(terms.robots)
            ],
        }


def _rounded(value: float) -> float:
    return round(value, 6)


def _end(outcome: Outcome, robot: int) -> dict[str, float]:
    ellipse = {key: _rounded(value) for key, value in asdict(outcome.ellipse(robot)).items()}
    return {
        "error_m": _rounded(outcome.error_m(robot)),
        "sigma_m": _rounded(outcome.sigma_m(robot)),
        **{f"ellipse_{key}": value for key, value in ellipse.items()},
    }


def cooperate(
    space: Space, terms: Cooperation, start: Point | None = None, noise: Noise | None = None
) -> Report:
    """Explore, check what was seen, and follow the robots' belief of their places.

    Raises `AreaError` for a start outside of the ground, `StrategyError` for a range that does not
    fit it.
    """
    if start is None:  # the southernmost corner, of several the western
        start = min(space.corners, key=lambda corner: (corner[1], corner[0]))
    if not space.holds(start):
        raise AreaError(f"the start {start[0]:g},{start[1]:g} m is not in the area")
    if terms.mode is Mode.TRIANGULATION:
        exploration = triangulation.explore(space, start, terms.range_m)
    else:
        pattern = Pattern(terms.range_m, terms.theta_rad, terms.robots, terms.cover)
        exploration = trapezoids.explore(space, start, pattern)
    points = _points(space, np.random.default_rng((terms.seed, 2)))
    watched, alone = followed(exploration, noise or Noise(), terms.seed)
    return Report(
        terms,
        exploration,
        exploration.figures(),
        unseen(exploration, points, terms.range_m * _SPACING),
        len(points),
        watched,
        alone,
    )


def _points(space: Space, rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw points all over the ground, after its corners."""
    west, south, east, north = space.polygon.bounds
    found = np.array(space.corners)
    wanted = LOOKED_AT + len(found)
    for _ in range(1000):  # of a ground that is narrow few points hit it
        some = rng.uniform((west, south), (east, north), (4 * LOOKED_AT, 2))
        found = np.vstack([found, some[shapely.contains_xy(space.polygon, some)]])
        if len(found) >= wanted:
            break
    return found[:wanted]
