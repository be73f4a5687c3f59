"""Least Recently Visited of Batalin and Sukhatme: every node sends robots where fewest went.

Each vertex carries a weight for each of its directions, which counts how often a robot left that
way or came from there (Algorithm 1). A robot takes the direction of least weight, of equal ones the
first in the order north, east, south, west. The weights lie in the world, beside what the robot
passes by: no robot needs a map, nor knows when the work is done. The mission knows, ends it, and
brings everybody home by the shortest known way.

On a tree one robot is done after 2 |E| moves (Theorem 3), which needs the arrivals to be counted:
who enters a vertex tries the other directions before it turns back. Without them
(`Lrv(arrivals=False)`) each vertex lets its directions take turns, a rotor-router; that is what the
published figures for large lattices come from.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

from missions.mapping.breadth_first import step_home
from missions.planning.stepwise.interface import Decision, Situation
from missions.units import Cell


@dataclass(frozen=True, slots=True)
class Lrv:
    """The direction that was taken least often.

    >>> from missions.lab.arena.arena_run import run
    >>> run(Lrv(), {Cell(0, 0), Cell(0, 1), Cell(1, 0)}, Cell(0, 0), 1).makespan
    4.0
    """

    name: str = "lrv"
    guarantee: str = "complete; one robot on a tree: at most 2 |E| moves"
    source: str = "Batalin and Sukhatme, Least Recently Visited, Algorithm 1 and Theorem 3"
    when: str = "robots have no map, and marks lie in the world"
    patience: float = 4.0
    arrivals: bool = True

    def bound_moves(self, cells: int, depth: int, robots: int) -> float | None:
        """None: what is proven holds on trees only."""
        return None

    def decide(self, situation: Situation) -> Decision:
        """One robot after the other. The memory is the weights: (vertex, neighbour), count."""
        tree, at = situation.tree, situation.at
        weights = dict(cast("Mapping[tuple[Cell, Cell], int]", situation.memory or {}))
        moves: dict[int, Cell | None] = {}
        for robot in situation.robots:
            here = at[robot]
            ways = [cell for cell in here.neighbours() if cell in tree]
            if tree.is_explored(tree.root) or not ways:
                moves[robot] = step_home(tree, here)
                continue
            there = min(ways, key=lambda cell: weights.get((here, cell), 0))
            moves[robot] = there
            weights[here, there] = weights.get((here, there), 0) + 1
            if self.arrivals:
                weights[there, here] = weights.get((there, here), 0) + 1
        return Decision(moves, weights)
