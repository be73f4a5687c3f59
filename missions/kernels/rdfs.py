"""`rdfs` in the arena, on arrays: millions of moves a second.

The readable pair is `missions.explorers.rdfs` and `missions.arena`; a property test holds the two
equal leg by leg. What is different is the counting: nobody walks up the tree. The robots at or
below a vertex change by one where a robot steps down or up, and a vertex tells its parent once
that it is explored.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from missions.kernels.jit import kernel

Ints = NDArray[np.int32]
Floats = NDArray[np.float64]

_SAME_INSTANT = 1e-9
_ENTERED = 1 << 30
UNKNOWN = -1


@kernel
def _look(near: Ints, parent: Ints, depth: Ints, todo: Ints, looked: Ints, v: int) -> None:
    """A look from v: new children, and whose subtree is explored by it.

    Bit d of `todo[v]` says that the neighbour in direction d is a child and unfinished.
    """
    looked[v] = 1
    for d in range(4):
        w = near[v, d]
        if w >= 0 and parent[w] == UNKNOWN:
            parent[w] = v
            depth[w] = depth[v] + 1
            todo[v] |= 1 << d
    while todo[v] == 0 and parent[v] != v:
        p = parent[v]
        for d in range(4):
            if near[p, d] == v:
                todo[p] ^= 1 << d
        v = p


@kernel
def _rank(looked: Ints, below: Ints, branch: Ints, low: int, high: int) -> int:
    """Smaller is better: nobody has been there yet, then the fewest robots."""
    entered, robots = 0, 0
    for i in range(low, high):
        child = branch[i]
        robots += below[child]
        if looked[child] or below[child]:
            entered = _ENTERED
    return entered + robots


@kernel
def _next(
    near: Ints, parent: Ints, todo: Ints, looked: Ints, below: Ints, branch: Ints, v: int
) -> int:
    """Where a robot at v goes; `branch` is scratch space for four children."""
    if todo[v] == 0:
        return int(parent[v])
    low, high = 0, 0
    for d in range(4):
        if todo[v] >> d & 1:
            branch[high] = near[v, d]
            high += 1
    while high - low > 1:
        middle = high - 2 if high - low > 2 else low + 1
        left = _rank(looked, below, branch, low, middle)
        if left <= _rank(looked, below, branch, middle, high):
            high = middle
        else:
            low = middle
    return int(branch[low])


@kernel
def play(
    near: Ints,
    start: int,
    robots: int,
    cost: Floats,
    look_cost: float,
    parent: Ints,
    depth: Ints,
    legs: Ints,
    times: Floats,
) -> tuple[float, int]:
    """Explore everything that `start` reaches and come home.

    Args:
        near: for every cell its neighbours north, east, south, west, -1 where that is not ROI;
            shape (C, 4). Cells are numbered in ascending order.
        start: the cell where all robots are at first.
        robots: how many.
        cost: what a move north, east, south, west takes.
        look_cost: what a look takes.
        parent: filled with the tree, -1 where no robot came; the start is its own parent.
        depth: filled with the depths.
        legs: filled with robot, start and end of the first moves, as many as fit; shape (n, 3).
        times: filled with their start and end; shape (n, 2).

    Returns:
        The makespan and the number of moves.
    """
    cells = near.shape[0]
    todo = np.zeros(cells, np.int32)
    looked = np.zeros(cells, np.int32)
    below = np.zeros(cells, np.int32)  # robots at or below a vertex; not kept for the root
    branch = np.empty(4, np.int32)
    at = np.full(robots, start, np.int32)
    ready = np.ones(robots, np.bool_)
    end_t = np.full(robots, np.inf)
    fresh = np.empty(robots, np.int32)
    parent[:] = UNKNOWN
    depth[:] = 0
    parent[start] = start
    _look(near, parent, depth, todo, looked, start)
    t, makespan, moves = 0.0, 0.0, 0
    while True:
        for robot in range(robots):
            v = at[robot]
            if not ready[robot] or (v == start and todo[start] == 0):
                continue
            w = _next(near, parent, todo, looked, below, branch, v)
            if w == parent[v]:
                below[v] -= 1
            else:
                below[w] += 1
            d = 0
            while near[v, d] != w:
                d += 1
            leg_t = cost[d]
            if not looked[w]:
                leg_t += look_cost
            at[robot] = w
            ready[robot] = False
            end_t[robot] = t + leg_t
            if moves < legs.shape[0]:
                legs[moves, 0], legs[moves, 1], legs[moves, 2] = robot, v, w
                times[moves, 0], times[moves, 1] = t, end_t[robot]
            moves += 1
            makespan = max(makespan, end_t[robot])
        if ready.all():
            return makespan, moves
        t = end_t.min()
        new = 0
        for robot in range(robots):
            if end_t[robot] > t + _SAME_INSTANT:
                continue
            end_t[robot] = np.inf
            ready[robot] = True
            v = at[robot]
            if looked[v] == 0:  # insert it in the order of depth, then cell
                i = new
                while i > 0 and (depth[fresh[i - 1]], fresh[i - 1]) > (depth[v], v):
                    fresh[i] = fresh[i - 1]
                    i -= 1
                fresh[i] = v
                new += 1
        for i in range(new):
            if looked[fresh[i]] == 0:
                _look(near, parent, depth, todo, looked, fresh[i])
