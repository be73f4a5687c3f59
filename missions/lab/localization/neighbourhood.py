"""Directions, and what a robot senses of the eight neighbours of its cell.

Directions are numbered to the left, as the paper lists them: 0 north, 1 west, 2 south, 3 east. The
ring of neighbours is numbered the same way round: 0 N, 1 NW, 2 W, 3 SW, 4 S, 5 SE, 6 E, 7 NE; so
the neighbour in direction d is 2 d. A *pattern* is an integer of eight bits, bit i set where
neighbour i is unobstructed.
"""

from __future__ import annotations

from typing import Final

NORTH, WEST, SOUTH, EAST = range(4)
DIRECTIONS: Final = (NORTH, WEST, SOUTH, EAST)
STEP: Final = ((0, 1), (-1, 0), (0, -1), (1, 0))
"""Cells east and north, by direction."""
RING: Final = ((0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0), (1, 1))
"""The same of the eight neighbours."""
FREE: Final = 0xFF
"""The pattern of a cell whose neighbours are all unobstructed."""


def back(direction: int) -> int:
    """The opposite direction."""
    return (direction + 2) % 4


def is_free(pattern: int, direction: int) -> bool:
    """Whether the cell in a direction is unobstructed."""
    return bool(pattern >> 2 * direction & 1)


def keep_right(pattern: int, heading: int) -> int:
    """The next direction of a robot with the obstacle at its right hand.

    It faces right and turns left until it faces an unobstructed cell. Raises `ValueError` where
    there is none.

    >>> keep_right(FREE, NORTH) == EAST
    True
    """
    return _first_free(pattern, heading + 3, 1)


def keep_left(pattern: int, heading: int) -> int:
    """The same with the obstacle at its left hand.

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
    """The heading with which a robot that keeps obstructed neighbour 0 to 7 at its right comes in.

    >>> heading_beside(FREE & ~0b10, 1) == SOUTH  # NW alone: in from the north, out to the west
    True
    """
    for turns in range(1, 9):
        beside = (obstructed - turns) % 8
        if beside % 2 == 0 and pattern >> beside & 1:
            return back(beside // 2)
    raise ValueError("a cell without an unobstructed neighbour has no way in")


def is_beside(heading: int, direction: int, neighbour: int) -> bool:
    """Whether a neighbour lies at the right of a robot that comes in and goes on like this.

    >>> is_beside(SOUTH, WEST, 1), is_beside(SOUTH, WEST, 5)
    (True, False)
    """
    begin = 2 * back(heading)
    span = (2 * direction - begin) % 8 or 8
    return 0 < (neighbour - begin) % 8 < span


def label(pattern: int) -> int:
    """The number of connected components that the obstructed neighbours form, 0 to 4.

    Cells are connected where they share at least a corner, within the square of nine. It is how
    often the cell is entered when all obstacles are circumnavigated (Lemma 2).
    """
    # between two unobstructed edge neighbours lies at most one component
    edges = [i for i in (0, 2, 4, 6) if pattern >> i & 1]
    if not edges:
        return 1
    gaps = zip(edges, [*edges[1:], edges[0] + 8], strict=True)
    return sum(any(not pattern >> i % 8 & 1 for i in range(a + 1, b)) for a, b in gaps)
