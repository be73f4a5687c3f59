"""Walks of one robot on a bounded m x m lattice, coverage after coverage.

After M. Batalin and G. Sukhatme, *The Analysis of an Efficient Algorithm for Robot Coverage and
Exploration based on Sensor Network Deployment*. A coverage ends when every vertex has been visited
since the last one ended; the marks that a robot leaves stay. Vertices are numbered row by row; a
walk starts at vertex 0, a corner.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from missions.planning.kernels.jit import kernel, part

Ints = NDArray[np.int32]

MASK = 0xFFFFFFFF


@kernel
def neighbours(m: int) -> tuple[Ints, Ints]:
    """Return the neighbours of every vertex, shape (m m, 4); the first `degree` are used."""
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


@part
def _draw(state: int) -> int:
    """Return the next random number, 1 to 2^32 - 1: Marsaglia's xorshift."""
    state ^= (state << 13) & MASK
    state ^= state >> 17
    return state ^ ((state << 5) & MASK)


@kernel
def shuffled(near: Ints, degree: Ints, seed: int) -> Ints:
    """Return the neighbours of every vertex in a random order."""
    near = near.copy()
    state = seed
    for v in range(len(near)):
        for i in range(degree[v] - 1, 0, -1):
            state = _draw(state)
            j = state % (i + 1)
            near[v, i], near[v, j] = near[v, j], near[v, i]
    return near


LRV, LRTA, RANDOM = 0, 1, 2
"""Rules of walks.

LRV: in the direction that the vertex has chosen least often, of equals the first in `near`. Then
these counts differ by one at most, and the directions follow each other round and round, as with a
pointer. LRTA (1-LRTA*): to the neighbour of least weight; the vertex gets that weight and one more.
Of equals one by chance, with the state 0 the first in `near`. RANDOM leaves no marks.
"""


@part
def _step(
    rule: int, near: Ints, degree: Ints, marks: Ints, place: int, state: int
) -> tuple[int, int]:
    """Return the next place by a rule, and the state of the random numbers then."""
    if rule == LRV:
        turn = marks[place]
        marks[place] = turn + 1 if turn + 1 < degree[place] else 0
        return near[place, turn], state
    if rule == RANDOM:
        state = _draw(state)
        return near[place, state % int(degree[place])], state
    best, equals = near[place, 0], 1
    for i in range(1, degree[place]):
        other = near[place, i]
        if marks[other] < marks[best]:
            best, equals = other, 1
        elif state and marks[other] == marks[best]:
            equals += 1
            state = _draw(state)
            if state % equals == 0:
                best = other
    marks[place] = marks[best] + 1
    return best, state


@kernel
def coverage(
    rule: int,
    near: Ints,
    degree: Ints,
    marks: Ints,
    visited: Ints,
    number: int,
    place: int,
    state: int,
) -> tuple[int, int, int]:
    """Return the steps of one coverage, the last place, and the state of the random numbers.

    Args:
        rule: rule of the walk.
        near: the neighbours of every vertex, `degree` of them used.
        degree: as `neighbours` returns it.
        marks: the robot's marks at the vertices, changed; at first zeros.
        visited: the last coverage in which a vertex was visited, changed; at first -1.
        number: number of this coverage.
        place: place of the robot.
        state: state of the random numbers, not 0 unless the rule allows it.
    """
    visited[place] = number
    left, steps = len(near) - 1, 0
    while left:
        place, state = _step(rule, near, degree, marks, place, state)
        steps += 1
        if visited[place] != number:
            visited[place] = number
            left -= 1
    return steps, place, state


def cover(rule: int, near: Ints, degree: Ints, coverages: int, state: int) -> list[int]:
    """Return the steps of each coverage; between two of them a run can be interrupted."""
    marks, visited = np.zeros(len(near), np.int32), np.full(len(near), -1, np.int32)
    found, place = [], 0
    for number in range(coverages):
        steps, place, state = coverage(rule, near, degree, marks, visited, number, place, state)
        found.append(steps)
    return found
