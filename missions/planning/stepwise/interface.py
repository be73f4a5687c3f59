"""What an explorer is: a rule by which a robot at a vertex moves next.

Flight, replay and simulation call the same rule. An explorer is pure and keeps nothing between
calls: it returns its memory as an immutable value and gets it again at the next call, so a mission
that is resumed from its journal goes on with the same memory.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from missions.errors import StrategyError
from missions.mapping.tree import Tree
from missions.planning.stepwise.metric import Metric
from missions.units import Cell

Memory = object
"""Whatever a strategy wants to see again: immutable, and None at first."""


@dataclass(frozen=True, slots=True)
class Situation:
    """What an explorer decides from."""

    tree: Tree
    """All that is known: its vertices are the known ROI cells; of a vertex that was looked from,
    every neighbour that is not in the tree is not ROI."""
    at: Mapping[int, Cell]
    """For every robot that takes part, the vertex where it is or to which it moves."""
    robots: tuple[int, ...]
    """Those that decide now, ascending; their vertices have been looked from."""
    memory: Memory | None = None
    """What the last decision handed back; None at the first."""
    metric: Metric = field(default_factory=Metric)
    away: frozenset[int] = frozenset()
    """Robots in `at` that are on their way home or on the ground: if they go on, then not soon."""


@dataclass(frozen=True, slots=True)
class Decision:
    """What an explorer says: for each of the robots that decide its next vertex.

    A move is to a neighbour of the vertex that is in the tree (with a `straight` metric: to any
    vertex). None: stay and be asked again when more is known; at the root, when all is explored,
    that is the end.
    """

    moves: Mapping[int, Cell | None]
    memory: Memory | None = None


class Explorer(Protocol):
    """A strategy. All but `decide` is shown to the user."""

    @property
    def name(self) -> str:
        """The name on the command line."""

    @property
    def guarantee(self) -> str:
        """What it promises, in a line."""

    @property
    def source(self) -> str:
        """Where it comes from."""

    @property
    def when(self) -> str:
        """When to use it, in a line."""

    def bound_moves(self, cells: int, depth: int, robots: int) -> float | None:
        """Upper bound on the makespan, in moves of cost 1 on a resting ROI, None without one.

        `cells` is the number of vertices of the final tree, `depth` its depth.
        """

    def decide(self, situation: Situation) -> Decision:
        """Where each of `situation.robots` moves."""


def refuse_impossible(name: str, situation: Situation, decision: Decision) -> None:
    """Raise `StrategyError` for a move of a robot that was not asked, to a cell that is not in the
    tree or where it is, or, unless the metric is `straight`, to one that is no neighbour.

    >>> where = Situation(Tree.rooted(Cell(0, 0)), {1: Cell(0, 0)}, (1,))
    >>> refuse_impossible("mine", where, Decision({1: None}))
    >>> refuse_impossible("mine", where, Decision({1: Cell(0, 1)}))
    Traceback (most recent call last):
    missions.errors.StrategyError: mine: robot 1 moves from (0, 0) to (0, 1), which is not known
    """
    for robot, cell in decision.moves.items():
        if robot not in situation.robots:
            raise StrategyError(f"{name}: robot {robot} is moved, and was not asked")
        if cell is None:
            continue
        start = situation.at[robot]
        way = f"from {_told(start)} to {_told(cell)}"
        if cell not in situation.tree:
            raise StrategyError(f"{name}: robot {robot} moves {way}, which is not known")
        if cell == start:
            raise StrategyError(f"{name}: robot {robot} moves {way}, where it is")
        if not situation.metric.straight and cell not in start.neighbours():
            raise StrategyError(f"{name}: robot {robot} jumps {way}")


def _told(cell: Cell) -> str:
    return f"({cell.east}, {cell.north})"


def promised_moves(explorer: Explorer, tree: Tree, robots: int, metric: Metric) -> float | None:
    """What a strategy promises for a final tree, in moves; None where it promises nothing.

    A theorem may speak of some legs or teams only. A strategy with such a one has a method
    `bound_holds(robots, metric)`; the bound of a strategy without it holds with every metric.
    """
    holds = getattr(explorer, "bound_holds", None)
    if holds is not None and not holds(robots, metric):
        return None
    return explorer.bound_moves(len(tree), tree.depth, robots)


def bound_time(moves: float | None, metric: Metric) -> float | None:
    """A bound in moves as a bound in time, None from None.

    Tours are closed: a move and its way back cost at most 2 Sr / (Sr^2 - Sp^2). A vertex is looked
    from once, when it is first reached, so at most every second move ends with a look.
    """
    if moves is None:
        return None
    return moves * (metric.most_per_length + metric.look / 2.0)
