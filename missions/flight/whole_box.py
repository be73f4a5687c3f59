"""What has to be decided where the whole box is seen: by a survey, or to find every patch.

A survey decides each cell of its box. Who looks for every patch of the region flies the same lanes,
whose frames decide nearly all of what they show. What is left then is what no frame has shown, what
some frame took for region, and what lies beside a patch, in the box or beyond it. A cell that every
frame so far took for no region is done with: it is no part of a patch unless one reaches it.
"""

from __future__ import annotations

from collections.abc import Iterator

from missions.flight.setting import Setting
from missions.flight.state import State
from missions.units import Cell


def asked_for(setting: Setting, state: State) -> Iterator[Cell]:
    """The cells that have to be decided and are not, whatever lies beside them."""
    belief = state.belief
    if setting.surveys:
        yield from (cell for cell in setting.box_cells if belief.verdict(cell) is None)
        return
    ballots = belief.open_ballots
    shown = state.shown
    yield from (cell for cell in setting.box_cells if cell not in ballots and cell not in shown)
    for cell, ballot in ballots.items():
        if any(vote for _, vote in ballot) and belief.verdict(cell) is None:
            yield cell


def open_cells(setting: Setting, state: State) -> frozenset[Cell]:
    """All cells that have to be decided and are not, those beside a patch among them."""
    belief = state.belief
    found = set(asked_for(setting, state))
    if setting.finds_all:
        region = (cell for cell in belief.open_ballots if belief.provisional(cell))
        found.update(near for cell in region for near in cell.neighbours())
    return frozenset(cell for cell in found if belief.verdict(cell) is None)
