"""Known cells as arrays: neighbours, unobserved cells around them, steps and ways between them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from missions.planning.kernels.jit import kernel, part
from missions.planning.kernels.routes import Floats, Ints

Picture = NDArray[np.int8]
"""Cells row by row: 0 not known to be ROI, or one of the following."""
UNLOOKED, LOOKED, IMAGINED = 1, 2, 3


@part
def unobserved(picture: Picture, width: int, cell: int) -> bool:
    """Return whether a cell is unobserved: not known, and beside no observed cell."""
    return bool(
        picture[cell] == 0
        and picture[cell + width] != LOOKED
        and picture[cell + 1] != LOOKED
        and picture[cell - width] != LOOKED
        and picture[cell - 1] != LOOKED
    )


@part
def is_compact(picture: Picture, width: int) -> bool:
    """Return whether at least a third of the 2 x 2 squares with three cells of ROI is ROI as a
    whole."""
    whole, torn = 0, 0
    for cell in range(picture.size):
        if picture[cell] == 0:
            continue
        for up in (-width, width):
            for right in (-1, 1):  # the known cell's square, and the corner across
                if picture[cell + up] != 0 and picture[cell + right] != 0:
                    across = cell + up + right
                    if picture[across] != 0:
                        whole += 1
                    elif not unobserved(picture, width, across):
                        torn += 4  # a whole square is met from each of its four cells
    return 2 * whole >= torn


@kernel
def imagine(picture: Picture, width: int) -> None:
    """Add the nooks to the picture as ROI: unobserved cells with two or more neighbours in it.

    Not where the ROI has not been compact so far.
    """
    if not is_compact(picture, width):
        return
    for cell in range(picture.size):
        if picture[cell] != UNLOOKED:
            continue
        for side in range(4):
            there = cell + (width, 1, -width, -1)[side]
            beside = 0
            for step in (width, 1, -width, -1):
                if picture[there + step] != 0:
                    beside += 1
            if beside > 1 and unobserved(picture, width, there):
                picture[there] = IMAGINED


@kernel
def survey(picture: Picture, width: int) -> tuple[Ints, Ints, Ints]:
    """Return the known cells, their four neighbours' numbers (-1: none), and unobserved neighbours.

    The last is a count for each unobserved or imagined cell. The outer three rows and columns of
    the picture are empty.
    """
    number = np.full(picture.size, -1, np.int32)
    known = np.empty(picture.size, np.int32)
    count = 0
    for cell in range(picture.size):
        if picture[cell] != 0:
            known[count] = cell
            number[cell] = count
            count += 1
    cells = known[:count].copy()
    near = np.empty((cells.size, 4), np.int32)
    unseen = np.zeros(cells.size, np.int32)
    for i in range(cells.size):
        for side in range(4):
            there = cells[i] + (width, 1, -width, -1)[side]
            near[i, side] = number[there]
            if picture[cells[i]] != LOOKED and unobserved(picture, width, there):
                unseen[i] += 1
    return cells, near, unseen


@kernel
def spread(near: Ints, starts: Ints) -> Ints:
    """Return steps from each of `starts` to every cell, (starts, cells); -1 if it is not
    reached."""
    distance = np.full((starts.size, near.shape[0]), -1, np.int32)
    queue = np.empty(near.shape[0], np.int32)
    for s in range(starts.size):
        steps = distance[s]
        steps[starts[s]] = 0
        queue[0] = starts[s]
        head, tail = 0, 1
        while head < tail:
            here = queue[head]
            head += 1
            for side in range(4):
                there = near[here, side]
                if there >= 0 and steps[there] < 0:
                    steps[there] = steps[here] + 1
                    queue[tail] = there
                    tail += 1
    return distance


@kernel
def step_on(near: Ints, steps: Ints, fresh: NDArray[np.bool_], start: int) -> int:
    """Return the neighbour of `start` on a shortest way to where `steps` is 0.

    Of those ways it is the one over the most `fresh` cells; of equal ones the last in the order N,
    E, S, W.
    """
    gain: Floats = np.full(steps.size, -1.0)
    queue = np.empty(steps.size, np.int32)
    queue[0] = start
    gain[start] = 0.0
    head, tail = 0, 1
    while head < tail:  # all cells on shortest ways, the start first
        here = queue[head]
        head += 1
        for side in range(4):
            there = near[here, side]
            if there >= 0 and steps[there] == steps[here] - 1 and gain[there] < 0.0:
                gain[there] = 0.0
                queue[tail] = there
                tail += 1
    best_side = 0
    for k in range(tail - 1, -1, -1):  # added up from the goal
        here = queue[k]
        best = 0.0
        for side in range(4):
            there = near[here, side]
            if there >= 0 and steps[there] == steps[here] - 1 and gain[there] >= best:
                best = gain[there]
                best_side = side
        gain[here] = best + (1.0 if fresh[here] else 0.0)
    return int(near[start, best_side])
