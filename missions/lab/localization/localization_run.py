"""A robot that does not know where it is, on a grid, without errors; the methods by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np

from missions.lab.localization.grid_map import STEP, GridMap, candidates_after, first_candidates
from missions.lab.localization.homing import Moves, blum_kozen, depth_first, homing, random_walk
from missions.lab.localization.localization_planner import Planner, plan
from missions.units import Cell

Start = Callable[[int, Planner | None, np.random.Generator], Moves]


@dataclass(frozen=True, slots=True)
class Method:
    """A method by which a robot moves until it knows its cell."""

    name: str
    start: Start
    """Function that begins, from the first pattern; the planner is that of the map, if any."""
    bound: Callable[[int], int] | None
    """Function from n to the maximum moves without errors; None if that is a mean only."""
    promise: str
    """The bound in words."""
    needs_map: bool = False


def _planned(pattern: int, planner: Planner | None, rng: np.random.Generator) -> Moves:
    if planner is None:
        raise ValueError("plan needs a map")
    return plan(pattern, planner)


_ALL = (
    Method("homing", lambda pattern, *_: homing(pattern), lambda n: 4 * n, "4 n"),
    Method("depth-first", lambda pattern, *_: depth_first(pattern), lambda n: 2 * n - 2, "2 n - 2"),
    Method(
        "blum-kozen",
        lambda pattern, *_: blum_kozen(pattern),
        lambda n: 16 * n * n // 3 + 6 * n,
        "16/3 n^2 + 6 n",
    ),
    Method("random", lambda pattern, _, rng: random_walk(pattern, rng), None, "O(n^2) in the mean"),
    Method("plan", _planned, lambda n: 4 * n, "4 n", needs_map=True),
)

METHODS: Final[Mapping[str, Method]] = MappingProxyType({m.name: m for m in _ALL})


class Extent:
    """A robot's cell relative to its first one, and the extent of its way.

    >>> been = Extent(width=2, height=1)
    >>> been.place is None
    True
    >>> been.add_move(1)
    >>> been.place
    (0, 0)
    """

    __slots__ = ("_east", "_height", "_high", "_left", "_low", "_north", "_right", "_width")

    def __init__(self, width: int, height: int) -> None:
        self._width, self._height = width, height
        self._east = self._left = self._right = 0
        self._north = self._low = self._high = 0

    def add_move(self, direction: int) -> None:
        """Count a move."""
        east, north = STEP[direction]
        self._east += east
        self._north += north
        self._left, self._right = min(self._left, self._east), max(self._right, self._east)
        self._low, self._high = min(self._low, self._north), max(self._high, self._north)

    @property
    def place(self) -> tuple[int, int] | None:
        """Columns from the west and rows from the south of the grid; None until both are known."""
        if self._right - self._left + 1 < self._width or self._high - self._low + 1 < self._height:
            return None
        return self._east - self._left, self._north - self._low


@dataclass(frozen=True, slots=True)
class Localized:
    """The end of a localization."""

    cell: Cell
    """Cell of the robot."""
    answer: Cell | None
    """Cell that it reports; None if it gave up."""
    moves: int
    confidence: float
    """Its probability, 0 to 1."""

    @property
    def right(self) -> bool:
        """True if the reported cell is the robot's."""
        return self.answer == self.cell


def longest_walk(known: GridMap) -> int:
    """Return moves after which a random walk is given up: 32 times the bound of its mean.

    The bound for a visit of all cells is 2 |E| (n - 1). At most one in 65,000 is not done by then.
    """
    return 64 * known.edges * max(known.size - 1, 1)


def localize(
    known: GridMap,
    start: Cell,
    method: Method,
    rng: np.random.Generator,
    planner: Planner | None = None,
) -> Localized:
    """Put a robot into a cell of a grid, and let it find out which one it is.

    With a `planner`, the map, it ends as soon as one cell fits all that it has sensed. Without, it
    ends when it has seen the width and the height of the grid. Raises KeyError for a start off the
    map.

    >>> from missions.lab.localization.localization_run import METHODS
    >>> row = GridMap.from_cells({Cell(i, 0) for i in range(6)})
    >>> done = localize(row, Cell(2, 0), METHODS["homing"], np.random.default_rng(1))
    >>> done.moves, done.right
    (7, True)
    """
    here = known.index[start]
    patterns, steps = known.patterns, known.steps
    been = Extent(known.width, known.height)
    fitting = first_candidates(known, patterns[here]) if planner is not None else ()
    limit = longest_walk(known) if method.bound is None else method.bound(known.size)
    walk, seen, moves = method.start(patterns[here], planner, rng), None, 0
    while True:
        if len(fitting) == 1:
            return Localized(known.cells[here], known.cells[fitting[0]], moves, 1.0)
        if planner is None and (place := been.place) is not None:
            reported = Cell(known.west + place[0], known.south + place[1])
            return Localized(known.cells[here], reported, moves, 1.0)
        direction = None if moves >= limit else _next(walk, seen)
        if direction is None:
            return Localized(known.cells[here], None, moves, 0.0)
        here = steps[direction][here]
        moves += 1
        been.add_move(direction)
        seen = patterns[here]
        if planner is not None:
            fitting = candidates_after(known, fitting, direction, seen)


def _next(walk: Moves, seen: int | None) -> int | None:
    try:
        return next(walk) if seen is None else walk.send(seen)
    except StopIteration:
        return None
