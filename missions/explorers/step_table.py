"""Steps between sites over known cells, kept from one decision to the next.

From one decision to the next a few cells come to be known, and a few sites come or go. To count the
steps from every site to every cell anew each time takes the number of sites times that of cells; to
bring up to date what was counted takes little more than the number of sites.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from missions.units import Cell

_SPARE_SLOTS, _SPARE_COLUMNS, _SPARE_ROWS = 64, 32, 8
_MANY = 8
"""When more than one in so many cells came or went, all is counted anew."""


class StepTable:
    """A memo: what it answers depends on the question only, how soon also on the last ones.

    So it may be shared by the memories of decisions that follow from one another, and need not
    be compared.

    >>> row = np.array([6, 7, 8], np.int32)  # in a picture of 5 x 3 cells
    >>> StepTable().between(Cell(0, 0), 5, 3, row, np.array([0, 2], np.int32)).tolist()
    [[0.0, 2.0], [2.0, 0.0]]
    """

    def __init__(self) -> None:
        self._corner, self._width, self._height = Cell(0, 0), 0, 0
        self._frame = np.empty(0, np.int32)
        self._near = np.empty((0, 4), np.int32)
        self._present = np.empty(0, np.bool_)
        self._source = np.empty(0, np.int32)
        self._steps = np.empty((0, 0), np.int32)
        self._count = 0
        self._columns: dict[int, int] = {}  # by slot of their source
        self._free: list[int] = []

    def between(
        self,
        corner: Cell,
        width: int,
        height: int,
        cells: NDArray[np.int32],
        sites: NDArray[np.int32],
    ) -> NDArray[np.float64]:
        """Steps from site to site.

        Args:
            corner: the cell of the first place of a picture.
            width: columns of the picture.
            height: rows of the picture.
            cells: places of the known cells in the picture, row by row; none in its outermost rows
                and columns.
            sites: which of these are sites, by number.
        """
        # numba takes a second to import, so the kernels are imported where they are needed
        from missions.kernels import steps as kernels  # noqa: PLC0415

        slots = self._located(corner, width, height, cells, len(sites))
        sources = slots[sites]
        self._keep(sources.tolist(), slots)
        columns = np.array([self._columns[slot] for slot in sources.tolist()], np.int32)
        legs: NDArray[np.float64] = kernels.between(self._steps, sources, columns)
        return legs

    def _located(
        self, corner: Cell, width: int, height: int, cells: NDArray[np.int32], sites: int
    ) -> NDArray[np.int32]:
        """The slots of the known cells; where there is no room the table is begun anew."""
        from missions.kernels import steps as kernels  # noqa: PLC0415, as above

        east, north = corner.east - self._corner.east, corner.north - self._corner.north
        fits = (
            0 <= east <= self._width - width
            and 0 <= north <= self._height - height
            and sites <= self._source.size
        )
        if fits:
            shift = north * self._width + east
            slots, count = kernels.locate(
                cells, width, shift, self._frame, self._width, self._near, self._count
            )
            if count >= 0:
                self._count = count
                return slots
        self._begin(corner, width, height, len(cells), sites)
        return self._located(corner, width, height, cells, sites)

    def _begin(self, corner: Cell, width: int, height: int, cells: int, sites: int) -> None:
        """An empty table, with room for twice as much as is known."""
        spare_east, spare_north = width // 2 + _SPARE_ROWS, height // 2 + _SPARE_ROWS
        self._corner = Cell(corner.east - spare_east, corner.north - spare_north)
        self._width, self._height = width + 2 * spare_east, height + 2 * spare_north
        self._frame = np.full(self._width * self._height, -1, np.int32)
        room, columns = 2 * cells + _SPARE_SLOTS, sites + sites // 2 + _SPARE_COLUMNS
        self._near = np.full((room, 4), -1, np.int32)
        self._present = np.zeros(room, np.bool_)
        self._source = np.full(columns, -1, np.int32)
        self._steps = np.empty((room, columns), np.int32)
        self._count = 0
        self._columns, self._free = {}, list(range(columns))

    def _keep(self, sources: Iterable[int], slots: NDArray[np.int32]) -> None:
        """Bring the table up to date: the region is what is at `slots`, with a column for each of
        `sources` and for nothing else."""
        from missions.kernels import steps as kernels  # noqa: PLC0415, as above

        wanted = dict.fromkeys(sources)
        now = np.zeros_like(self._present)
        now[slots] = True
        lost = np.flatnonzero(self._present & ~now).astype(np.int32)
        found = np.flatnonzero(now & ~self._present).astype(np.int32)
        anew = _MANY * (len(lost) + len(found)) > len(slots)
        for slot in [s for s in self._columns if anew or s not in wanted]:
            column = self._columns.pop(slot)
            self._source[column] = -1
            self._free.append(column)
        table = self._steps, self._near, self._present, self._source
        if anew:
            self._present[:] = now
        else:
            kernels.remove(*table, lost)
            kernels.add(*table, found)
        fresh = []
        for slot in wanted:
            if slot not in self._columns:
                column = self._free.pop()
                self._columns[slot] = column
                self._source[column] = slot
                fresh.append(column)
        kernels.spread(*table, np.array(fresh, np.int32), self._count)
