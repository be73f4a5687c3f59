"""The Homing Robot of Wongngamnit and Angluin (section 6): around obstacles, westwards.

It goes west until it meets an obstacle, and goes around it once with the obstacle at its right. It
returns to a westernmost cell of the boundary by the shorter way, and goes west again. The last
obstacle is
the border of the grid, whose circumnavigation shows the extent of the grid in both directions. It
remembers some counters and no places: O(log n) bits. It makes at most 4 n moves.

A search of the whole grid with a compass and counters, after Blum and Kozen (section 4.2).

Each obstacle but the border has one cell of its own: the one below its lowest cell, of several the
westernmost. From there a ray leads south to another obstacle, which reaches lower. So obstacles and
rays are a tree with the border as its root. A robot that keeps the obstacle at the right hand,
along the rays as well, goes around the whole tree. On the way it walks every column of unobstructed
cells up and down from its lower end, so it visits every cell.

A trip around the obstacle, with the distance in two counters, shows whether a cell is the
obstacle's own. So it remembers O(log n) bits, and pays with O(n^2) moves. Columns take at most 2 n
of them, boundaries 8/3 n. Each of at most n cells below an obstacle is tried twice, which takes a
way around, at most 8/3 n. With the way south to the first obstacle: 16/3 n^2 + 6 n.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Final

import numpy as np

from missions.lab.localization.grid_map import (
    DIRECTIONS,
    NORTH,
    SOUTH,
    STEP,
    WEST,
    back,
    heading_beside,
    is_beside,
    is_free,
    keep_left,
    keep_right,
)

Moves = Generator[int, int, None]
"""A method under way: it yields the direction of its next move, and is sent the pattern of the cell
where the move ended.
"""

AHEAD: Final = (2, 1, 3, 0, 4)
"""The neighbours that are at least as far west as the cell itself: W, NW, SW, N, S."""


def homing(pattern: int) -> Moves:
    """Move as the Homing Robot does. It never ends by itself."""
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
    """Go to an unvisited neighbour, in the order N, W, S, E, or back if there is none.

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
    """Go to any unobstructed neighbour with equal probability. It never ends by itself."""
    while True:
        ways = [d for d in DIRECTIONS if is_free(pattern, d)]
        pattern = yield ways[int(rng.integers(len(ways)))]


_ABOVE, _BELOW = 2 * NORTH, 2 * SOUTH


def blum_kozen(pattern: int) -> Moves:
    """Move from column to column. It never ends by itself."""
    pattern = yield from _straight(pattern, SOUTH)
    heading = heading_beside(pattern, _BELOW)
    while True:
        direction = keep_right(pattern, heading)
        if is_beside(heading, direction, _BELOW):
            pattern = yield from _straight(pattern, NORTH)
            if (yield from _is_own_cell(pattern)):
                # the ray of an obstacle above: around that obstacle first
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
    while is_free(pattern, direction):
        pattern = yield direction
    return pattern


def _is_own_cell(pattern: int) -> Generator[int, int, bool]:
    """Go around the obstacle above; return True for the one cell from which its ray begins.

    It is another cell if the obstacle reaches lower, or as low farther in the west. It also is if
    the obstacle is the border, which is below a cell as low as this.
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
