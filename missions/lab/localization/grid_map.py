"""A map for localization: cells where the robot can be, and what it would sense in each."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from missions.errors import LocalizationError
from missions.lab.localization.neighbourhood import DIRECTIONS, RING, STEP, label
from missions.mapping.breadth_first import neighbours_in, reached
from missions.units import Cell


@dataclass(frozen=True, eq=False)
class GridMap:
    """The cells of a grid in ascending order; everything else refers to them by their number.

    >>> pair = GridMap.of({Cell(5, 5), Cell(6, 5)})
    >>> pair.size, pair.width, pair.height, pair.patterns
    (2, 2, 1, (64, 4))
    """

    cells: tuple[Cell, ...]
    patterns: tuple[int, ...]
    """What is sensed in each cell (`missions.lab.localization.neighbourhood`)."""
    steps: tuple[tuple[int, ...], ...]
    """By direction: the number of the cell there for each cell, -1 where there is none."""
    own: tuple[bool, ...]
    """Whether each cell is unobstructed itself: False only among `places` beside the grid."""

    @classmethod
    def of(cls, free: Collection[Cell], places: Collection[Cell] | None = None) -> GridMap:
        """A map of unobstructed cells; of a region, for an aircraft.

        A robot on the ground can be in these only; `places` are those of an aircraft. Raises
        `LocalizationError` without cells, or where some cannot be reached from the others.
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
        """The numbers of the cells in which a pattern is sensed, by pattern."""
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
        """By direction, where a move ends: in the cell there, or, where there is none, where it
        began."""
        steps = np.array(self.steps, np.intp)
        return np.where(steps >= 0, steps, np.arange(self.size))

    @cached_property
    def edges(self) -> int:
        """Pairs of cells that share an edge."""
        return sum(there >= 0 for way in self.steps[:2] for there in way)

    @cached_property
    def labels(self) -> tuple[int, ...]:
        """How many cells have the label 0, 1, 2, 3, 4 (section 6.3)."""
        found = [label(pattern) for pattern in self.patterns]
        return tuple(found.count(i) for i in range(5))

    @property
    def circumnavigation(self) -> int:
        """Moves around all obstacles together, c in Lemma 2."""
        return sum(i * count for i, count in enumerate(self.labels))


Candidates = tuple[int, ...]


def first_candidates(known: GridMap, pattern: int) -> Candidates:
    """Where a robot may be that senses a pattern.

    >>> from missions.units import Cell
    >>> corridor = GridMap.of({Cell(i, 0) for i in range(5)})
    >>> first_candidates(corridor, corridor.patterns[1])
    (1, 2, 3)
    """
    return known.alike.get(pattern, ())


def candidates_after(
    known: GridMap, candidates: Candidates, direction: int, pattern: int
) -> Candidates:
    """Where it may be after a move, and sensing a pattern there.

    >>> from missions.units import Cell
    >>> corridor = GridMap.of({Cell(i, 0) for i in range(5)})
    >>> candidates_after(corridor, (1, 2, 3), 1, corridor.patterns[0])
    (0,)
    """
    step, patterns = known.steps[direction], known.patterns
    return tuple(
        there for here in candidates if (there := step[here]) >= 0 and patterns[there] == pattern
    )


def split(known: GridMap, candidates: Candidates, direction: int) -> list[Candidates]:
    """What a move makes of candidates: the groups in which the same is sensed afterwards."""
    step, patterns = known.steps[direction], known.patterns
    groups: dict[int, list[int]] = {}
    for here in candidates:
        there = step[here]
        groups.setdefault(patterns[there], []).append(there)
    return [tuple(group) for group in groups.values()]
