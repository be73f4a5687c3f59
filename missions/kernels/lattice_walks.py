"""Walks of one robot on a bounded m x m lattice, coverage after coverage.

After M. Batalin and G. Sukhatme, *The Analysis of an Efficient Algorithm for Robot Coverage and
Exploration based on Sensor Network Deployment*. A coverage ends when every vertex has been visited
since the last one ended; the marks that a robot leaves stay. Vertices are numbered row by row; a
walk starts at vertex 0, a corner.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from missions.kernels.jit import kernel

Ints = NDArray[np.int32]

MASK = 0xFFFFFFFF


@kernel
def neighbours(m: int) -> tuple[Ints, Ints]:
    """The neighbours of every vertex, shape (m m, 4), of which the first `degree` are used."""
    near = np.zeros((m * m, 4), np.int32)
    degree = np.zeros(m * m, np.int32)
    for v in range(m * m):
        row, column = v // m, v % m
        for inside, w in (
            (row > 0, v - m), (column < m - 1, v + 1), (row < m - 1, v + m), (column > 0, v - 1)
        ):  # fmt: skip
            if inside:
                near[v, degree[v]] = w
                degree[v] += 1
    return near, degree


@kernel
def _draw(state: int) -> int:
    """The next of a sequence of random numbers, 1 to 2^32 - 1: Marsaglia's xorshift."""
    state ^= (state << 13) & MASK
    state ^= state >> 17
    return state ^ ((state << 5) & MASK)


@kernel
def shuffled(near: Ints, degree: Ints, seed: int) -> Ints:
    """The neighbours of every vertex in an order of its own."""
    near = near.copy()
    state = seed
    for v in range(len(near)):
        for i in range(degree[v] - 1, 0, -1):
            state = _draw(state)
            j = state % (i + 1)
            near[v, i], near[v, j] = near[v, j], near[v, i]
    return near


@kernel
def least_recently_visited(near: Ints, degree: Ints, coverages: int) -> NDArray[np.int64]:
    """Steps of every coverage by LRV.

    A vertex counts for each of its directions how often it sent the robot there, and sends it
    where the count is least, of equals to the first in `near`. Then the counts differ by one at
    most, and the directions follow each other round and round: a pointer says the same.
    """
    steps = np.zeros(coverages, np.int64)
    pointer = np.zeros(len(near), np.int32)
    visited = np.full(len(near), -1, np.int32)
    v = 0
    for coverage in range(coverages):
        visited[v] = coverage
        left = len(near) - 1
        while left:
            turn = pointer[v]
            pointer[v] = turn + 1 if turn + 1 < degree[v] else 0
            v = near[v, turn]
            steps[coverage] += 1
            if visited[v] != coverage:
                visited[v] = coverage
                left -= 1
    return steps


@kernel
def one_lrta(
    near: Ints, degree: Ints, coverages: int, seed: int, by_chance: bool
) -> NDArray[np.int64]:
    """Steps of every coverage by 1-LRTA*: to the neighbour of least weight; what is left gets that
    weight and one more. Of equals one by chance, or the first in `near`."""
    steps = np.zeros(coverages, np.int64)
    weight = np.zeros(len(near), np.int64)
    visited = np.full(len(near), -1, np.int32)
    v, state = 0, seed
    for coverage in range(coverages):
        visited[v] = coverage
        left = len(near) - 1
        while left:
            best, equals = near[v, 0], 1
            for i in range(1, degree[v]):
                w = near[v, i]
                if weight[w] < weight[best]:
                    best, equals = w, 1
                elif by_chance and weight[w] == weight[best]:
                    equals += 1
                    state = _draw(state)
                    if state % equals == 0:
                        best = w
            weight[v] = weight[best] + 1
            v = best
            steps[coverage] += 1
            if visited[v] != coverage:
                visited[v] = coverage
                left -= 1
    return steps


@kernel
def random_walk(near: Ints, degree: Ints, coverages: int, seed: int) -> NDArray[np.int64]:
    """Steps of every coverage by a random walk."""
    steps = np.zeros(coverages, np.int64)
    visited = np.full(len(near), -1, np.int32)
    v, state = 0, seed
    for coverage in range(coverages):
        visited[v] = coverage
        left = len(near) - 1
        while left:
            state = _draw(state)
            v = near[v, state % int(degree[v])]
            steps[coverage] += 1
            if visited[v] != coverage:
                visited[v] = coverage
                left -= 1
    return steps
