"""The local search of `missions.kernels.routes` for a single robot, where an attempt is quick."""

from __future__ import annotations

import numpy as np

from missions.kernels.attempts import NEAR, Floats, Ints, attempt, nearest
from missions.kernels.jit import kernel


@kernel
def improve_alone(
    legs: Floats, route: Ints, length: float, moves: int, heat: float, state: int
) -> None:
    """`improve` for a single robot, in place: with `behind` 0 everywhere the shortest route is the
    cheapest, and how much an attempt saves shows in the few legs that it changes.

    `route` holds all nodes; `length` is the route's with the loads of its nodes.
    """
    nodes = route.size
    way = np.empty(nodes + 2, np.int32)  # from the robot through the nodes home
    way[0], way[1 : nodes + 1], way[nodes + 1] = nodes, route, nodes + 1
    place_of = np.empty(nodes + 1, np.int32)
    place_of[way[: nodes + 1]] = np.arange(nodes + 1)
    near = nearest(legs, nodes, 1, min(NEAR, nodes))
    for move in range(moves):
        node, other, relocates, many, turned, warmth, state = attempt(near, 1, state)
        warmth *= heat * (1.0 - 1.25 * move / moves)
        i, j = place_of[node], place_of[other] + 1
        last = min(i + many - 1, nodes)
        allowed = (length + 1.0) * warmth / 6.0 if warmth > 0.0 else -1e-9 * (length + 1.0)
        if relocates:  # the nodes at i .. last to between j - 1 and j
            if turned and j > 1:
                j -= 1  # so that the node comes beside the other
            if i <= j <= last + 1:
                continue
            left, right = (last, i) if turned else (i, last)
            gain = (
                legs[way[i - 1], way[last + 1]]
                - legs[way[i - 1], way[i]]
                - legs[way[last], way[last + 1]]
                + legs[way[j - 1], way[left]]
                + legs[way[right], way[j]]
                - legs[way[j - 1], way[j]]
            )
            if gain < allowed:
                if turned:
                    way[i : last + 1] = way[i : last + 1][::-1].copy()
                if j > last:
                    _rotate(way, i, last + 1, j)
                else:
                    _rotate(way, j, i, last + 1)
        else:  # the piece between the two turned round
            first, last = min(i + 1, j), max(i, j - 1)
            if first >= last:
                continue
            gain = (
                legs[way[first - 1], way[last]]
                + legs[way[first], way[last + 1]]
                - legs[way[first - 1], way[first]]
                - legs[way[last], way[last + 1]]
            )
            if gain < allowed:
                way[first : last + 1] = way[first : last + 1][::-1].copy()
        if gain < allowed:
            length += gain
            place_of[way[: nodes + 1]] = np.arange(nodes + 1)
    route[:] = way[1 : nodes + 1]


@kernel
def _rotate(way: Ints, start: int, middle: int, end: int) -> None:
    """Swap the neighbouring pieces start .. middle-1 and middle .. end-1."""
    piece = way[start:middle].copy()
    way[start : start + end - middle] = way[middle:end].copy()
    way[start + end - middle : end] = piece
