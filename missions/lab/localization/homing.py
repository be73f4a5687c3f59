"""The Homing Robot of Wongngamnit and Angluin (section 6): around obstacles, westwards.

It goes west until it meets an obstacle, goes around it once with the obstacle at its right, returns
to a westernmost cell of its boundary by the shorter way, and goes west again. The last obstacle is
the border of the grid, whose circumnavigation shows the extent of the grid in both directions.
It remembers some counters, and nothing of where it was: O(log n) bits. At most 4 n moves.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Final

import numpy as np

from missions.lab.localization.neighbourhood import (
    DIRECTIONS,
    STEP,
    WEST,
    back,
    heading_beside,
    is_free,
    keep_left,
    keep_right,
)

Moves = Generator[int, int, None]
"""A method under way: it yields the direction of its next move, and is sent the pattern of the cell
where that has led."""

AHEAD: Final = (2, 1, 3, 0, 4)
"""The neighbours that are at least as far west as the cell itself: W, NW, SW, N, S."""


def homing(pattern: int) -> Moves:
    """Move as the Homing Robot does. It never ends by itself.

    >>> corridor = homing(0b01000000)  # only the cell in the east is free
    >>> next(corridor)
    3
    """
    while True:
        hit = next((i for i in AHEAD if not pattern >> i & 1), None)
        if hit is None:
            pattern = yield WEST
        else:
            pattern = yield from _go_around(pattern, hit)


def _go_around(pattern: int, hit: int) -> Generator[int, int, int]:
    """Circumnavigate the obstacle with this neighbour, and stop at its westernmost boundary."""
    east = north = 0  # from the hit cell
    first = heading = heading_beside(pattern, hit)
    steps = westernmost = since = 0
    while True:
        direction = keep_right(pattern, heading)
        there = (east + STEP[direction][0], north + STEP[direction][1])
        if there == (0, 0) and direction == first:
            break
        pattern = yield direction
        (east, north), heading = there, direction
        steps += 1
        since += 1
        if east <= westernmost:
            westernmost, since = east, 0
    turn = keep_right
    if 2 * since < steps:
        turn, heading = keep_left, back(direction)
    while east != westernmost:
        heading = turn(pattern, heading)
        pattern = yield heading
        east += STEP[heading][0]
    return pattern


def depth_first(pattern: int) -> Moves:
    """Go to a neighbour that was not visited, in the order N, W, S, E, or back where there is none.

    It remembers every cell that it has visited. It ends where it began, after 2 n - 2 moves.

    >>> list(depth_first(0))
    []
    """
    here, visited, trail = (0, 0), {(0, 0)}, []
    while True:
        for d in DIRECTIONS:
            there = (here[0] + STEP[d][0], here[1] + STEP[d][1])
            if is_free(pattern, d) and there not in visited:
                visited.add(there)
                trail.append(d)
                break
        else:
            if not trail:
                return
            d = back(trail.pop())
            there = (here[0] + STEP[d][0], here[1] + STEP[d][1])
        pattern = yield d
        here = there


def random_walk(pattern: int, rng: np.random.Generator) -> Moves:
    """Go to any unobstructed neighbour, each as likely as the others. It never ends by itself.

    >>> next(random_walk(0b100, np.random.default_rng(1)))
    1
    """
    while True:
        ways = [d for d in DIRECTIONS if is_free(pattern, d)]
        pattern = yield ways[int(rng.integers(len(ways)))]
