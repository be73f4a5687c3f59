"""The Depth-first Robot and the Random Robot (sections 4.1 and 5)."""

from __future__ import annotations

import numpy as np

from missions.lab.localization.homing import Moves
from missions.lab.localization.neighbourhood import DIRECTIONS, STEP, back, is_free


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
