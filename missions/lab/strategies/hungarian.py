"""Robots are assigned to the open cells as cheaply as possible, far cells first.

At every decision all robots are assigned to the known unvisited cells by the Hungarian method. A
cell costs the way to it less a share of the way home from it: far cells are done on the way out, so
that what is left lies towards home. When there are more robots than cells a cell is given out
again, the dearer the more often.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from missions.lab.strategies.assignment import assign
from missions.lab.strategies.leg_costs import Ways
from missions.mapping.breadth_first import step_home
from missions.mapping.tree import Tree
from missions.planning.stepwise.interface import Decision, Situation
from missions.units import Cell

DEPTH_BIAS = 0.6
"""By how much a cell is cheaper for each step of its depth."""
CROWDING = 3.0
"""By how much a cell is dearer for each robot that goes there already."""


@dataclass(frozen=True, slots=True)
class Hungarian:
    """All robots to all open cells at once, deep cells first.

    >>> from missions.lab.arena.arena_run import run
    >>> run(Hungarian(), {Cell(0, 0), Cell(0, 1), Cell(1, 0)}, Cell(0, 0), 2).makespan
    2.0
    """

    name: str = "hungarian"
    guarantee: str = "complete; no bound"
    source: str = "Kuhn, The Hungarian Method for the Assignment Problem; the costs are our own"
    when: str = "you want short flights of several robots with little to compute"

    def bound_moves(self, cells: int, depth: int, robots: int) -> float | None:
        """None is proven."""
        return None

    def decide(self, situation: Situation) -> Decision:
        """Everybody is assigned, and who decides goes."""
        tree, at = situation.tree, situation.at
        ways = Ways(tree, situation.metric)
        goals = _goals(tree, ways, at)
        return Decision(
            {
                robot: ways.next_stop(at[robot], goals[robot])
                if robot in goals
                else step_home(tree, at[robot])
                for robot in situation.robots
            }
        )


def _goals(tree: Tree, ways: Ways, at: Mapping[int, Cell]) -> dict[int, Cell]:
    """For every robot the cell that it heads for; empty when all cells are visited."""
    depth = ways.steps(tree.root)
    todo = sorted(ways.unvisited, key=lambda cell: -depth[cell])  # of equally dear ones the far
    if not todo:
        return {}
    far = {robot: ways.lengths(cell, todo) for robot, cell in at.items()}
    times = -(-len(at) // len(todo))
    columns = [(cell, taken) for taken in range(times) for cell in todo]
    costs = [
        [far[robot][cell] - DEPTH_BIAS * depth[cell] + CROWDING * taken for cell, taken in columns]
        for robot in at
    ]
    return {robot: columns[column][0] for robot, column in zip(at, assign(costs), strict=True)}
