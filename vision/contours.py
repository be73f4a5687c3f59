"""Lines of equal level on a raster, between its pixels: marching squares.

Levels are linear between pixels' centres. Every line is closed: nothing beyond the raster is
region. Crossings have numbers that hold over the whole raster, so it is processed block by block.
The library contourpy needs all of it at once, as 8 bytes a pixel, and five times as long.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vision.raster import UNSEEN

# sides of a square of four pixels' centres
_TOP, _RIGHT, _BOTTOM, _LEFT = range(4)
# Key: the corners that are inside (1 upper left, 2 upper right, 4 lower right, 8 lower left).
# Value: the sides from and to which a line runs with the inside at its left. A diagonal has two
# corners apart.
_LINES: Final = {
    1: ((_LEFT, _TOP),),
    2: ((_TOP, _RIGHT),),
    3: ((_LEFT, _RIGHT),),
    4: ((_RIGHT, _BOTTOM),),
    5: ((_LEFT, _TOP), (_RIGHT, _BOTTOM)),
    6: ((_TOP, _BOTTOM),),
    7: ((_LEFT, _BOTTOM),),
    8: ((_BOTTOM, _LEFT),),
    9: ((_BOTTOM, _TOP),),
    10: ((_TOP, _RIGHT), (_BOTTOM, _LEFT)),
    11: ((_BOTTOM, _RIGHT),),
    12: ((_RIGHT, _LEFT),),
    13: ((_RIGHT, _TOP),),
    14: ((_TOP, _LEFT),),
}
_ENDS: Final = np.full((2, 2, 16), -1, np.int8)
for _case, _pairs in _LINES.items():
    for _which, _pair in enumerate(_pairs):
        _ENDS[_which, :, _case] = _pair


Indices = NDArray[np.intp]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Ring:
    """A closed line, the inside at its left.

    Attributes:
        points: Shape (n, 2): columns and rows; a pixel's centre is a whole number.
        open: Shape (n,): True where the line runs along ground that no picture shows.
        area_px: Enclosed area in pixels: positive around the inside, negative around a hole.
    """

    points: NDArray[np.float64]
    open: Flags
    area_px: float


class Contours:
    """The lines of one level over a raster of `columns`."""

    def __init__(self, level: float, columns: int) -> None:
        self._level, self._columns = level, columns
        self._from: list[NDArray[np.int64]] = []
        self._to: list[NDArray[np.int64]] = []
        self._points: list[NDArray[np.float64]] = []
        self._open: list[Flags] = []

    def add(self, levels: NDArray[np.uint8], top: int, left: int) -> None:
        """Add the squares between the pixels of a part of the raster.

        `levels` begins in row `top` and column `left`. Parts share a row, or column, of pixels.
        """
        # above the level and below UNSEEN, in one comparison: what is less goes round to the top
        least = np.uint8(int(self._level) + 1)
        inside = (levels - least < np.uint8(UNSEEN) - least).view(np.uint8)
        across, down = inside[:, 1:] ^ inside[:, :-1], inside[1:] ^ inside[:-1]
        mixed = across[:-1] | across[1:] | down[:, 1:]  # neither none nor all four corners
        rows, columns = np.divmod(np.flatnonzero(mixed.view(np.bool_)), mixed.shape[1])
        if not len(rows):
            return
        cases = inside[rows, columns] + inside[rows, columns + 1] * np.uint8(2)
        cases += inside[rows + 1, columns + 1] * np.uint8(4) + inside[rows + 1, columns] * np.uint8(
            8
        )
        for which in range(2):
            start, end = _ENDS[which, 0, cases], _ENDS[which, 1, cases]
            some = start >= 0
            self._to.append(self._number(*_side(rows[some], columns[some], end[some]), top, left))
            r, c, upright = _side(rows[some], columns[some], start[some])
            self._from.append(self._number(r, c, upright, top, left))
            self._place(levels, r, c, upright, top, left)

    def _number(
        self, r: Indices, c: Indices, upright: Flags, top: int, left: int
    ) -> NDArray[np.int64]:
        """Number crossings by the upper, or left, pixel of their side, twice."""
        numbers: NDArray[np.int64] = 2 * ((r + top) * self._columns + c + left) + upright
        return numbers

    def _place(
        self, levels: NDArray[np.uint8], r: Indices, c: Indices, upright: Flags, top: int, left: int
    ) -> None:
        """Locate the lines' beginnings: each crossing is the beginning of one."""
        first = levels[r, c]
        second = levels[r + upright, c + ~upright]
        unseen = (first == UNSEEN) | (second == UNSEEN)
        a = np.where(first == UNSEEN, -1.0, first.astype(np.float64) - self._level)
        b = np.where(second == UNSEEN, -1.0, second.astype(np.float64) - self._level)
        # at the rim of the pictures the line runs in the middle between the two
        part = np.where(unseen, 0.5, a / np.where(a == b, 1.0, a - b))
        x = left + c + np.where(upright, 0.0, part)
        y = top + r + np.where(upright, part, 0.0)
        self._points.append(np.column_stack([x, y]))
        self._open.append(unseen)

    def rings(self, least_px: float) -> Iterator[Ring]:
        """Yield the closed lines around at least `least_px` pixels."""
        if not self._from:
            return
        begin, end = np.concatenate(self._from), np.concatenate(self._to)
        points, unseen = np.concatenate(self._points), np.concatenate(self._open)
        order = np.argsort(begin, kind="stable")
        following = order[np.searchsorted(begin[order], end)]
        chain, starts = _cycles(following, order)
        along, unseen = points[chain], unseen[chain]
        x, y = along.T
        after = np.empty(len(chain), np.intp)  # the next point of the same line
        after[:-1] = np.arange(1, len(chain))
        after[[*(starts[1:] - 1), len(chain) - 1]] = starts
        areas = -0.5 * np.add.reduceat(x * y[after] - x[after] * y, starts)
        ends = [*starts[1:].tolist(), len(chain)]
        for first, last, area in zip(starts.tolist(), ends, areas.tolist(), strict=True):
            if abs(area) >= least_px:
                yield Ring(along[first:last], unseen[first:last], area)


