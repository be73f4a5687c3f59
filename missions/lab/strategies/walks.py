"""Walks from neighbour to neighbour by marks or by chance: robots that need no map.

No robot knows when the work is done. The mission does, ends it, and brings all robots home by the
shortest known way.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import cast

from missions.mapping.tree import step_home
from missions.planning.stepwise.interface import Decision, Situation
from missions.units import Cell

_MASK = (1 << 64) - 1

Choice = Callable[[int, list[Cell]], Cell]
"""Chooses the next vertex of a robot among the known neighbours of its own."""


class _Walk:
    """The common part of the walks."""

    __slots__ = ()

    def bound_moves(self, cells: int, depth: int, robots: int) -> float | None:
        """Return None: what is proven of a walk holds on trees only, in the mean, or not here."""
        return None

    def _moves(self, situation: Situation, choose: Choice) -> dict[int, Cell | None]:
        """Move one robot after the other by `choose`, or home once all is explored."""
        tree = situation.tree
        moves: dict[int, Cell | None] = {}
        for robot in situation.robots:
            here = situation.at[robot]
            near = [cell for cell in here.neighbours() if cell in tree]
            done = tree.is_explored(tree.root) or not near
            moves[robot] = step_home(tree, here) if done else choose(robot, near)
        return moves


@dataclass(frozen=True, slots=True)
class Lrv(_Walk):
    """Least Recently Visited of Batalin and Sukhatme: the direction that was used least often.

    Each vertex carries a weight for each direction. It counts how often a robot left in that
    direction or came from it (Algorithm 1). Of equal ones the first counts, in the order north,
    east, south, west.

    On a tree one robot is done after 2 |E| moves (Theorem 3), if arrivals are counted. Then a robot
    that enters a vertex tries the other directions before it turns back. Without arrivals
    (`arrivals=False`) the directions take turns, a rotor-router. The published figures for large
    lattices come from that.

    >>> from missions.lab.arena.arena_run import run
    >>> run(Lrv(), {Cell(0, 0), Cell(0, 1), Cell(1, 0)}, Cell(0, 0), 1).makespan
    4.0
    """

    name: str = "lrv"
    guarantee: str = "complete; one robot on a tree: at most 2 |E| moves"
    source: str = "Batalin and Sukhatme, Least Recently Visited, Algorithm 1 and Theorem 3"
    when: str = "robots have no map, and marks lie in the world"
    patience: float = 4.0
    arrivals: bool = True

    def decide(self, situation: Situation) -> Decision:
        """Move by the weights, which are the memory: (vertex, neighbour), count."""
        weights = dict(cast("Mapping[tuple[Cell, Cell], int]", situation.memory or {}))

        def choose(robot: int, near: list[Cell]) -> Cell:
            here = situation.at[robot]
            there = min(near, key=lambda cell: weights.get((here, cell), 0))
            weights[here, there] = weights.get((here, there), 0) + 1
            if self.arrivals:
                weights[there, here] = weights.get((there, here), 0) + 1
            return there

        return Decision(self._moves(situation, choose), weights)


@dataclass(frozen=True, slots=True)
class Lrta(_Walk):
    """1-LRTA*, as Batalin and Sukhatme print it (Algorithm 3): learns distances to unvisited cells.

    Each vertex carries a weight, 0 at first. A robot moves to the neighbour of least weight and
    leaves behind that weight plus one. Of equal ones it takes the first to which no other robot
    moves, in the order north, east, south, west.

    >>> from missions.lab.arena.arena_run import run
    >>> run(Lrta(), {Cell(0, 0), Cell(0, 1), Cell(1, 0), Cell(1, 1)}, Cell(0, 0), 1).makespan
    4.0
    """

    name: str = "lrta"
    guarantee: str = "complete; no bound"
    source: str = "Batalin and Sukhatme, Least Recently Visited, Algorithm 3 (1-LRTA*)"
    when: str = "as lrv, where a mark can ask its neighbours' marks"
    patience: float = 4.0

    def decide(self, situation: Situation) -> Decision:
        """Move by the weights, which are the memory."""
        at = dict(situation.at)
        weights = dict(cast("Mapping[Cell, int]", situation.memory or {}))

        def choose(robot: int, near: list[Cell]) -> Cell:
            others = {at[r] for r in at if r != robot}
            there = min(near, key=lambda cell: (weights.get(cell, 0), cell in others))
            weights[at[robot]] = weights.get(there, 0) + 1
            at[robot] = there
            return there

        return Decision(self._moves(situation, choose), weights)


@dataclass(frozen=True, slots=True)
class RandomWalk(_Walk):
    """Moves to any neighbour with equal probability.

    The numbers come from a hash of the seed, the count of decisions and the robot, so that the same
    flight takes the same way.

    >>> from missions.mapping.tree import Tree
    >>> tree = Tree.rooted(Cell(0, 0)).with_observation(Cell(0, 0), [Cell(0, 1)])
    >>> RandomWalk().decide(Situation(tree, {1: Cell(0, 0)}, (1,)))
    Decision(moves={1: Cell(east=0, north=1)}, memory=1)
    """

    name: str = "random-walk"
    guarantee: str = "one robot: every cell within 2 |E| (C - 1) moves in the mean; no bound"
    source: str = "Lovász, Random Walks on Graphs: A Survey, section 2"
    when: str = "you want to see what any plan at all is worth; on a few cells"
    patience: float = 40.0
    seed: int = 0

    def decide(self, situation: Situation) -> Decision:
        """Move by chance; the memory counts the decisions."""
        count = cast("int", situation.memory or 0)

        def choose(robot: int, near: list[Cell]) -> Cell:
            return near[mix(self.seed, count, robot) % len(near)]

        return Decision(self._moves(situation, choose), count + 1)


def mix(*numbers: int) -> int:
    """Return 64 well mixed bits from integers: the finaliser of SplitMix64 over their chain."""
    state = 0
    for number in numbers:
        state = (state + number + 0x9E3779B97F4A7C15) & _MASK
        state = ((state ^ (state >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
        state = ((state ^ (state >> 27)) * 0x94D049BB133111EB) & _MASK
        state ^= state >> 31
    return state
