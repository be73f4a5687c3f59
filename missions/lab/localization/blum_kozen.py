"""A search of the whole grid with a compass and counters, after Blum and Kozen (section 4.2).

Each obstacle but the border has one cell of its own: the one below its lowest cell, of several the
westernmost. From there a ray leads south to another obstacle, which reaches lower; so obstacles and
rays are a tree with the border as its root, and who keeps the obstacle at the right hand, along the
rays as well, goes around the whole tree. On the way every column of unobstructed cells is walked up
and down from its lower end, so every cell is visited.

Whether a cell is the one of its obstacle is found by going around the obstacle with the distance to
it in two counters. So it remembers O(log n) bits, and pays with O(n^2) moves: columns take at most
2 n of them, boundaries 8/3 n, and each of at most n cells below an obstacle is tried twice, which
takes a way around, at most 8/3 n. With the way south to the first obstacle: 16/3 n^2 + 6 n.
"""

from __future__ import annotations

from collections.abc import Generator

from missions.lab.localization.homing import Moves
from missions.lab.localization.neighbourhood import (
    NORTH,
    SOUTH,
    STEP,
    heading_beside,
    is_beside,
    is_free,
    keep_right,
)

_ABOVE, _BELOW = 2 * NORTH, 2 * SOUTH


def blum_kozen(pattern: int) -> Moves:
    """Move from column to column. It never ends by itself.

    >>> next(blum_kozen(0b00010000)) == SOUTH
    True
    """
    pattern = yield from _straight(pattern, SOUTH)
    heading = heading_beside(pattern, _BELOW)
    while True:
        direction = keep_right(pattern, heading)
        if is_beside(heading, direction, _BELOW):
            pattern = yield from _straight(pattern, NORTH)
            if (yield from _is_own_cell(pattern)):
                # the ray of an obstacle above: around that first
                heading = heading_beside(pattern, _ABOVE)
            else:
                pattern = yield from _straight(pattern, SOUTH)
                heading = heading_beside(pattern, _BELOW)
        elif is_beside(heading, direction, _ABOVE) and (yield from _is_own_cell(pattern)):
            # once around it: down the ray, and on along the obstacle below
            pattern = yield from _straight(pattern, SOUTH)
            heading = heading_beside(pattern, _BELOW)
        direction = keep_right(pattern, heading)
        pattern = yield direction
        heading = direction


def _straight(pattern: int, direction: int) -> Generator[int, int, int]:
    """Go in one direction as far as it is free."""
    while is_free(pattern, direction):
        pattern = yield direction
    return pattern


def _is_own_cell(pattern: int) -> Generator[int, int, bool]:
    """Go around the obstacle above: whether this is the one cell from which its ray begins.

    It is not where the obstacle reaches lower, or as low farther in the west, nor where it is the
    border, which shows itself by being below a cell that is as low as this.
    """
    first = heading = heading_beside(pattern, _ABOVE)
    east = north = 0
    own = True
    while True:
        direction = keep_right(pattern, heading)
        if north < 0 or (
            north == 0
            and (
                (east < 0 and is_beside(heading, direction, _ABOVE))
                or is_beside(heading, direction, _BELOW)
            )
        ):
            own = False
        pattern = yield direction
        heading = direction
        east, north = east + STEP[direction][0], north + STEP[direction][1]
        if (east, north, heading) == (0, 0, first):
            return own
