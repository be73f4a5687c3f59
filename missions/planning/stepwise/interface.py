"""The interface of an explorer: a rule for the next move of a robot at a vertex.

Flight, replay and simulation call the same rule. An explorer is pure and keeps nothing between
calls: it returns its memory as an immutable value and gets it again at the next call. So a mission
that is resumed from its journal continues with the same memory.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from missions.errors import StrategyError
from missions.mapping.tree import Tree
from missions.units import Cell


@dataclass(frozen=True, slots=True)
class Metric:
    """The cost of a leg: the time from the centre of one cell to that of another.

    The cells move with the ROI. A robot of speed Sr relative to the ground flies the displacement d
    in the frame of an ROI which drifts with velocity p. It arrives after the time t at which
    |d + p t| = Sr t. Along the axes these are the costs of Sung and Tokekar, section 4.2:
    1 / (Sr - Sp) with the drift, 1 / (Sr + Sp) against it, 1 / sqrt(Sr^2 - Sp^2) across.

    The solution is a symmetric part plus d . p / (Sr^2 - p^2). The second is linear in d and adds
    up to zero over a closed tour. So a comparison of closed tours needs the symmetric part only.

    Lengths are in cells, so speeds are in cells per unit of time. The default is a resting ROI and
    unit speed: a step to a neighbouring cell costs 1.

    >>> Metric(speed=1.0, drift_east=0.5).leg(Cell(0, 0), Cell(1, 0))
    2.0
    """

    speed: float = 1.0
    drift_east: float = 0.0
    drift_north: float = 0.0
    straight: bool = False
    """True if a move may lead to any known cell, over cells that are not ROI, as in flight.

    Otherwise it may lead only to one of the four neighbours.
    """
    look: float = 0.0
    """Time that a robot hovers over a cell to observe it."""
    ramp: float = 0.0
    """Additional time of a long leg for acceleration and braking; a short one is never at full
    speed.

    It is for planners (`from_rest`): `leg` and `tour_leg` are at full speed, so bounds from them
    hold.
    """
    passable: Callable[[Cell, Cell], bool] | None = None
    """Predicate that the straight way between two cells is allowed; None allows all."""

    def __post_init__(self) -> None:
        if not self.speed > math.hypot(self.drift_east, self.drift_north):
            raise ValueError(
                f"a robot of speed {self.speed:g} cannot keep up with a drift of "
                f"{math.hypot(self.drift_east, self.drift_north):g}"
            )

    @property
    def drift_speed(self) -> float:
        """Sp, in cells per unit of time."""
        return math.hypot(self.drift_east, self.drift_north)

    @property
    def least_per_length(self) -> float:
        """Minimum time per length of a closed tour: across the drift, 1 / sqrt(Sr^2 - Sp^2)."""
        return 1.0 / math.sqrt(self.speed**2 - self.drift_east**2 - self.drift_north**2)

    @property
    def most_per_length(self) -> float:
        """Maximum time per length of a closed tour: along the drift, Sr / (Sr^2 - Sp^2)."""
        return self.speed / (self.speed**2 - self.drift_east**2 - self.drift_north**2)

    def from_rest(self, leg: float) -> float:
        """Return the time of a leg from rest to rest, given its time at full speed."""
        return leg + self.ramp if leg >= self.ramp else 2.0 * math.sqrt(leg * self.ramp)

    def leg(self, start: Cell, end: Cell) -> float:
        """Return the time from the centre of one cell to the centre of another, in a straight
        line."""
        east, north = end.east - start.east, end.north - start.north
        along = east * self.drift_east + north * self.drift_north
        rest = self.speed**2 - self.drift_east**2 - self.drift_north**2
        return (along + math.sqrt(along**2 + rest * (east**2 + north**2))) / rest

    def tour_leg(self, start: Cell, end: Cell) -> float:
        """Return the symmetric part of `leg`: the part of the leg in a closed tour."""
        east, north = end.east - start.east, end.north - start.north
        along = east * self.drift_east + north * self.drift_north
        rest = self.speed**2 - self.drift_east**2 - self.drift_north**2
        return math.sqrt(along**2 + rest * (east**2 + north**2)) / rest


Memory = object
"""The memory of a strategy: immutable, and None at first."""


@dataclass(frozen=True, slots=True)
class Situation:
    """The input of an explorer's decision."""

    tree: Tree
    """All known cells: its vertices are the known ROI cells.

    For an observed vertex, every neighbour that is not in the tree is not ROI.
    """
    at: Mapping[int, Cell]
    """The vertex where each robot is, or to which it moves."""
    robots: tuple[int, ...]
    """Robots that decide now, ascending; their vertices are observed."""
    memory: Memory | None = None
    """Memory of the last decision; None at the first."""
    metric: Metric = field(default_factory=Metric)
    away: frozenset[int] = frozenset()
    """Robots in `at` that return or are on the ground: they may continue, but not soon."""


