"""Breadth-First Depth-Next of Cosson, Massoulié and Viennot (DISC 2023).

A robot at the root gets an anchor: a visited vertex with an unvisited child, of least depth, and
among these with the fewest robots. It goes down the tree to its anchor (breadth first). From then
on it enters an unvisited child that no other robot enters, otherwise goes up (depth next). Back at
the root it gets another anchor.

The bound is the paper's Theorem 1: 2 n / k + D^2 (min(ln Delta, ln k) + 3) rounds. It is for a tree
of n vertices, depth D and greatest degree Delta, with k robots and the return. It holds on a ROI
with cycles as well. Robots move along the exploration tree alone, and one observation of a vertex
shows all its children. So the run equals one on the final tree, with n = C, D = depth_T and Delta
<= 4. It assumes rounds: robots of one speed on a resting ROI, all in contact, and no cell that
becomes ROI later.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import cast

from missions.mapping.tree import Tree
from missions.planning.stepwise.interface import Decision, Metric, Situation
from missions.units import Cell

_DEGREE = 4


@dataclass(frozen=True, slots=True)
class Bfdn:
    """Anchors by breadth, depth next.

    >>> tree = Tree.rooted(Cell(0, 0)).with_observation(Cell(0, 0), [Cell(0, 1), Cell(1, 0)])
    >>> Bfdn().decide(Situation(tree, {1: Cell(0, 0), 2: Cell(0, 0)}, (1, 2))).moves
    {1: Cell(east=0, north=1), 2: Cell(east=1, north=0)}
    """

    name: str = "bfdn"
    guarantee: str = "T <= 2 C / R + depth_T^2 (min(ln 4, ln R) + 3) moves"
    source: str = "Cosson, Massoulié and Viennot, Breadth-First Depth-Next, Theorem 1"
    when: str = "a great many cells lie near the start: the best promise where depth_T^2 < C / R"

    def bound_moves(self, cells: int, depth: int, robots: int) -> float | None:
        """Return the bound of Theorem 1."""
        return 2.0 * cells / robots + depth**2 * (min(math.log(_DEGREE), math.log(robots)) + 3.0)

    def bound_holds(self, robots: int, metric: Metric) -> bool:
        """Return True in rounds: no move takes longer than another, or one robot is alone."""
        return robots == 1 or (metric.drift_speed == 0.0 and metric.look == 0.0)

    def decide(self, situation: Situation) -> Decision:
        """Move one robot after the other. The memory is the anchor of each."""
        tree, at = situation.tree, situation.at
        before = cast("Mapping[int, _Anchor]", situation.memory or {})
        anchors = {r: before.get(r, _Anchor(tree.root)) for r in at}
        moves: dict[int, Cell | None] = {}
        for robot in situation.robots:
            here, others = at[robot], {at[r] for r in at if r != robot}
            if here == tree.root:
                anchors[robot] = _Anchor(_anchor(tree, anchors, robot), ahead=True)
            if here == anchors[robot].cell:
                anchors[robot] = _Anchor(here, ahead=False)
                others = set()  # it came for these children: another that heads there may not come
            busy = others.union(cell for cell in moves.values() if cell is not None)
            moves[robot] = _move(tree, busy, here, anchors[robot])
        return Decision(moves, anchors)


@dataclass(frozen=True, slots=True)
class _Anchor:
    cell: Cell
    ahead: bool = False


def _anchor(tree: Tree, anchors: Mapping[int, _Anchor], robot: int) -> Cell:
    """Return the open vertex of least depth with the fewest robots; the root if there is none."""
    load = Counter(anchor.cell for r, anchor in anchors.items() if r != robot)
    opened = {v.parent for v in tree.vertices.values() if not v.observed and v.parent is not None}
    return min(opened, key=lambda c: (tree.vertices[c].depth, load[c], c), default=tree.root)


def _move(tree: Tree, busy: Collection[Cell], cell: Cell, anchor: _Anchor) -> Cell | None:
    """Move down to the anchor, else into a child that is free, else up."""
    if anchor.ahead:
        below = None
        for ancestor in tree.path_up(anchor.cell):
            if ancestor == cell:
                return below
            below = ancestor
    free = (c for c in tree.children(cell) if not tree.is_observed(c) and c not in busy)
    return next(free, tree.parent(cell))
