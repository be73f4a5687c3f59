"""A map for localization: cells where the robot can be, and what it would sense in each.

Directions are numbered to the left, as the paper lists them: 0 north, 1 west, 2 south, 3 east. The
ring of neighbours is numbered the same way round: 0 N, 1 NW, 2 W, 3 SW, 4 S, 5 SE, 6 E, 7 NE. So
the neighbour in direction d is 2 d. A *pattern* is an integer of eight bits, bit i set where
neighbour i is unobstructed. Last come the grids of the paper's proofs, and random ones.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.errors import LocalizationError
from missions.mapping.tree import neighbours_in, patches, reached
from missions.units import Cell

NORTH, WEST, SOUTH, EAST = range(4)
DIRECTIONS: Final = (NORTH, WEST, SOUTH, EAST)
STEP: Final = ((0, 1), (-1, 0), (0, -1), (1, 0))
"""Cells east and north, by direction."""
RING: Final = ((0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0), (1, 1))
"""Cells east and north of the eight neighbours, in the order of the ring."""
FREE: Final = 0xFF
"""The pattern of a cell whose neighbours are all unobstructed."""


def back(direction: int) -> int:
    """Return the opposite direction."""
    return (direction + 2) % 4


def is_free(pattern: int, direction: int) -> bool:
    """Return whether the cell in a direction is unobstructed."""
    return bool(pattern >> 2 * direction & 1)


def keep_right(pattern: int, heading: int) -> int:
    """Return the next direction of a robot with the obstacle at its right hand.

    It faces right and turns left until it faces an unobstructed cell. Raises `ValueError` where
    there is none.

    >>> keep_right(FREE, NORTH) == EAST
    True
    """
    return _first_free(pattern, heading + 3, 1)


def keep_left(pattern: int, heading: int) -> int:
    """Return the next direction of a robot with the obstacle at its left hand.

    >>> keep_left(FREE, NORTH) == WEST
    True
    """
    return _first_free(pattern, heading + 1, -1)


def _first_free(pattern: int, begin: int, step: int) -> int:
    for direction in range(begin, begin + 4 * step, step):
        if is_free(pattern, direction % 4):
            return direction % 4
    raise ValueError("a cell without an unobstructed neighbour has no way out")


def heading_beside(pattern: int, obstructed: int) -> int:
    """Return the heading with which a robot comes in that keeps neighbour 0 to 7 at its right.

    The neighbour is obstructed.

    >>> heading_beside(FREE & ~0b10, 1) == SOUTH  # NW alone: in from the north, out to the west
    True
    """
    for turns in range(1, 9):
        beside = (obstructed - turns) % 8
        if beside % 2 == 0 and pattern >> beside & 1:
            return back(beside // 2)
    raise ValueError("a cell without an unobstructed neighbour has no way in")


def is_beside(heading: int, direction: int, neighbour: int) -> bool:
    """Return whether a neighbour lies at the right of a robot that enters and leaves in these
    directions.

    >>> is_beside(SOUTH, WEST, 1), is_beside(SOUTH, WEST, 5)
    (True, False)
    """
    begin = 2 * back(heading)
    span = (2 * direction - begin) % 8 or 8
    return 0 < (neighbour - begin) % 8 < span


def label(pattern: int) -> int:
    """Return the number of connected components that the obstructed neighbours form, 0 to 4.

    Cells are connected if they share at least a corner, within the square of nine. The number is
    how often the cell is entered when all obstacles are circumnavigated (Lemma 2).
    """
    # between two unobstructed edge neighbours lies at most one component
    edges = [i for i in (0, 2, 4, 6) if pattern >> i & 1]
    if not edges:
        return 1
    gaps = zip(edges, [*edges[1:], edges[0] + 8], strict=True)
    return sum(any(not pattern >> i % 8 & 1 for i in range(a + 1, b)) for a, b in gaps)


@dataclass(frozen=True, eq=False)
class GridMap:
    """The cells of a grid in ascending order; everything else refers to them by their number.

    >>> pair = GridMap.from_cells({Cell(5, 5), Cell(6, 5)})
    >>> pair.size, pair.width, pair.height, pair.patterns
    (2, 2, 1, (64, 4))
    """

    cells: tuple[Cell, ...]
    patterns: tuple[int, ...]
    """Sensed pattern of each cell (`missions.lab.localization.grid_map`)."""
    steps: tuple[tuple[int, ...], ...]
    """Number of the cell in each direction from each cell, -1 if there is none."""
    own: tuple[bool, ...]
    """True for each cell that is unobstructed itself: False only among `places` beside the grid."""

    @classmethod
    def from_cells(cls, free: Collection[Cell], places: Collection[Cell] | None = None) -> GridMap:
        """Return a map of unobstructed cells; of a region, for an aircraft.

        A robot on the ground can be in these only; `places` are those of an aircraft. Raises
        `LocalizationError` without cells, or if some cannot be reached from the others.
        """
        known = frozenset(free)
        cells = tuple(sorted(known if places is None else frozenset(places)))
        if not cells:
            raise LocalizationError("a map without cells: there is nowhere to be")
        index = {cell: i for i, cell in enumerate(cells)}
        steps = tuple(
            tuple(index.get(Cell(e + STEP[d][0], n + STEP[d][1]), -1) for e, n in cells)
            for d in DIRECTIONS
        )
        patterns = tuple(
            sum(((e + de, n + dn) in known) << i for i, (de, dn) in enumerate(RING))
            for e, n in cells
        )
        lost = index.keys() - reached(neighbours_in(index), cells[0]).keys()
        if lost:
            east, north = min(lost)
            raise LocalizationError(
                f"cell ({east}, {north}) cannot be reached from ({cells[0].east}, "
                f"{cells[0].north}) over edges: a robot could never know which part it is in"
            )
        return cls(cells, patterns, steps, tuple(cell in known for cell in cells))

    @property
    def size(self) -> int:
        """The number of cells, n in the bounds."""
        return len(self.cells)

    @cached_property
    def west(self) -> int:
        """East coordinate of the westernmost cells."""
        return min(cell.east for cell in self.cells)

    @cached_property
    def south(self) -> int:
        """North coordinate of the southernmost cells."""
        return min(cell.north for cell in self.cells)

    @cached_property
    def width(self) -> int:
        """Columns from the westernmost to the easternmost cells."""
        return max(cell.east for cell in self.cells) - self.west + 1

    @cached_property
    def height(self) -> int:
        """Rows from the southernmost to the northernmost cells."""
        return max(cell.north for cell in self.cells) - self.south + 1

    @cached_property
    def index(self) -> dict[Cell, int]:
        """The number of each cell."""
        return {cell: i for i, cell in enumerate(self.cells)}

    @cached_property
    def alike(self) -> dict[int, tuple[int, ...]]:
        """Numbers of the cells in which a pattern is sensed, by pattern."""
        found: dict[int, list[int]] = {}
        for i, pattern in enumerate(self.patterns):
            found.setdefault(pattern, []).append(i)
        return {pattern: tuple(cells) for pattern, cells in found.items()}

    @cached_property
    def pattern_array(self) -> NDArray[np.uint8]:
        """`patterns` as an array."""
        return np.array(self.patterns, np.uint8)

    @cached_property
    def landings(self) -> NDArray[np.intp]:
        """End of a move in each direction: the cell there, or the same cell if there is none."""
        steps = np.array(self.steps, np.intp)
        return np.where(steps >= 0, steps, np.arange(self.size))

    @cached_property
    def edges(self) -> int:
        """Pairs of cells that share an edge."""
        return sum(there >= 0 for way in self.steps[:2] for there in way)

    @cached_property
    def labels(self) -> tuple[int, ...]:
        """Return the numbers of cells with the label 0, 1, 2, 3, 4 (section 6.3)."""
        found = [label(pattern) for pattern in self.patterns]
        return tuple(found.count(i) for i in range(5))

    @property
    def circumnavigation(self) -> int:
        """Moves around all obstacles together, c in Lemma 2."""
        return sum(i * count for i, count in enumerate(self.labels))


Candidates = tuple[int, ...]


def first_candidates(known: GridMap, pattern: int) -> Candidates:
    """Return the possible cells of a robot that senses a pattern.

    >>> from missions.units import Cell
    >>> corridor = GridMap.from_cells({Cell(i, 0) for i in range(5)})
    >>> first_candidates(corridor, corridor.patterns[1])
    (1, 2, 3)
    """
    return known.alike.get(pattern, ())


def candidates_after(
    known: GridMap, candidates: Candidates, direction: int, pattern: int
) -> Candidates:
    """Return the possible cells after a move, with a pattern sensed there.

    >>> from missions.units import Cell
    >>> corridor = GridMap.from_cells({Cell(i, 0) for i in range(5)})
    >>> candidates_after(corridor, (1, 2, 3), 1, corridor.patterns[0])
    (0,)
    """
    step, patterns = known.steps[direction], known.patterns
    return tuple(
        there for here in candidates if (there := step[here]) >= 0 and patterns[there] == pattern
    )


def split(known: GridMap, candidates: Candidates, direction: int) -> list[Candidates]:
    """Return the candidates after a move, in groups that sense the same."""
    step, patterns = known.steps[direction], known.patterns
    groups: dict[int, list[int]] = {}
    for here in candidates:
        there = step[here]
        groups.setdefault(patterns[there], []).append(there)
    return [tuple(group) for group in groups.values()]


def chevrons(k: int, m: int) -> tuple[set[Cell], Cell]:
    """Return G_{k,m} of Figure 6 and the start A of the Homing Robot there: the worst known grid.

    m obstacles of 2 k + 1 cells point west. Rows -(k + 1) to k + 1 are each moved east by their
    distance from the middle. All but the outermost are (free, free, obstructed) m times, then free,
    free.
    """
    width = 3 * m + 2
    cells = {
        Cell(abs(row) + column, row)
        for row in range(-k, k + 1)
        for column in range(width)
        if column % 3 != 2
    }
    for row in (-k - 1, k + 1):
        cells |= {Cell(k + 1 + column, row) for column in range(width - 1)}
    return cells, Cell(width - 1, 0)


def studded(k: int) -> set[Cell]:
    """G_k of Lemma 8: a square of 2 k + 1 with k^2 obstacles of one cell."""
    side = range(2 * k + 1)
    return {Cell(east, north) for east in side for north in side if not east % 2 * (north % 2)}


def corridor(cells: int) -> set[Cell]:
    """Return a row of cells, the worst grid: any deterministic method needs n - 3 moves there.

    Theorem 3 of the paper proves it.
    """
    return {Cell(east, 0) for east in range(cells)}


def cluttered(width: int, height: int, share: float, rng: np.random.Generator) -> set[Cell]:
    """Return the largest part of a room in which a random share of the cells is obstructed."""
    free = rng.random((width, height)) >= share
    left = {Cell(int(e), int(n)) for e, n in np.argwhere(free)} or {Cell(0, 0)}
    return set(patches(left)[0])
