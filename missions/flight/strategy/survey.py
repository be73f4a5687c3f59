"""`survey`: fly all lanes, and decide every cell of the box."""

from __future__ import annotations

from collections.abc import Callable, Iterator
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

    def asked_for(self, setting: Setting, state: State) -> Iterator[Cell]:
        """The cells of the box that are not decided."""
        verdict = state.belief.verdict
        return (cell for cell in setting.box_cells if verdict(cell) is None)

    def open_cells(self, setting: Setting, state: State) -> frozenset[Cell]:
        """The same: what lies beside a patch beyond the box is not asked for."""
        return frozenset(self.asked_for(setting, state))

    def lane_done(self, setting: Setting, state: State) -> Callable[[Cell], bool]:
        """Whether a cell is decided."""
        verdict = state.belief.verdict
        return lambda cell: verdict(cell) is not None


WHOLE_BOX: Final = Survey()