def _side(
    rows: Indices, columns: Indices, side: NDArray[np.int8]
) -> tuple[Indices, Indices, Flags]:
    """Return the upper, or left, pixel of squares' sides, and whether these are upright."""
    return rows + (side == _BOTTOM), columns + (side == _RIGHT), (side == _LEFT) | (side == _RIGHT)


def _cycles(following: Indices, order: Indices) -> tuple[Indices, Indices]:
    """Return the cycles of a permutation one after another, and where each begins.

    Each begins with its first element in `order`; the cycles come in that order.

    >>> chain, starts = _cycles(np.array([2, 3, 4, 1, 0]), np.array([1, 0, 2, 3, 4]))
    >>> chain.tolist(), starts.tolist()
    ([1, 3, 0, 2, 4], [0, 2])
    """
    count = len(order)
    place = np.empty(count, np.intp)
    place[order] = np.arange(count)
    after = place[following[order]]  # by places in the order, as all that follows
    # twice as far ahead each time, until each element knows the first one of its cycle
    first, ahead = np.minimum(np.arange(count), after), after
    while True:
        further = np.minimum(first, first[ahead])
        if (further == first).all():
            break
        first, ahead = further, ahead[ahead]
    # number of elements left to the end of the cycle, which is cut before its first
    last = np.flatnonzero(first[after] == after)
    ahead, left = after.copy(), np.ones(count, np.intp)
    ahead[last], left[last] = last, 0
    while (more := left[ahead]).any():
        left += more
        ahead = ahead[ahead]
    sizes = np.bincount(first, minlength=count)
    starts = np.cumsum(sizes) - sizes
    chain = np.empty(count, np.intp)
    chain[starts[first] + sizes[first] - 1 - left] = order
    return chain, starts[sizes > 0]
