"""Going home and starting over with Algorithm 1: how a planner without a promise gets one.

Let B(C, D) be the bound of Algorithm 1 for the final tree, in moves or in time; it is linear and
grows with the cells C and the depth D. A planner may go on as long as, after its next moves,

    h + B(c', d) <= 2 B(c, d)                                                       (1)

where h is when the last robot would be home if all turned back after these moves, by shortest known
ways; c and d are the cells and the depth known; and c' counts the vertices of T', the known tree
pruned to the paths from the root to vertices that nobody looked from.

When (1) would fail, all go home, wait for the last, and explore T' by Algorithm 1 as if nobody had
been there; what they find hangs below it. Then the makespan is at most 2 B(C, D):

* The robots stand where (1) allowed them to be, so all are home by h.
* T' is explored by Algorithm 1 from the root and from nothing: with C' vertices and depth D' at its
  end it takes B(C', D') at most. Knowing a branch before it is entered changes nothing, as the rule
  looks only at the children of the vertex where a robot stands.
* A vertex that is found later counts in C and in C' alike: C' <= c' + C - c. What (1) counts with
  is not the depth of T' but d, so B(C', D') - B(c', d) <= B(C, D) - B(c, d).
* So T <= h + B(C', D') <= 2 B(c, d) + B(C, D) - B(c, d) <= 2 B(C, D).

When it never fails, h at the last look is the makespan itself, and (1) says T <= 2 B(C, D). At the
start (1) holds: with one move out and one back h = 2 <= B(c, 1), and c' <= c. The argument takes
rounds of unit moves, shared knowledge, and a team that stays the same.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

from missions.mapping.breadth_first import step_home
from missions.mapping.tree import Tree, Vertex
from missions.planning.stepwise.interface import Situation
from missions.planning.stepwise.rdfs import Rdfs
from missions.units import Cell


@dataclass(frozen=True, slots=True)
class Retreat:
    """The state of a retreat: which vertices are done with, and which were seen anew since."""

    dropped: frozenset[Cell]
    """Vertices outside T'."""
    passed: frozenset[Cell] = frozenset()
    """Vertices of T' where a robot has been since it came home."""
    home: frozenset[int] = frozenset()
    """Robots that have been home."""

    @classmethod
    def of(cls, tree: Tree) -> Retreat:
        """The retreat that begins now.

        >>> tree = Tree.rooted(Cell(0, 0)).looked(Cell(0, 0), [Cell(0, 1), Cell(1, 0)])
        >>> Retreat.of(tree.looked(Cell(0, 1), [])).dropped
        frozenset({Cell(east=0, north=1)})
        """
        return cls(frozenset(cell for cell in tree.vertices if tree.is_explored(cell)))

    def moves(self, situation: Situation) -> tuple[dict[int, Cell | None], Retreat]:
        """Where the robots that decide move, and the state after."""
        tree, at, robots = situation.tree, situation.at, situation.robots
        dropped = _closed(tree, self.dropped)
        arrived = {r for r in robots if at[r] == tree.root}
        home = frozenset(r for r in self.home | arrived if r in at and at[r] not in dropped)
        if tree.is_explored(tree.root):
            return {r: step_home(tree, at[r]) for r in robots}, replace(self, home=home)
        started = bool(self.passed) or set(robots) != set(at) or home >= set(at)
        if not started:  # who is home waits for the last
            homeward: dict[int, Cell | None] = {r: step_home(tree, at[r]) for r in robots}
            return homeward, Retreat(dropped, frozenset(), home)
        exploring = tuple(r for r in robots if r in home)
        passed = self.passed | {at[r] for r in exploring}
        among = {r: cell for r, cell in at.items() if r in home}
        fresh = _anew(tree, dropped, passed)
        moves = dict(
            Rdfs().decide(replace(situation, tree=fresh, at=among, robots=exploring)).moves
        )
        moves.update({r: step_home(tree, at[r]) for r in robots if r not in home})
        return moves, Retreat(dropped, passed, home)


def _closed(tree: Tree, dropped: frozenset[Cell]) -> frozenset[Cell]:
    """Without those above a vertex that is not dropped: a cell that turned out to be ROI late, or
    hangs elsewhere since two trees were joined, brings back its path to the root."""
    back = set()
    for cell in tree.vertices:
        up = None if cell in dropped else tree.parent(cell)
        while up is not None and up in dropped and up not in back:
            back.add(up)
            up = tree.parent(up)
    return dropped - back


def _anew(tree: Tree, dropped: Collection[Cell], passed: Collection[Cell]) -> Tree:
    """T': what is not dropped, looked from only where somebody has been since."""
    return Tree.of(
        tree.root,
        {
            cell: Vertex(vertex.parent, vertex.depth, vertex.looked and cell in passed)
            for cell, vertex in tree.vertices.items()
            if cell not in dropped
        },
    )
