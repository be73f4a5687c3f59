"""Algorithm 1 of Sung and Tokekar: multi-robot recursive depth-first search.

The listing does not define which unfinished child a robot takes. Here an unexplored child comes
first, then the child with the fewest robots below it. Two children share a group as equally as
possible, three do so through a dummy vertex. With this rule the bound of Lemma 1, in the form 2 (C
- 1 + depth_T floor(log2 R)) / (1 + floor(log2 R)), holds.

Two more choices do not affect the bound and shorten the mean. The equal child that is farthest from
the root comes first, so a team spreads outwards and the tree stays shallow. Ties are in the order
north, east, south, west. Once all is explored, a robot goes home by a shortest known way, which is
never longer than the one up the tree.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from missions.mapping.tree import Tree, distances
from missions.planning.stepwise.interface import Decision, Situation
from missions.units import Cell


def rdfs_bound_moves(cells: int, depth: int, robots: int) -> float:
    """Return the upper bound on the makespan of Algorithm 1 in moves.

    Lemma 1 of Sung and Tokekar with its equation (5), for unit speed and a resting ROI: 2 (C - 1 +
    depth_T floor(log2 R)) / (1 + floor(log2 R)).
    """
    log_robots = math.floor(math.log2(robots))
    return 2.0 * (cells - 1 + depth * log_robots) / (1 + log_robots)


def drift_factor(speed_m_s: float, drift_speed_m_s: float) -> float:
    """Return the maximum factor by which a drift lengthens a closed tour.

    A move and its way back cost 1 / (Sr - Sp) + 1 / (Sr + Sp) = 2 Sr / (Sr^2 - Sp^2) instead of 2 /
    Sr: the factor is Sr^2 / (Sr^2 - Sp^2).
    """
    return speed_m_s**2 / (speed_m_s**2 - drift_speed_m_s**2)


Branch = tuple[Cell, ...]
"""The children behind one edge of the binary tree: one, or several under a dummy vertex."""


@dataclass(frozen=True, slots=True)
class Rdfs:
    """Algorithm 1 with the child rule that keeps Lemma 1.

    >>> tree = Tree.rooted(Cell(0, 0)).with_observation(Cell(0, 0), [Cell(0, 1), Cell(1, 0)])
    >>> Rdfs().decide(Situation(tree, {1: Cell(0, 0), 2: Cell(0, 0)}, (1, 2))).moves
    {1: Cell(east=0, north=1), 2: Cell(east=1, north=0)}
    """

    name: str = "rdfs"
    guarantee: str = "T <= 2 (C - 1 + depth_T floor(log2 R)) / (1 + floor(log2 R)) moves"
    source: str = "Sung and Tokekar, Algorithm 1, with the child rule that keeps Lemma 1"
    when: str = "you want the tightest promise, or read the flight beside the paper"

    def bound_moves(self, cells: int, depth: int, robots: int) -> float | None:
        """Return Lemma 1."""
        return rdfs_bound_moves(cells, depth, robots)

    def decide(self, situation: Situation) -> Decision:
        """Decide for one robot after the other, each with the moves of those before."""
        if situation.tree.is_explored(situation.tree.root):
            return _homewards(situation)
        after = dict(situation.at)
        chosen: dict[int, Cell | None] = {}
        for robot in situation.robots:
            chosen[robot] = next_vertex = self._move(situation.tree, after, robot)
            after[robot] = next_vertex or after[robot]
        return Decision(chosen)

    def _move(self, tree: Tree, at: Mapping[int, Cell], robot: int) -> Cell | None:
        """Return the move of one pass through the listing; numbers are the lines of Algorithm 1."""
        v = at[robot]
        # 2-6, 8: the neighbours that are ROI are the children of v, without explored ones. 9-13: a
        # cell that would close a cycle never became a child (`Tree.with_observation`)
        neighbours = _outermost_first(
            tree, [w for w in tree.children(v) if not tree.is_explored(w)]
        )
        if not neighbours:  # 3-5, 22-23
            return tree.parent(v)
        robots = _robots_below(tree, at, robot, v)
        branch = neighbours
        while len(branch) > 1:  # 14
            left, right = _binary(branch)  # 15-17: the dummy vertex
            branch = min((left, right), key=lambda b: _rank(tree, robots, b))  # 18
        return branch[0]  # 19, 21; the tree marks v as under exploration by itself


def _homewards(situation: Situation) -> Decision:
    """Return moves home by shortest ways when all is explored; the ways are remembered."""
    tree, memory = situation.tree, situation.memory
    if isinstance(memory, _PathsToRoot) and memory.cells == len(tree):
        ways = memory
    else:
        ways = _PathsToRoot(len(tree), distances(tree, tree.root))
    moves: dict[int, Cell | None] = {}
    for robot in situation.robots:
        v = situation.at[robot]
        near = [w for w in v.neighbours() if w in ways.steps]
        moves[robot] = None if v == tree.root else min(near, key=ways.steps.__getitem__)
    return Decision(moves, ways)


@dataclass(frozen=True, slots=True)
class _PathsToRoot:
    """Steps to the root from every cell of a tree with `cells` cells."""

    cells: int
    steps: Mapping[Cell, int]


def _outermost_first(tree: Tree, children: Sequence[Cell]) -> Branch:
    """Return children by distance from the root, the farthest first; stable."""
    east, north = tree.root
    return tuple(sorted(children, key=lambda w: -((w.east - east) ** 2 + (w.north - north) ** 2)))


def _binary(branch: Branch) -> tuple[Branch, Branch]:
    """Return two branches of a binary tree, with a dummy vertex of edge length 0 above a pair."""
    return (branch[:-2], branch[-2:]) if len(branch) > 2 else (branch[:1], branch[1:])


def _rank(tree: Tree, robots: Mapping[Cell, int], branch: Branch) -> tuple[bool, int]:
    """Return a rank, best first: no robot has been there yet, then the fewest robots.

    A dummy vertex has been entered as soon as one of its children has.
    """
    entered = any(tree.is_observed(child) or robots.get(child, 0) for child in branch)
    return (entered, sum(robots.get(child, 0) for child in branch))


def _robots_below(tree: Tree, at: Mapping[int, Cell], robot: int, v: Cell) -> Mapping[Cell, int]:
    """Return for every child of v the robots at or below it."""
    depth = tree.vertices[v].depth
    counts: dict[Cell, int] = {}
    for other, where in at.items():
        if other == robot:
            continue
        child: Cell | None = None
        for cell in tree.path_up(where):
            if tree.vertices[cell].depth <= depth:
                if cell == v and child is not None:
                    counts[child] = counts.get(child, 0) + 1
                break
            child = cell
    return counts
