"""What strategies are given and answer: lanes over a box."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from missions.geo.fence import Fence
from missions.geo.grid import Grid
from missions.mission.schema import Mission
from missions.planning.search.lanes import Lane, lanes
from missions.units import GridPoint


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
