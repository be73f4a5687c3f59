"""The worth of a frame of each cell, and the votes of a frame, on arrays.

A window of cells, row by row from its south-west corner: `width` columns, `height` rows.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from missions.planning.kernels.jit import kernel, part

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.uint8]

_NEAR = 2  # cells in each direction that predict a cell beside them


@part
def _beside(c: int, side: int, width: int, height: int) -> int:
    """Return the neighbour of a cell on a side (0 to 3), or -1 outside the window; 4 is itself."""
    i = c % width + (1 if side == 0 else -1 if side == 1 else 0)
    j = c // width + (1 if side == 2 else -1 if side == 3 else 0)
    if i < 0 or j < 0 or i >= width or j >= height:
        return -1
    return j * width + i


@part
def flood(positive: Flags, root: int, width: int, height: int, member: Flags, queue: Ints) -> int:
    """Mark in `member` the cells of `positive` that are connected with `root`; return their number.

    They are in `queue`, nearest first.
    """
    if root < 0 or positive[root] == 0:
        return 0
    member[root] = 1
    queue[0] = root
    head, tail = 0, 1
    while head < tail:
        c = queue[head]
        head += 1
        for side in range(4):
            d = _beside(c, side, width, height)
            if d >= 0 and member[d] == 0 and positive[d] != 0:
                member[d] = 1
                queue[tail] = d
                tail += 1
    return tail


@part
def _decided(yes: Ints, no: Ints, c: int, majority: int, against: int) -> bool:
    return bool(yes[c] >= majority or no[c] >= against)


@part
def chance_of_roi(yes: Ints, no: Ints, c: int, width: int, height: int) -> float:
    """Return the chance of a cell to be ROI by those around it: Laplace's rule over 5 x 5."""
    roi, other = 0, 0
    i, j = c % width, c // width
    for y in range(max(0, j - _NEAR), min(height, j + _NEAR + 1)):
        for x in range(max(0, i - _NEAR), min(width, i + _NEAR + 1)):
            f = y * width + x
            if yes[f] > no[f]:
                roi += 1
            elif no[f] > 0:
                other += 1
    return (1.0 + roi) / (2.0 + roi + other)


@part
def _chance_to_be_work(
    d: int, yes: Ints, no: Ints, width: int, height: int, chance: Floats
) -> float:
    """Return the chance that a neighbour will be work and turns out to be ROI."""
    none = 1.0
    for side in range(4):
        e = _beside(d, side, width, height)
        if e >= 0 and chance[e] > 0.0 and no[e] <= yes[e]:
            none *= 1.0 - chance[e] * chance_of_roi(yes, no, e, width, height)
    return 1.0 - none


@kernel
def value(
    yes: Ints,
    no: Ints,
    majority: int,
    frames: int,
    root: int,
    width: int,
    height: int,
    penalty: float,
    prize: float,
    rings: int,
    least: float,
    closed: Flags,
    asked: Flags,
) -> tuple[Floats, Ints, Ints, int]:
    """Return the worth of frames: (worth, frames needed, cells with worth, work).

    Work is an undecided cell that is in the region or beside it, or has a 1 in `asked`. The region
    is the cells connected with `root`, or all positive ones if that is -1. Cells up to `rings`
    beyond have the chance that they will be work. This is the chance of a neighbour to be ROI, by
    that neighbour's neighbourhood, times its own chance. Less than `least` is none. `closed` cells
    have none. The first two are by cell. Cells of work come first among the cells with worth, and
    `work` is their number.
    """
    cells = width * height
    against = frames - majority + 1
    positive = np.zeros(cells, np.uint8)
    member = np.zeros(cells, np.uint8)
    need = np.zeros(cells, np.int64)
    worth, chance = np.zeros(cells), np.zeros(cells)
    for c in range(cells):
        if yes[c] > no[c] or (c == root and yes[c] >= no[c]):
            positive[c] = 1
    region, queue = np.empty(cells, np.int64), np.empty(cells, np.int64)
    if root >= 0:
        members = flood(positive, root, width, height, member, region)
    else:
        members = 0
        for c in range(cells):
            member[c] = positive[c]
            if positive[c]:
                region[members] = c
                members += 1
    end = 0
    for r in range(members):
        for side in range(5):
            d = _beside(region[r], side, width, height)
            if d < 0 or need[d] > 0 or closed[d] or _decided(yes, no, d, majority, against):
                continue
            need[d] = min(majority - yes[d], against - no[d])
            worth[d] = penalty / need[d]
            chance[d] = 1.0
            queue[end] = d
            end += 1
    for c in range(cells):
        if not asked[c] or need[c] > 0 or closed[c] or _decided(yes, no, c, majority, against):
            continue
        need[c] = min(majority - yes[c], against - no[c])
        worth[c] = penalty / need[c]
        queue[end] = c
        end += 1
    work, begin = end, 0
    for _ in range(rings):
        stop = end
        for r in range(begin, stop):
            for side in range(4):
                d = _beside(queue[r], side, width, height)
                if d < 0 or need[d] > 0 or closed[d] or member[d]:
                    continue
                if _decided(yes, no, d, majority, against):
                    continue
                likely = _chance_to_be_work(d, yes, no, width, height, chance)
                if likely < least:
                    continue
                chance[d] = likely
                need[d] = majority
                worth[d] = prize * likely / majority
                queue[end] = d
                end += 1
        begin = stop
    return worth, need, queue[:end].copy(), work


@kernel
def see(
    x: float,
    y: float,
    half_x: float,
    half_y: float,
    grid: tuple[int, int, int, int, float],
    truth: Ints,
    flips: Ints,
    yes: Ints,
    no: Ints,
    frames: int,
    majority: int,
) -> int:
    """Add one frame's votes on the cells that it shows whole; return the number that counted.

    (`x`, `y`) is its middle; a cell is shown whole when its centre is within the halves from it.
    `grid` is as of `swath.Grid`. `flips` is by cell, 1 where the frame errs. A decided ballot takes
    no more votes.
    """
    west, south, width, height, cell = grid
    i0 = max(0, math.ceil((x - half_x) / cell) - west)
    i1 = min(width - 1, math.floor((x + half_x) / cell) - west)
    j0 = max(0, math.ceil((y - half_y) / cell) - south)
    j1 = min(height - 1, math.floor((y + half_y) / cell) - south)
    counted = 0
    for j in range(j0, j1 + 1):
        for i in range(i0, i1 + 1):
            c = j * width + i
            if _decided(yes, no, c, majority, frames - majority + 1):
                continue
            if truth[c] != flips[c]:
                yes[c] += 1
            else:
                no[c] += 1
            counted += 1
    return counted
