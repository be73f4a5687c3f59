"""The rest of the map, and its vehicles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from missions.planning.sweep.chart import Bits, KnownMap
from missions.planning.sweep.paths import Flyer, Tour, Waypoints
from missions.units import Cell


@dataclass(frozen=True, slots=True)
class TourMemory:
    """The last decision on which vehicle is to see what."""

    laid_s: float = float("-inf")
    team: frozenset[int] = frozenset()
    """The vehicles that were planned for."""
    tours: Mapping[int, Tour] = field(default_factory=dict)
    """Of each vehicle, also of those who still fly lanes."""
    others: frozenset[Cell] = frozenset()
    """Cells of the vehicles that still fly lanes."""


class OpenWork(NamedTuple):
    """The rest of the map, and the vehicles that can map it now."""

    known: KnownMap
    flyers: Mapping[int, Flyer]
    memory: TourMemory
    decision: int
    """Seeds the search for tours."""


class Work(NamedTuple):
    """Which vehicle is to see what is left to map."""

    memory: TourMemory
    waypoints: Waypoints = ()
    """Beginning of a plan; empty where the last one continues."""
    others: Bits | None = None
    """The cells that other members of a fleet are to see, closed in the chart; None: none are."""
