"""Algorithm 1 read literally: children in the fixed order north, east, south, west.

A group at a vertex is split into two halves in that order. A robot that comes alone takes the first
unfinished child, wherever the others are. It explores everything, but breaks the paper's own Lemma
1 on most trees. It is here for comparison.
"""

from __future__ import annotations

from dataclasses import dataclass

from missions.mapping.tree import Tree
from missions.planning.stepwise.interface import Decision, Situation
from missions.units import Cell


@dataclass(frozen=True, slots=True)
class RdfsPaper:
    """Algorithm 1 as printed, in a fixed order of the children."""

    name: str = "rdfs-paper"
    guarantee: str = "complete; may exceed the bound of Lemma 1"
    source: str = "Sung and Tokekar, Algorithm 1, children in the order N, E, S, W"
    when: str = "you compare with the paper as printed"

    def bound_moves(self, cells: int, depth: int, robots: int) -> float | None:
        """Return None: it keeps no bound."""
        return None

    def decide(self, situation: Situation) -> Decision:
        """Decide for the robots at one vertex as a group."""
        tree, at, robots = situation.tree, situation.at, situation.robots
        return Decision(
            {
                robot: self._move(tree, [r for r in robots if at[r] == at[robot]], robot, at[robot])
                for robot in robots
            }
        )

    def _move(self, tree: Tree, group: list[int], robot: int, v: Cell) -> Cell | None:
        """Run once through the listing; the numbers are the lines of Algorithm 1."""
        neighbours = [w for w in tree.children(v) if not tree.is_explored(w)]  # 8-13
        if not neighbours:  # 22-23
            return tree.parent(v)
        while len(neighbours) > 1:  # 14-18: halves of the group, a dummy vertex for a third child
            half = (len(group) + 1) // 2
            if robot in group[:half]:
                neighbours, group = neighbours[:1], group[:half]
            else:
                neighbours, group = neighbours[1:], group[half:]
        return neighbours[0]  # 19, 21
