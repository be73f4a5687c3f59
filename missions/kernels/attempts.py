"""What a local search over routes tries next: drawn, and mostly among what is near.

Sites are numbered as in `missions.kernels.routes`: first the nodes, then the robots.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from missions.kernels.jit import kernel

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]

NEAR, ONE_FAR = 8, 8
"""How many nodes and robots are near a node; one attempt in so many takes any other instead."""


@kernel
def draw(state: int) -> int:
    """The next state of a small congruential generator; its upper bits, `state >> 8`, are drawn."""
    return (state * 1103515245 + 12345) & 0x7FFFFFFF


@kernel
def nearest(legs: Floats, nodes: int, starts: int, many: int) -> Ints:
    """For each node the `many` nearest of the other nodes and the `starts` robots, nearest first.

    `many` is less than `nodes + starts`.
    """
    found = np.zeros((nodes, many), np.int32)
    cost = np.empty(many)
    for node in range(nodes):
        cost[:] = np.inf
        for other in range(nodes + starts):
            if other == node or legs[node, other] >= cost[many - 1]:
                continue
            place = many - 1
            while place > 0 and cost[place - 1] > legs[node, other]:
                cost[place] = cost[place - 1]
                found[node, place] = found[node, place - 1]
                place -= 1
            cost[place] = legs[node, other]
            found[node, place] = other
    return found


@kernel
def attempt(near: Ints, starts: int, state: int) -> tuple[int, int, bool, int, bool, float, int]:
    """What the local search tries next: bring a node beside another one or a robot, by relocating
    up to so many nodes, perhaps turned round, or else by turning or swapping pieces; the part of
    the heat that it may cost; and the generator's next state."""
    nodes = near.shape[0]
    state = draw(state)
    node = (state >> 8) % nodes
    state = draw(state)
    relocates = (state >> 8) % 10 < 6
    state = draw(state)
    other = (state >> 8) % (nodes + starts)
    state = draw(state)
    if (state >> 8) % ONE_FAR != 0:
        state = draw(state)
        other = near[node, (state >> 8) % near.shape[1]]
    state = draw(state)
    many, turned = 1 + (state >> 8) % 4, (state >> 16) % 2 == 1
    state = draw(state)
    return node, other, relocates, many, turned, (state >> 8) / 8388608.0, state
