"""Localization without a map: by the extent of what was visited (section 3).

Told the width and height of the grid, a robot knows its column once its visits span the width, and
its row once they span the height. It takes six counters.
"""

from __future__ import annotations

from missions.lab.localization.neighbourhood import STEP


class Extent:
    """Where a robot is, relative to its first cell, and how far it has been.

    >>> been = Extent(width=2, height=1)
    >>> been.place is None
    True
    >>> been.moved(1)
    >>> been.place
    (0, 0)
    """

    __slots__ = ("_east", "_height", "_high", "_left", "_low", "_north", "_right", "_width")

    def __init__(self, width: int, height: int) -> None:
        self._width, self._height = width, height
        self._east = self._left = self._right = 0
        self._north = self._low = self._high = 0

    def moved(self, direction: int) -> None:
        """Count a move."""
        east, north = STEP[direction]
        self._east += east
        self._north += north
        self._left, self._right = min(self._left, self._east), max(self._right, self._east)
        self._low, self._high = min(self._low, self._north), max(self._high, self._north)

    @property
    def place(self) -> tuple[int, int] | None:
        """Columns from the westernmost cells and rows from the southernmost; None until both are
        known."""
        if self._right - self._left + 1 < self._width or self._high - self._low + 1 < self._height:
            return None
        return self._east - self._left, self._north - self._low
