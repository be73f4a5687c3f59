"""What pictures say, kept on disk until all of them have been seen."""

from __future__ import annotations

import contextlib
import tempfile
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import IO, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from missions.errors import OutputError
from missions.units import Cell


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


@contextlib.contextmanager
def _told() -> Iterator[None]:
    """What the disk refuses, as a line for people."""
    try:
        yield
    except OSError as error:
        raise OutputError(
            f"what pictures say waits in a file in the folder for temporary files, which cannot be "
            f"written ({error.strerror}); make room there, or have TMPDIR name another folder"
        ) from None


def _temporary() -> IO[bytes]:
    with _told():
        return tempfile.TemporaryFile()


@dataclass(slots=True)
class Spool:
    """What pictures say by a number, in a file that vanishes with this object; for any thread.

    >>> said = Said(Cell(0, 0), np.array([[1, 2]]), np.array([0.5]), b"marks", np.array([0.7]))
    >>> with Spool() as spool:
    ...     spool.put(7, said)
    ...     found = spool.get(7)
    >>> found.cells.tolist(), found.shares.tolist(), found.marks
    ([[1, 2]], [0.5], b'marks')
    """

    _file: IO[bytes] = field(default_factory=_temporary)
    _kept: dict[int, _Kept] = field(default_factory=dict)
    _one_at_a_time: threading.Lock = field(default_factory=threading.Lock)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(OSError):  # the buffer of a full disk; nobody wants it any more
            self._file.close()

    def put(self, number: int, said: Said) -> None:
        """Keep what a picture says; it may be told anew. Raises `OutputError` on a full disk."""
        with self._one_at_a_time, _told():
            offset = self._file.seek(0, 2)
            self._file.write(np.ascontiguousarray(said.cells, dtype=np.int32).tobytes())
            for numbers in (said.shares, said.weights):
                self._file.write(np.ascontiguousarray(numbers, dtype=np.float64).tobytes())
            self._file.write(said.marks)
            self._file.write(said.small)
        sizes = len(said.cells), len(said.marks), len(said.small)
        self._kept[number] = _Kept(offset, *sizes, said.vantage)

    def get(self, number: int) -> Said:
        """What was kept under a number. Raises `KeyError` where nothing was."""
        offset, count, marks, small, vantage = self._kept[number]
        with self._one_at_a_time, _told():
            self._file.seek(offset)  # what waits in the buffer goes to the disk
            places = self._file.read(8 * count)
            shares, weights = (np.frombuffer(self._file.read(8 * count), np.float64) for _ in "12")
            kept = self._file.read(marks), weights, self._file.read(small)
        cells = np.frombuffer(places, np.int32).reshape(count, 2)
        return Said(vantage, cells.astype(np.intp), shares, *kept)
