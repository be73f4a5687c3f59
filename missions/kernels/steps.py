"""Steps from cell to cell of a region that changes a little at a time.

Cells have slots, which they keep. `near` holds the slots of the four neighbours of each (-1: none
yet), `present` says which cells belong to the region now. `steps[slot, column]` are the steps from
the cell `source[column]` to a cell, `FAR` where it is not reached; a column without a source (-1)
is not in use. When a cell comes or goes only those steps are touched that become other ones.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from missions.kernels.jit import kernel

Ints = NDArray[np.int32]
Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

FAR = 1 << 30


@kernel
def locate(
    cells: Ints, width: int, shift: int, frame: Ints, frame_width: int, near: Ints, count: int
) -> tuple[Ints, int]:
    """The slots of the cells of a picture, and how many slots are given away with those that are
    new; -1 for these when there is no slot left.

    `cells` are places in a picture of so many columns, `frame` has the slots by place of a larger
    one (-1: none), in which the first cell of the picture is at `shift`.
    """
    slots = np.empty(cells.size, np.int32)
    for i in range(cells.size):
        place = shift + (cells[i] // width) * frame_width + cells[i] % width
        slot = frame[place]
        if slot < 0:
            if count == near.shape[0]:
                return slots, -1
            slot = count
            count += 1
            frame[place] = slot
            for side in range(4):
                other = frame[place + (frame_width, 1, -frame_width, -1)[side]]
                near[slot, side] = other
                if other >= 0:
                    near[other, (side + 2) % 4] = slot
        slots[i] = slot
    return slots, count


@kernel
def _settle(
    steps: Ints, near: Ints, present: Flags, column: int, queue: Ints, waiting: Flags, tail: int
) -> None:
    """Let what became nearer make its neighbours nearer, too, from the first `tail` in `queue`."""
    head, room = 0, queue.size
    while head < tail:
        here = queue[head % room]
        head += 1
        waiting[here] = False
        further = steps[here, column] + 1
        for side in range(4):
            there = near[here, side]
            if there >= 0 and present[there] and steps[there, column] > further:
                steps[there, column] = further
                if not waiting[there]:
                    waiting[there] = True
                    queue[tail % room] = there
                    tail += 1


@kernel
def add(steps: Ints, near: Ints, present: Flags, source: Ints, slots: Ints) -> None:
    """These cells come to the region."""
    queue = np.empty(present.size, np.int32)
    waiting = np.zeros(present.size, np.bool_)
    for slot in slots:
        present[slot] = True
        for column in range(source.size):
            if source[column] < 0:
                continue
            least, most = FAR, 0
            for side in range(4):
                other = near[slot, side]
                if other >= 0 and present[other]:
                    least = min(least, steps[other, column])
                    most = max(most, steps[other, column])
            steps[slot, column] = min(least + 1, FAR)
            if most > least + 2:
                queue[0] = slot
                _settle(steps, near, present, column, queue, waiting, 1)


@kernel
def _held(steps: Ints, near: Ints, present: Flags, column: int, slot: int) -> bool:
    """Whether a neighbour is nearer to the source by one step."""
    for side in range(4):
        other = near[slot, side]
        if other >= 0 and present[other] and steps[other, column] == steps[slot, column] - 1:
            return True
    return False


@kernel
def _cut_off(
    steps: Ints, near: Ints, present: Flags, column: int, slot: int, queue: Ints, level: Ints
) -> int:
    """Set to `FAR` what was reached by shortest ways over the cell `slot` only, which has left;
    they are in `queue`, this many. `level` is for the steps that they had."""
    queue[0], level[0] = slot, steps[slot, column]
    steps[slot, column] = FAR
    head, tail = 0, 1
    while head < tail:  # by steps, so that a cell is judged after all that may hold it
        here, further = queue[head], level[head] + 1
        head += 1
        for side in range(4):
            there = near[here, side]
            if there < 0 or not present[there] or steps[there, column] != further:
                continue
            if not _held(steps, near, present, column, there):
                queue[tail], level[tail] = there, further
                steps[there, column] = FAR
                tail += 1
    return tail


@kernel
def remove(steps: Ints, near: Ints, present: Flags, source: Ints, slots: Ints) -> None:
    """These cells leave the region; none of them is a source."""
    lost, level = np.empty(present.size, np.int32), np.empty(present.size, np.int32)
    queue = np.empty(present.size, np.int32)
    waiting = np.zeros(present.size, np.bool_)
    for slot in slots:
        present[slot] = False
        for column in range(source.size):
            if source[column] < 0 or steps[slot, column] == FAR:
                continue
            count = _cut_off(steps, near, present, column, slot, lost, level)
            tail = 0
            for i in range(1, count):  # round about, over what still is reached
                here, least = lost[i], FAR
                for side in range(4):
                    other = near[here, side]
                    if other >= 0 and present[other]:
                        least = min(least, steps[other, column])
                if least < FAR:
                    steps[here, column] = least + 1
                    waiting[here] = True
                    queue[tail] = here
                    tail += 1
            _settle(steps, near, present, column, queue, waiting, tail)


@kernel
def spread(
    steps: Ints, near: Ints, present: Flags, source: Ints, columns: Ints, count: int
) -> None:
    """Fill these columns anew, each from its source; `count` slots are given away."""
    here_by = np.empty(count, np.int32)
    queue = np.empty(count, np.int32)
    for column in columns:
        here_by[:] = FAR
        here_by[source[column]] = 0
        queue[0] = source[column]
        head, tail = 0, 1
        while head < tail:
            here = queue[head]
            head += 1
            for side in range(4):
                there = near[here, side]
                if there >= 0 and present[there] and here_by[there] == FAR:
                    here_by[there] = here_by[here] + 1
                    queue[tail] = there
                    tail += 1
        steps[:count, column] = here_by


@kernel
def between(steps: Ints, sites: Ints, columns: Ints) -> Floats:
    """Steps from site to site, -1 where one is not reached; `columns` are those of the sites."""
    legs = np.empty((sites.size, sites.size), np.float64)
    for i in range(sites.size):
        for j in range(sites.size):
            many = steps[sites[i], columns[j]]
            legs[i, j] = many if many < FAR else -1
    return legs
