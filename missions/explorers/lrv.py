"""Least Recently Visited of Batalin and Sukhatme: every node sends robots where fewest went.

Each vertex carries a weight for each direction that leads away from it: how often a robot left that
way. A robot takes the direction of least weight, of equal ones the first in the order north, east,
south, west. The weights lie in the world, beside what the robot passes by: no robot needs a map,
nor knows when the work is done. The mission knows, ends it, and brings everybody home by the
shortest known way.

With ties in a fixed order of the node this is a rotor-router, and a single robot has been
everywhere after 2 |E| D moves, D the diameter of the ROI (Yanovski, Wagner and Bruckstein, A
Distributed Ant Algorithm for Efficiently Patrolling a Network, 2003); on a tree after 2 |E| (here
Theorem 3).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

from missions.explorers.interface import Decision, Situation
from missions.explorers.ways import step_home
from missions.units import Cell


@dataclass(frozen=True, slots=True)
class Lrv:
    """The direction that was taken least often.

    >>> from missions.arena import run
    >>> run(Lrv(), {Cell(0, 0), Cell(0, 1), Cell(1, 0)}, Cell(0, 0), 1).makespan
    4.0
    """

    name: str = "lrv"
    guarantee: str = "one robot: every cell within 2 |E| D moves, on a tree within 2 |E|"
    source: str = "Batalin and Sukhatme, Least Recently Visited, Algorithm 1 and Theorem 3"
    when: str = "robots have no map, and marks lie in the world"
    patience: float = 4.0

    def bound_moves(self, cells: int, depth: int, robots: int) -> float | None:
        """For one robot 2 |E| D and the way home, with |E| <= 2 C and D <= 2 depth_T."""
        return 8.0 * cells * depth + depth if robots == 1 else None

    def decide(self, situation: Situation) -> Decision:
        """One robot after the other. The memory is how often each direction was taken."""
        tree, at = situation.tree, situation.at
        taken = dict(cast("Mapping[tuple[Cell, Cell], int]", situation.memory or {}))
        moves: dict[int, Cell | None] = {}
        for robot in situation.robots:
            here = at[robot]
            ways = [cell for cell in here.neighbours() if cell in tree]
            if tree.is_explored(tree.root) or not ways:
                moves[robot] = step_home(tree, here)
                continue
            there = min(ways, key=lambda cell: taken.get((here, cell), 0))
            taken[here, there] = taken.get((here, there), 0) + 1
            moves[robot] = there
        return Decision(moves, taken)
