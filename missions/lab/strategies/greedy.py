"""Greedy Mapping of Tovey and Koenig: always to the nearest unvisited cell.

One robot moves along a shortest way over known cells to the nearest unvisited one, until there is
none. Several robots each go to the nearest of the cells that the fewest others head for. A robot
goes to a cell of its own while there are any, then to another's. So no robot waits for one that may
never come.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

from missions.lab.strategies.leg_costs import Ways, headed_for
from missions.mapping.tree import step_home
from missions.planning.stepwise.interface import Decision, Metric, Situation
from missions.units import Cell


@dataclass(frozen=True, slots=True)
class Greedy:
    """To the nearest unvisited cell that no other robot heads for, while there is one.

    >>> from missions.lab.arena.arena_run import run
    >>> run(Greedy(), {Cell(0, 0), Cell(0, 1), Cell(1, 0), Cell(1, 1)}, Cell(0, 0), 1).makespan
    4.0
    """

    name: str = "greedy"
    guarantee: str = "one robot, cell by cell: at most 2 C^1.5 + 4 C moves and the return"
    source: str = "Tovey and Koenig, Improved Analysis of Greedy Mapping, Theorem 2"
    when: str = "you want a rule that is easy to follow, and short tours on most regions"

    def bound_moves(self, cells: int, depth: int, robots: int) -> float | None:
        """Return the bound of Theorem 2, with the return; for one robot only."""
        return 2.0 * cells**1.5 + 4.0 * cells + depth if robots == 1 else None

    def bound_holds(self, robots: int, metric: Metric) -> bool:
        """Return True cell by cell only: the theorem counts edges of a graph."""
        return not metric.straight

    def decide(self, situation: Situation) -> Decision:
        """Move one robot after the other. The memory is the goal of each."""
        tree, at = situation.tree, situation.at
        before = cast("Mapping[int, Cell]", situation.memory or {})
        goals = {r: before.get(r, at[r]) for r in at}
        ways = Ways(tree, situation.metric)
        moves: dict[int, Cell | None] = {}
        for robot in situation.robots:
            if not ways.unvisited:
                moves[robot] = step_home(tree, at[robot])
                continue
            nearest = ways.nearest_free(at[robot], headed_for(robot, at, goals))
            if goals[robot] not in nearest:  # of equally near ones keep the one before
                goals[robot] = nearest[0]
            moves[robot] = ways.next_stop(at[robot], goals[robot])
        return Decision(moves, goals)