@dataclass(frozen=True, slots=True)
class Decision:
    """The output of an explorer: the next vertex of each robot that decides.

    A move is to a neighbour of the vertex that is in the tree (with a `straight` metric: to any
    vertex). None: stay and be asked again when more is known; at the root, when all is explored,
    that is the end.
    """

    moves: Mapping[int, Cell | None]
    memory: Memory | None = None


class Explorer(Protocol):
    """A strategy. Users see all but `decide`."""

    @property
    def name(self) -> str:
        """Name on the command line."""

    @property
    def guarantee(self) -> str:
        """Guarantee, in a line."""

    @property
    def source(self) -> str:
        """Source, in a line."""

    @property
    def when(self) -> str:
        """Recommended use, in a line."""

    def bound_moves(self, cells: int, depth: int, robots: int) -> float | None:
        """Return the upper bound of the makespan, in moves of cost 1 on a resting ROI, None without
        one.

        `cells` is the number of vertices of the final tree, `depth` its depth.
        """

    def decide(self, situation: Situation) -> Decision:
        """Return the move of each of `situation.robots`."""


def refuse_impossible(name: str, situation: Situation, decision: Decision) -> None:
    """Raise `StrategyError` for an impossible move.

    Such is a move of a robot that was not asked, or to its own cell, or to a cell outside the tree.
    Unless the metric is `straight`, it is a move to a cell that is no neighbour as well.

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
        way = f"from {_cell_text(start)} to {_cell_text(cell)}"
        if cell not in situation.tree:
            raise StrategyError(f"{name}: robot {robot} moves {way}, which is not known")
        if cell == start:
            raise StrategyError(f"{name}: robot {robot} moves {way}, where it is")
        if not situation.metric.straight and cell not in start.neighbours():
            raise StrategyError(f"{name}: robot {robot} jumps {way}")


def _cell_text(cell: Cell) -> str:
    return f"({cell.east}, {cell.north})"


def promised_moves(explorer: Explorer, tree: Tree, robots: int, metric: Metric) -> float | None:
    """Return the bound of a strategy for a final tree, in moves; None without one.

    A theorem may hold for some legs or teams only. A strategy with such a one has a method
    `bound_holds(robots, metric)`; the bound of a strategy without it holds with every metric.
    """
    holds = getattr(explorer, "bound_holds", None)
    if holds is not None and not holds(robots, metric):
        return None
    return explorer.bound_moves(len(tree), tree.depth, robots)


def bound_time(moves: float | None, metric: Metric) -> float | None:
    """Return a bound in moves as a bound in time, None from None.

    Tours are closed: a move and its way back cost at most 2 Sr / (Sr^2 - Sp^2). A vertex is
    observed once, when it is first reached, so at most every second move ends with an observation.
    """
    if moves is None:
        return None
    return moves * (metric.most_per_length + metric.look / 2.0)
