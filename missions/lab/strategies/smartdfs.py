"""SmartDFS of Icking, Kamphans, Klein and Langetepe: along the wall, layer by layer.

A robot keeps its left hand at visited cells or at the outside: at every new cell it tries left,
ahead, right. From a dead end it goes by the shortest visited way to the last cell that has an
unvisited neighbour left. If a cell splits the unvisited ones into parts, the part towards the start
comes last, so that no robot goes there twice.

One robot on a ROI without holes, from its rim, makes at most C + E / 2 - 3 moves. E is the number
of edges between ROI and other cells, so it never makes more than 2 C - 2. With holes the visits
still are in the order of a depth-first search and ways are shortest ones. So 2 C - 2 holds there as
well. The paper finds the last part of a split by the numbers of the layers around it. Here it is
the part with the shortest return path, which is the same side without the bookkeeping. It was never
seen to exceed the paper's bound.

Several robots each follow the rule, and leave out the cells that others head for. A robot without a
cell goes to the nearest unvisited cell with the fewest robots and begins anew there. There is no
bound for that.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import cast

from missions.lab.strategies.leg_costs import Ways, headed_for
from missions.mapping.tree import Tree, step_home, step_towards
from missions.planning.stepwise.interface import Decision, Situation
from missions.units import Cell


@dataclass(frozen=True, slots=True)
class SmartDfs:
    """Left hand at the wall, short ways back, the part towards the start last.

    >>> from missions.lab.arena.arena_run import run
    >>> block = {Cell(east, north) for east in range(4) for north in range(4)}
    >>> run(SmartDfs(), block, Cell(0, 0), 1).makespan
    18.0
    """

    name: str = "smartdfs"
    guarantee: str = "one robot: at most 2 C - 2 moves; without holes C + E / 2 - 3"
    source: str = "Icking, Kamphans, Klein and Langetepe, Exploring Grid Polygons Online"
    when: str = "one vehicle maps a compact region and should fly long straight lines"

    def bound_moves(self, cells: int, depth: int, robots: int) -> float | None:
        """Return 2 C - 2 for one robot."""
        return 2.0 * (cells - 1) if robots == 1 else None

    def decide(self, situation: Situation) -> Decision:
        """Move one robot after the other."""
        tree, at = situation.tree, situation.at
        before = cast("_Memory", situation.memory or _Memory())
        trails = {r: before.trails.get(r, ()) for r in at}
        goals = {r: before.goals.get(r, at[r]) for r in at}
        ways = Ways(tree, situation.metric)
        moves: dict[int, Cell | None] = {}
        for robot in situation.robots:
            here = at[robot]
            if here == goals[robot]:
                trails[robot] += (_fork(tree, ways, trails[robot], here),)
            others = headed_for(robot, at, goals)
            trails[robot] = trail = _unfinished(tree, others, trails[robot])
            if trail:
                order = trail[-1].order
                goals[robot] = next(cell for cell in order if _left(tree, others, cell))
                moves[robot] = _towards(tree, here, trail[-1].cell, goals[robot])
            elif ways.unvisited:
                goals[robot] = ways.nearest_free(here, others)[0]
                moves[robot] = step_towards(tree, here, goals[robot])
            else:
                moves[robot] = step_home(tree, here)
        return Decision(moves, _Memory(trails, goals))


@dataclass(frozen=True, slots=True)
class _Fork:
    """A cell that a robot came to explore, and the order in which it tries the neighbours."""

    cell: Cell
    order: tuple[Cell, ...]


@dataclass(frozen=True, slots=True)
class _Memory:
    trails: Mapping[int, tuple[_Fork, ...]] = field(default_factory=dict)
    goals: Mapping[int, Cell] = field(default_factory=dict)


def _fork(tree: Tree, ways: Ways, trail: tuple[_Fork, ...], here: Cell) -> _Fork:
    """Return left, ahead, right of the robot's course; after a split the last part comes last."""
    around = here.neighbours()
    if trail and trail[-1].cell in around:
        back = around.index(trail[-1].cell)
    else:  # a new beginning: with the back to a cell that is not ROI
        back = next((i for i, cell in enumerate(around) if cell not in tree), 2)
    turned = [around[(back + quarter) % 4] for quarter in (1, 2, 3, 4)]
    todo = [cell for cell in turned if cell in tree and not tree.is_observed(cell)]
    if len(todo) > 1:
        parts = {cell: _part(tree, cell) for cell in todo}
        if len(set(parts.values())) > 1:
            home = ways.steps(tree.root)
            todo.sort(key=lambda cell: -_return_steps(tree, home, parts[cell], here))
    return _Fork(here, tuple(todo))


def _return_steps(tree: Tree, home: Mapping[Cell, int], part: Collection[Cell], here: Cell) -> int:
    """Return steps to the root from the nearest visited cell beside a part, but for the split."""
    beside = {n for cell in part for n in cell.neighbours() if n in tree and n != here}
    return min((home[n] for n in beside if tree.is_observed(n)), default=home[here])


def _part(tree: Tree, start: Cell) -> frozenset[Cell]:
    """Return the known unvisited cells that may be connected with one, over sides or corners."""
    part, todo = {start}, [start]
    while todo:
        e, n = todo.pop()
        for de, dn in ((0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, -1), (-1, 1)):
            cell = Cell(e + de, n + dn)
            if cell in part or cell not in tree or tree.is_observed(cell):
                continue
            if de and dn and _shut(tree, Cell(e + de, n)) and _shut(tree, Cell(e, n + dn)):
                continue
            part.add(cell)
            todo.append(cell)
    return frozenset(part)


def _shut(tree: Tree, cell: Cell) -> bool:
    """Return True if no way leads over a cell to an unvisited one: visited, or not ROI."""
    if cell in tree:
        return tree.is_observed(cell)
    return any(n in tree and tree.is_observed(n) for n in cell.neighbours())


def _unfinished(
    tree: Tree, others: Mapping[Cell, int], trail: tuple[_Fork, ...]
) -> tuple[_Fork, ...]:
    """Return the trail up to the last fork with a neighbour that is left to this robot."""
    while trail and not any(_left(tree, others, cell) for cell in trail[-1].order):
        trail = trail[:-1]
    return trail


def _left(tree: Tree, others: Mapping[Cell, int], cell: Cell) -> bool:
    """Return True if a cell is unvisited and no other robot heads for it."""
    return not tree.is_observed(cell) and not others.get(cell)


def _towards(tree: Tree, here: Cell, fork: Cell, goal: Cell) -> Cell:
    """Return the next cell on the shortest visited way to a fork, and from there to the goal."""
    if here == fork:
        return goal
    return step_towards({c for c, v in tree.vertices.items() if v.observed}, here, fork)
