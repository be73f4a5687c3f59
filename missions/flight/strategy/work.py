"""What strategies are given and answer: lanes over a box, and work that a team shares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from missions.geo.fence import Fence
from missions.geo.grid import Grid
from missions.mission.schema import Mission
from missions.planning.search.lanes import Lane, lanes
from missions.planning.sweep.chart import Bits, Known
from missions.planning.sweep.paths import Flyer, Tour, Waypoints
from missions.units import Cell, GridPoint


class Area(NamedTuple):
    """Where lanes are laid."""

    mission: Mission
    grid: Grid
    box: Sequence[GridPoint]
    """The corners of the search box."""
    fence: Fence
    """Where each vehicle may fly."""
    pads: Sequence[GridPoint]
    """Where the vehicles start."""

    def lanes(self, rows: int, ahead: bool, spare: int = 0) -> Lanes:
        """Lay lanes of so many rows along grid east (`ahead`) or north, `spare` rows left out."""
        laid = lanes(self.box, self.grid.cell_m, self.fence, rows, ahead, spare)
        return Lanes(laid, ahead, rows)


class Lanes(NamedTuple):
    """Lanes over a search box."""

    lanes: tuple[Lane, ...]
    east_ahead: bool
    """Whether they lie along grid east, else along north."""
    rows: int
    """How many rows of cells a lane decides."""


@dataclass(frozen=True, slots=True)
class TourMemory:
    """The last decision on which vehicle is to see what."""

    laid_s: float = float("-inf")
    team: frozenset[int] = frozenset()
    """The vehicles that were planned for."""
    tours: Mapping[int, Tour] = field(default_factory=dict)
    """Of each vehicle, also of those who still fly lanes."""
    others: frozenset[Cell] = frozenset()
    """What those are to see who still fly lanes."""


class OpenWork(NamedTuple):
    """What is left to map, and the vehicles that can map it now."""

    known: Known
    flyers: Mapping[int, Flyer]
    memory: TourMemory
    decision: int
    """Seeds the search for tours."""


class Work(NamedTuple):
    """Which vehicle is to see what is left to map."""

    memory: TourMemory
    waypoints: Waypoints = ()
    """What a plan begins with; none where the last one goes on."""
    others: Bits | None = None
    """The cells that other members of a fleet are to see, closed in the chart; None: none are."""
