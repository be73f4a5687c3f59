"""What pictures say, kept on disk until all of them have been seen."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from missions.units import Cell
from uavmap.photos.scratch_file import ScratchFile


class Said(NamedTuple):
    """What a picture says; see `uavmap.photos.ground.judging.Judged`."""

    vantage: Cell
    cells: NDArray[np.intp]
    shares: NDArray[np.float64]
    marks: bytes
    weights: NDArray[np.float64]
    small: bytes = b""


class _Kept(NamedTuple):
    offset: int
    cells: int
    marks: int
    small: int
    vantage: Cell


class Spool(ScratchFile):
    """What pictures say by a number, in a file that vanishes with this object; for any thread.

    >>> said = Said(Cell(0, 0), np.array([[1, 2]]), np.array([0.5]), b"marks", np.array([0.7]))
    >>> with Spool() as spool:
    ...     spool.put(7, said)
    ...     found = spool.get(7)
    >>> found.cells.tolist(), found.shares.tolist(), found.marks
    ([[1, 2]], [0.5], b'marks')
    """

    def __init__(self) -> None:
        super().__init__("what pictures say waits", "or have TMPDIR name another folder")
        self._kept: dict[int, _Kept] = {}

    def put(self, number: int, said: Said) -> None:
        """Keep what a picture says; it may be told anew. Raises `OutputError` on a full disk."""
        cells = np.ascontiguousarray(said.cells, dtype=np.int32).tobytes()
        shares, weights = (
            np.ascontiguousarray(numbers, dtype=np.float64).tobytes()
            for numbers in (said.shares, said.weights)
        )
        offset = self.append(cells, shares, weights, said.marks, said.small)
        sizes = len(said.cells), len(said.marks), len(said.small)
        self._kept[number] = _Kept(offset, *sizes, said.vantage)

    def get(self, number: int) -> Said:
        """What was kept under a number. Raises `KeyError` where nothing was."""
        offset, count, marks, small, vantage = self._kept[number]
        data = self.read(offset, 24 * count + marks + small)
        cells = np.frombuffer(data, np.int32, 2 * count).reshape(count, 2).astype(np.intp)
        shares, weights = (np.frombuffer(data, np.float64, count, 8 * count * k) for k in (1, 2))
        end = 24 * count + marks
        return Said(vantage, cells, shares, data[24 * count : end], weights, data[end:])
