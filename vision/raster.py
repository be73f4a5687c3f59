"""A raster on the ground: square pixels along the grid's axes, rows from north to south."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Window(NamedTuple):
    """A part of a raster: its first row and column, and those after its last."""

    top: int
    left: int
    bottom: int
    right: int

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns; never negative."""
        return max(0, self.bottom - self.top), max(0, self.right - self.left)

    @property
    def is_empty(self) -> bool:
        """Whether it has no pixel."""
        return 0 in self.shape

    def common(self, other: Window) -> Window:
        """Return what two windows share; maybe empty.

        >>> Window(0, 0, 4, 4).common(Window(2, 1, 9, 3))
        Window(top=2, left=1, bottom=4, right=3)
        """
        return Window(
            max(self.top, other.top),
            max(self.left, other.left),
            min(self.bottom, other.bottom),
            min(self.right, other.right),
        )

    def within(self, other: Window) -> tuple[slice, slice]:
        """Return the slices of this window in an array of `other`, of which it is a part."""
        return (
            slice(self.top - other.top, self.bottom - other.top),
            slice(self.left - other.left, self.right - other.left),
        )

    def blocks(self, side: int) -> Iterator[Window]:
        """Yield windows of at most `side` pixels that cover it, row by row from its top."""
        for top in range(self.top, self.bottom, side):
            for left in range(self.left, self.right, side):
                yield Window(top, left, top + side, left + side).common(self)

    def grown(self, by: int) -> Window:
        """Return the window with `by` more pixels on each side."""
        return Window(self.top - by, self.left - by, self.bottom + by, self.right + by)


@dataclass(frozen=True, slots=True)
class Raster:
    """Pixels of `pitch_m` in the grid's moving frame.

    Attributes:
        west_m: Left edge of the first column, metres east.
        north_m: Upper edge of the first row, metres north.
        pitch_m: Edge of a pixel on the ground, metres, above 0.

    >>> raster = Raster(0.0, 10.0, 0.5, 4, 3)
    >>> raster.middles(Window(0, 0, 1, 2), 1)[1].tolist()
    [[-0.25, 9.75], [0.25, 9.75], [0.75, 9.75], [1.25, 9.75]]
    """

    west_m: float
    north_m: float
    pitch_m: float
    columns: int
    rows: int

    @property
    def whole(self) -> Window:
        """All of it."""
        return Window(0, 0, self.rows, self.columns)

    def shared(self, windows: Iterable[Window], side: int) -> dict[Window, list[int]]:
        """Return the blocks in which windows lie, from the north, each with the windows' numbers.

        >>> found = Raster(0.0, 0.0, 1.0, 9, 9).shared([Window(0, 3, 2, 6), Window(8, 0, 9, 1)], 4)
        >>> [(block.top, block.left, numbers) for block, numbers in found.items()]
        [(0, 0, [0]), (0, 4, [0]), (8, 0, [1])]
        """
        found: dict[tuple[int, int], list[int]] = {}
        for number, window in enumerate(windows):
            if window.is_empty:
                continue
            for row in range(window.top // side, -(-window.bottom // side)):
                for column in range(window.left // side, -(-window.right // side)):
                    found.setdefault((row, column), []).append(number)
        return {
            Window(
                row * side, column * side, (row + 1) * side, (column + 1) * side
            ).common(self.whole): found[row, column]
            for row, column in sorted(found)
        }  # fmt: skip

    def middles(self, window: Window, side: int) -> NDArray[np.float64]:
        """Return metres east and north of the middles of squares of `side` pixels.

        They cover a window from its first pixel, with one more all around. Shape (rows / side
        rounded up + 2, columns / side rounded up + 2, 2).
        """
        rows, columns = (np.arange(-1, math.ceil(edge / side) + 1) + 0.5 for edge in window.shape)
        east = self.west_m + (window.left + side * columns) * self.pitch_m
        north = self.north_m - (window.top + side * rows) * self.pitch_m
        return np.stack(np.meshgrid(east, north), axis=-1)

    def around(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> Window:
        """Return the window of the pixels between two corners (metres east and north)."""
        left, right = ((corner[0] - self.west_m) / self.pitch_m for corner in (low, high))
        top, bottom = ((self.north_m - corner[1]) / self.pitch_m for corner in (high, low))
        return Window(
            math.floor(top), math.floor(left), math.ceil(bottom) + 1, math.ceil(right) + 1
        ).common(self.whole)
