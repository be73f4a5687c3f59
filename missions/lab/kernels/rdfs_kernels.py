"""The figures of `rdfs` in the arena, on arrays: millions of moves a second.

Studies of its bounds need regions of 100,000 cells, whose trees are 40,000 deep. Flights use
`missions.planning.stepwise.rdfs`; a property test holds the two to the same figures. Only the
counting differs, because no robot walks up the tree. A step down or up changes the robots at or
below a vertex by one. A vertex marks itself as explored at its parent, once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from missions.planning.kernels.jit import kernel, part

Ints = NDArray[np.int32]
Longs = NDArray[np.int64]
Floats = NDArray[np.float64]

_SAME_INSTANT = 1e-9
_ENTERED = 1 << 30
UNKNOWN = -1

# A vertex is a row, half a cache line: its neighbours north, east, south, west, and
PARENT = 4  # the vertex above, the start's is itself; -1 if no robot came
DEPTH = 5
_STATE = 6  # _OBSERVED if it was observed, and a bit for each neighbour that is unfinished
_BELOW = 7  # robots at or below it; not kept for the start

_OBSERVED = 16


@part
def _observe(rows: Ints, v: int) -> None:
    """Observe v: add new children, and mark the subtrees that are explored by it."""
    rows[v, _STATE] |= _OBSERVED
    for d in range(4):
        w = rows[v, d]
        if w >= 0 and rows[w, PARENT] == UNKNOWN:
            rows[w, PARENT] = v
            rows[w, DEPTH] = rows[v, DEPTH] + 1
            rows[v, _STATE] |= 1 << d
    while rows[v, _STATE] == _OBSERVED and rows[v, PARENT] != v:
        p = rows[v, PARENT]
        for d in range(4):
            if rows[p, d] == v:
                rows[p, _STATE] ^= 1 << d
        v = p


@part
def _rank(rows: Ints, branch: Ints, low: int, high: int) -> int:
    """Return a rank, best first: not entered yet, then the fewest robots."""
    entered, robots = 0, 0
    for i in range(low, high):
        child = branch[i]
        robots += rows[child, _BELOW]
        if rows[child, _STATE] & _OBSERVED or rows[child, _BELOW]:
            entered = _ENTERED
    return entered + robots


@part
def _next(rows: Ints, away: Longs, branch: Ints, v: int) -> int:
    """Return the next vertex of a robot at v; `branch` is scratch space for four children."""
    low, high = 0, 0
    for d in range(4):
        if rows[v, _STATE] >> d & 1:
            i = high
            while i > 0 and away[branch[i - 1]] < away[rows[v, d]]:
                branch[i] = branch[i - 1]
                i -= 1
            branch[i] = rows[v, d]
            high += 1
    if high == 0:
        return int(rows[v, PARENT])
    while high - low > 1:
        middle = high - 2 if high - low > 2 else low + 1
        left = _rank(rows, branch, low, middle)
        if left <= _rank(rows, branch, middle, high):
            high = middle
        else:
            low = middle
    return int(branch[low])


@part
def _homewards(rows: Ints, steps: Ints, v: int) -> int:
    """Return the next cell on a shortest way to the start; of several the first."""
    best = -1
    for d in range(4):
        w = rows[v, d]
        if w >= 0 and (best < 0 or steps[w] < steps[best]):
            best = w
    return best


@part
def _arrive(
    rows: Ints, away: Longs, at: Ints, end_t: Floats, t: float, arrived: Ints, fresh: Ints
) -> int:
    """Let robots whose leg ends at t observe, by depth, then the outermost first.

    They are put into `arrived`, ascending; return their number.
    """
    count, new = 0, 0
    for robot in range(len(at)):
        if end_t[robot] > t + _SAME_INSTANT:
            continue
        end_t[robot] = np.inf
        arrived[count] = robot
        count += 1
        v = at[robot]
        if rows[v, _STATE] & _OBSERVED:
            continue
        i = new
        while i > 0 and _later(rows, away, fresh[i - 1], v):
            fresh[i] = fresh[i - 1]
            i -= 1
        fresh[i] = v
        new += 1
    for i in range(new):
        if not rows[fresh[i], _STATE] & _OBSERVED:
            _observe(rows, fresh[i])
    return count


@part
def _later(rows: Ints, away: Longs, v: int, w: int) -> bool:
    """Return whether v is observed after w, if robots arrive there together."""
    return (rows[v, DEPTH], -away[v], v) > (rows[w, DEPTH], -away[w], w)


@kernel
def play(
    near: Ints,
    away: Longs,
    start: int,
    robots: int,
    cost: Floats,
    look_cost: float,
    steps: Ints,
) -> tuple[float, int, Ints]:
    """Explore everything that `start` reaches and come home.

    Args:
        near: (C, 4), the neighbours north, east, south, west of cells in ascending order; -1 where
            that is not ROI.
        away: squared straight distance of every cell from the start.
        start: the first cell of all robots.
        robots: their number.
        cost: time of a move north, east, south, west.
        look_cost: time of an observation.
        steps: steps from every cell to the start, for the return path; empty: up the tree.

    Returns:
        The makespan, the number of moves, and the rows of the vertices (C, 8), whose columns
        `PARENT` and `DEPTH` hold the tree.
    """
    rows = np.zeros((near.shape[0], 8), np.int32)
    for v in range(near.shape[0]):
        for d in range(4):
            rows[v, d] = near[v, d]
        rows[v, PARENT] = UNKNOWN
    rows[start, PARENT] = start
    _observe(rows, start)
    branch = np.empty(4, np.int32)
    fresh = np.empty(robots, np.int32)
    arrived = np.arange(robots).astype(np.int32)
    count = robots
    at = np.full(robots, start, np.int32)
    end_t = np.full(robots, np.inf)  # inf: at a vertex
    t, makespan, moves = 0.0, 0.0, 0
    while True:
        for i in range(count):
            robot = arrived[i]
            v = at[robot]
            explored = rows[start, _STATE] == _OBSERVED
            if explored and v == start:
                continue  # for good
            if explored and len(steps) > 0:
                w = _homewards(rows, steps, v)
            else:
                w = _next(rows, away, branch, v)
                if w == rows[v, PARENT]:
                    rows[v, _BELOW] -= 1
                else:
                    rows[w, _BELOW] += 1
            d = 0
            while rows[v, d] != w:
                d += 1
            leg_t = cost[d]
            if not rows[w, _STATE] & _OBSERVED:
                leg_t += look_cost
            at[robot] = w
            end_t[robot] = t + leg_t
            moves += 1
            makespan = max(makespan, end_t[robot])
        t = end_t.min()
        if t == np.inf:
            return makespan, moves, rows
        count = _arrive(rows, away, at, end_t, t, arrived, fresh)
