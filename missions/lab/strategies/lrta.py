"""1-LRTA*, as Batalin and Sukhatme print it (Algorithm 3): learning how far the unvisited is.

Each vertex carries a weight, 0 at first. A robot moves to the neighbour of least weight and leaves
behind that weight plus one. Of equal ones it takes the first, in the order north, east, south,
west, to which no other robot moves. A vertex has to know its neighbours' weights, but nobody needs
a map, nor knows when the work is done: the mission ends it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

from missions.mapping.breadth_first import step_home
from missions.planning.stepwise.interface import Decision, Situation
from missions.units import Cell


@dataclass(frozen=True, slots=True)
class Lrta:
    """To the neighbour of least weight.

    >>> from missions.lab.arena.arena_run import run
    >>> run(Lrta(), {Cell(0, 0), Cell(0, 1), Cell(1, 0), Cell(1, 1)}, Cell(0, 0), 1).makespan
    4.0
    """

    name: str = "lrta"
    guarantee: str = "complete; no bound"
    source: str = "Batalin and Sukhatme, Least Recently Visited, Algorithm 3 (1-LRTA*)"
    when: str = "as lrv, where a mark can ask its neighbours' marks"
    patience: float = 4.0

    def bound_moves(self, cells: int, depth: int, robots: int) -> float | None:
        """None is claimed for a ROI that is found on the way."""
        return None

    def decide(self, situation: Situation) -> Decision:
        """One robot after the other. The memory is the weights."""
        tree = situation.tree
        at = dict(situation.at)
        weights = dict(cast("Mapping[Cell, int]", situation.memory or {}))
        moves: dict[int, Cell | None] = {}
        for robot in situation.robots:
            here = at[robot]
            ways = [cell for cell in here.neighbours() if cell in tree]
            if tree.is_explored(tree.root) or not ways:
                moves[robot] = step_home(tree, here)
                continue
            others = {at[r] for r in at if r != robot}
            there = min(ways, key=lambda cell: (weights.get(cell, 0), cell in others))
            weights[here] = weights.get(there, 0) + 1
            at[robot] = moves[robot] = there
        return Decision(moves, weights)
