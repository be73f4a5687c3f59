"""The strategies without stops over cells, and their texts for users."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class StrategyInfo:
    """The texts on a strategy whose vehicles do not stop."""

    name: str
    guarantee: str
    source: str
    when: str


SWATH = StrategyInfo(
    "swath",
    "every ROI cell that hangs together with the first is decided, and its neighbours; in flight T "
    "<= twice the bound of rdfs in seconds, a leg and two minutes",
    "paths planned anew while they are flown: docs/explanation/strategies.md",
    "the shape is unknown and time counts",
)
SURVEY = StrategyInfo(
    "survey",
    "every cell of the box is decided where no frame errs; no bound",
    "lanes over the box: docs/explanation/strategies.md",
    "a box is known to hold the region; to compare with",
)
LEAPFROG = StrategyInfo(
    "leapfrog",
    "the mapper never leaves the tracker's picture; every cell of the box is decided where no "
    "frame errs; no bound",
    "one hovers and tracks the other: docs/how-to/navigation.md",
    "satellites are lost over a box, and two vehicles have a marker on top",
)
NONSTOP: Final = {strategy.name: strategy for strategy in (SWATH, SURVEY)}
"""Strategies that simulations without flight know as well, by name."""
ON_PATHS: Final = {**NONSTOP, LEAPFROG.name: LEAPFROG}
"""All strategies that fly paths, by name; with those that register later."""
