"""Input and output of strategies: lanes over a box."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from missions.geo.fence import Fence
from missions.geo.grid import Grid
from missions.mission.schema import Mission
from missions.planning.search.lanes import Lane, lanes
from missions.units import GridPoint


class Area(NamedTuple):
    """The area that lanes cover."""

    mission: Mission
    grid: Grid
    box: Sequence[GridPoint]
    """The corners of the search box."""
    fence: Fence
    """The fence of each vehicle."""
    pads: Sequence[GridPoint]
    """Starting places of the vehicles."""

    def lanes(self, rows: int, ahead: bool, spare: int = 0) -> Lanes:
        """Lay lanes of `rows` rows along grid east (`ahead`) or north, `spare` rows left out."""
        laid = lanes(self.box, self.grid.cell_m, self.fence, rows, ahead, spare)
        return Lanes(laid, ahead, rows)


class Lanes(NamedTuple):
    """Lanes over a search box."""

    lanes: tuple[Lane, ...]
    east_ahead: bool
    """True if they lie along grid east, else along north."""
    rows: int
    """Number of rows of cells that a lane decides."""
