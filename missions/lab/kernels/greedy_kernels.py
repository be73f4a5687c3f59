"""Greedy Mapping on any graph: always to the nearest vertex that was not visited.

After C. Tovey and S. Koenig, *Improved Analysis of Greedy Mapping*. A robot at a vertex learns its
neighbours and goes, over known vertices, to a nearest unvisited one. The first unvisited vertex on
a shortest way is the nearest, so all ways lead over visited vertices, and unknown ones never
matter. A breadth-first search that ends at the first unvisited vertex is enough.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from missions.planning.kernels.jit import kernel, part

Ints = NDArray[np.int32]
Ranks = NDArray[np.int8]

VISITS = 1_000_000


@kernel
def adjacency(vertices: int, ends: Ints) -> tuple[Ints, Ints]:
    """Return (first, beside) of `ends` (E, 2): v's neighbours are `beside[first[v]:first[v +
    1]]`."""
    first = np.zeros(vertices + 1, np.int32)
    for e in range(ends.shape[0]):
        first[ends[e, 0] + 1] += 1
        first[ends[e, 1] + 1] += 1
    for v in range(vertices):
        first[v + 1] += first[v]
    free = first.copy()
    beside = np.empty(2 * ends.shape[0], np.int32)
    for e in range(ends.shape[0]):
        for side in range(2):
            v = ends[e, side]
            beside[free[v]] = ends[e, 1 - side]
            free[v] += 1
    return first, beside


@part
def nearest_unvisited(
    first: Ints, beside: Ints, rank: Ranks, visited: Ranks, seen: Ints, queue: Ints, start: int
) -> tuple[int, int]:
    """Return a nearest unvisited vertex of the lowest rank, and its distance.

    `seen` holds the start of the last search that came by; `queue` is scratch space.
    """
    queue[0] = start
    seen[start] = start
    low, high, steps = 0, 1, 0
    best, best_rank = -1, 127
    while best < 0 and low < high:
        steps += 1
        for i in range(low, high):
            v = queue[i]
            for j in range(first[v], first[v + 1]):
                w = beside[j]
                if not visited[w]:
                    if rank[w] < best_rank:
                        best, best_rank = w, rank[w]
                elif seen[w] != start:
                    seen[w] = start
                    queue[high] = w
                    high += 1
            low += 1
    return int(best), steps


@kernel
def _visit(
    first: Ints,
    beside: Ints,
    rank: Ranks,
    visited: Ranks,
    seen: Ints,
    queue: Ints,
    at: int,
    most: int,
) -> tuple[int, int]:
    """Visit at most `most` vertices; return the next, -1 if none is left, and the travel."""
    travel = 0
    for _ in range(most):
        visited[at] = 1
        at, steps = nearest_unvisited(first, beside, rank, visited, seen, queue, at)
        if at < 0:
            break
        travel += steps
    return at, travel  # fmt: skip


def greedy_travel(first: Ints, beside: Ints, rank: Ranks, start: int) -> tuple[int, int]:
    """Return the travel of Greedy Mapping up to the last vertex, and the number of visited
    vertices.

    It returns to Python now and then, so that it can be interrupted.
    """
    visited = np.zeros(len(rank), np.int8)
    seen = np.full(len(rank), -1, np.int32)
    queue = np.empty(len(rank), np.int32)
    at, travel = start, 0
    while at >= 0:
        at, more = _visit(first, beside, rank, visited, seen, queue, at, VISITS)
        travel += more
    return travel, int(visited.sum(dtype=np.int64))
