"""The state of each cell on a map, by the events of a flight or a replay."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from missions.events import Event, FrameSeen, FrameWeighed
from missions.fleet_events import FactsShared
from missions.flight.state import Setting, State
from missions.mapping.evidence import Evidence
from missions.mapping.frame_sums import FrameSums
from missions.units import Cell
from uavmap.output.facts.map_model import State as CellState


class CellStates:
    """The cells of a map, event by event.

    Args:
        setting: The mission.
        recorded: True for recorded pictures: every cell of the region is explored.
        weighed: True if evidence decides instead of counts; only for recorded pictures.
    """

    def __init__(self, setting: Setting, *, recorded: bool, weighed: bool = False) -> None:
        self._share = setting.mission.detector.share
        self._explored = setting.mission.detector.explored
        self._recorded = recorded
        self._evidence = Evidence() if weighed else None
        self._frame: FrameSeen | None = None
        self.sums = FrameSums()

    def note(self, event: Event) -> Sequence[Cell]:
        """Note an event; return the cells that it judges."""
        if isinstance(event, FrameSeen):
            self._frame = event
            self.sums.note(event)
            return [] if self._evidence is not None else [vote.cell for vote in event.votes]
        if isinstance(event, FactsShared):
            self.sums.note(event)
            return [cell for fact in event.frames if not fact.seen for cell, _ in fact.votes]
        if (
            isinstance(event, FrameWeighed)
            and self._evidence is not None
            and self._frame is not None
        ):
            self._evidence.add(self._frame.votes, event.weights)
            return [vote.cell for vote in self._frame.votes]
        return []

    def weighed_cells(self) -> Collection[Cell]:
        """Return all cells with evidence: each belief depends on the whole set."""
        return [] if self._evidence is None else self._evidence.cells()

    def classes_of(self, cells: Sequence[Cell]) -> dict[Cell, int]:
        """Return the number of the class of each of some cells; 0: no class."""
        if not self._explored or not cells:
            return {}
        found = self.sums.classes(np.array(cells, np.int32), self._explored)
        return dict(zip(cells, found.tolist(), strict=True))

    def state_of(self, cell: Cell, state: State) -> CellState:
        """Return the state of a cell; `state` is the state of the mission."""
        if self._evidence is None:
            return cell_state(cell, state, self.sums, recorded=self._recorded)
        if self._evidence.is_roi(cell, self._share):
            return "explored"
        return "unsure" if self.sums.is_unsure(cell) else "non-roi"


def cell_state(cell: Cell, state: State, sums: FrameSums, *, recorded: bool = False) -> CellState:
    """Return the state of a cell that counts of votes decide."""
    if cell not in state.belief.roi:
        if sums.is_unsure(cell):
            return "unsure"
        votes = state.belief.tally(cell, None)
        if recorded or not votes.total or state.belief.verdict(cell) is not None:
            return "non-roi"
        return "provisional" if state.belief.provisional(cell) else "provisional non-roi"
    if recorded:
        return "explored"
    if cell in state.skipped:
        return "skipped"
    if state.tree is None or cell not in state.tree:  # a survey, another patch, or the rim
        known = all(state.belief.verdict(near) is not None for near in cell.neighbours())
        return "explored" if known else "unexplored"
    return state.tree.state(cell).value
