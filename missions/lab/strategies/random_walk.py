"""The random walk: to any neighbour, each as likely as the others.

The numbers come from a hash of the seed, the count of decisions and the robot, so that the same
flight takes the same way. Nobody knows when the work is done: the mission ends it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

from missions.mapping.breadth_first import step_home
from missions.planning.stepwise.interface import Decision, Situation
from missions.units import Cell

_MASK = (1 << 64) - 1


def mix(*numbers: int) -> int:
    """64 well mixed bits from some integers: the finaliser of SplitMix64 over their chain.

    >>> mix(1, 2, 3) != mix(3, 2, 1)
    True
    """
    state = 0
    for number in numbers:
        state = (state + number + 0x9E3779B97F4A7C15) & _MASK
        state = ((state ^ (state >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
        state = ((state ^ (state >> 27)) * 0x94D049BB133111EB) & _MASK
        state ^= state >> 31
    return state


@dataclass(frozen=True, slots=True)
class RandomWalk:
    """A random neighbour at every move.

    >>> from missions.mapping.tree import Tree
    >>> tree = Tree.rooted(Cell(0, 0)).looked(Cell(0, 0), [Cell(0, 1)])
    >>> RandomWalk().decide(Situation(tree, {1: Cell(0, 0)}, (1,)))
    Decision(moves={1: Cell(east=0, north=1)}, memory=1)
    """

    name: str = "random-walk"
    guarantee: str = "one robot: every cell within 2 |E| (C - 1) moves in the mean; no bound"
    source: str = "Lovász, Random Walks on Graphs: A Survey, section 2"
    when: str = "you want to see what any plan at all is worth; on a few cells"
    patience: float = 40.0
    seed: int = 0

    def bound_moves(self, cells: int, depth: int, robots: int) -> float | None:
        """None: what is known holds in the mean only."""
        return None

    def decide(self, situation: Situation) -> Decision:
        """Everybody draws for himself. The memory counts the decisions."""
        tree, at = situation.tree, situation.at
        count = cast("int", situation.memory or 0)
        moves: dict[int, Cell | None] = {}
        for robot in situation.robots:
            ways = [cell for cell in at[robot].neighbours() if cell in tree]
            if tree.is_explored(tree.root) or not ways:
                moves[robot] = step_home(tree, at[robot])
            else:
                moves[robot] = ways[mix(self.seed, count, robot) % len(ways)]
        return Decision(moves, count + 1)
