"""Robots are assigned to the open cells as cheaply as possible, far cells first.

At every decision all robots are assigned to the known unvisited cells by the Hungarian method. A
cell costs the way to it less a share of its return path. Thus far cells are done on the way out,
and the rest lies towards home. If there are more robots than cells a cell is assigned again, a more
expensive one more often.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from missions.lab.strategies.leg_costs import Ways
from missions.mapping.tree import Tree, step_home
from missions.planning.stepwise.interface import Decision, Situation
from missions.units import Cell


def assign(costs: Sequence[Sequence[float]]) -> list[int]:
    """Return a column for every row, each its own, so that the sum of the costs is least.

    Shortest augmenting paths with potentials (Kuhn 1955, Munkres 1957; in this form Jonker and
    Volgenant 1987), O(rows^2 x columns). Raises ValueError for more rows than columns, and for
    costs that are not finite.

    >>> assign([[4.0, 1.0, 3.0], [2.0, 0.0, 5.0], [3.0, 2.0, 2.0]])
    [1, 0, 2]
    """
    rows, columns = len(costs), len(costs[0]) if costs else 0
    if rows > columns or any(len(row) != columns for row in costs):
        raise ValueError(f"{rows} rows need as many columns each at least, not {columns}")
    # row and column 0 are artificial: the path to a free column starts there
    u, v = [0.0] * (rows + 1), [0.0] * (columns + 1)
    row_of = [0] * (columns + 1)
    for row in range(1, rows + 1):
        row_of[0] = row
        _augment(costs, u, v, row_of)
    chosen = [0] * rows
    for column in range(1, columns + 1):
        if row_of[column]:
            chosen[row_of[column] - 1] = column - 1
    return chosen


def _augment(
    costs: Sequence[Sequence[float]], u: list[float], v: list[float], row_of: list[int]
) -> None:
    """Assign one more row, along the shortest path of changes (Dijkstra)."""
    columns = len(v) - 1
    least, before = [math.inf] * (columns + 1), [0] * (columns + 1)
    done = [False] * (columns + 1)
    column = 0
    while row_of[column]:
        done[column] = True
        row, nearest, gap = row_of[column], 0, math.inf
        for j in range(1, columns + 1):
            if done[j]:
                continue
            reduced = costs[row - 1][j - 1] - u[row] - v[j]
            if reduced < least[j]:
                least[j], before[j] = reduced, column
            if least[j] < gap:
                nearest, gap = j, least[j]
        if not nearest:
            raise ValueError("the costs of an assignment must be finite")
        for j in range(columns + 1):
            if done[j]:
                u[row_of[j]] += gap
                v[j] -= gap
            else:
                least[j] -= gap
        column = nearest
    while column:
        row_of[column] = row_of[before[column]]
        column = before[column]


DEPTH_BIAS = 0.6
"""Discount of a cell for each step of its depth."""
CROWDING = 3.0
"""Surcharge of a cell for each robot that goes there already."""


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
        """Return None: no bound is proven."""
        return None

    def decide(self, situation: Situation) -> Decision:
        """Assign all robots; those that decide go."""
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
    """Return the goal of every robot; empty when all cells are visited."""
    depth = ways.steps(tree.root)
    todo = sorted(ways.unvisited, key=lambda cell: -depth[cell])  # of equal costs the far one
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
