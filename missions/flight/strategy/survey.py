"""`survey`: fly all lanes, and decide every cell of the box."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from missions.flight.setting import Setting
from missions.flight.state import State
from missions.flight.strategy.every_patch import Covering
from missions.planning.sweep.strategies import SURVEY
from missions.units import Cell


class Survey(Covering):
    """Decide every cell of the box, wherever the region is."""

    about = SURVEY
    whole_box = True

    def asked_for(self, setting: Setting, state: State) -> list[Cell]:
        """The cells of the box that are not decided."""
        return state.belief.undecided(setting.box_cells)

    def open_cells(self, setting: Setting, state: State) -> frozenset[Cell]:
        """The same: what lies beside a patch beyond the box is not asked for."""
        return frozenset(self.asked_for(setting, state))

    def lane_done(self, setting: Setting, state: State) -> Callable[[Cell], bool]:
        """Whether a cell is decided."""
        verdicts = state.belief.verdicts
        return lambda cell: verdicts.get(cell) is not None


WHOLE_BOX: Final = Survey()
