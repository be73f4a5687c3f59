"""The ways of exploring that do not stop over cells, and what a user wants to read about them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True, slots=True)
class WithoutStopping:
    """A strategy that is told in seconds and paths, not in moves from cell to cell."""

    name: str
    guarantee: str
    source: str
    when: str


SWATH = WithoutStopping(
    "swath",
    "every ROI cell that hangs together with the first is decided, and its neighbours; in flight T "
    "<= twice the bound of rdfs in seconds, a leg and two minutes",
    "paths planned anew while they are flown: docs/strategies.md",
    "the shape is unknown and time counts",
)
SURVEY = WithoutStopping(
    "survey",
    "every cell of the box is decided where no frame errs; no bound",
    "lanes over the box: docs/strategies.md",
    "a box is known to hold the region; to compare with",
)
NONSTOP: Mapping[str, WithoutStopping] = MappingProxyType(
    {strategy.name: strategy for strategy in (SWATH, SURVEY)}
)
"""By name."""
