"""Bytes on disk while a set of pictures is processed, in a file without a name."""

from __future__ import annotations

import contextlib
import pickle
import tempfile
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from missions.classes import ClassShare
from missions.errors import OutputError
from missions.units import Cell
from vision.registration.views import Features


class ScratchFile:
    """A file that vanishes with this object; for any thread.

    Every call raises `OutputError` if the disk refuses. The error names the content, `waits`, and
    `remedy`, which helps besides more room.
    """

    def __init__(self, waits: str, remedy: str) -> None:
        self._waits, self._remedy = waits, remedy
        self._end = 0
        self._one_at_a_time = threading.Lock()
        with self._refusals():
            self._file = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115 - see __exit__

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def append(self, *parts: bytes) -> int:
        """Keep bytes; return their offset."""
        with self._one_at_a_time, self._refusals():
            offset = self._end
            self._file.seek(offset)
            rest = memoryview(b"".join(parts))
            self._end += len(rest)
            while rest:
                rest = rest[self._file.write(rest) :]
            return offset

    def read(self, offset: int, length: int) -> bytes:
        """Return kept bytes."""
        with self._one_at_a_time, self._refusals():
            self._file.seek(offset)
            return self._file.read(length)

    @contextlib.contextmanager
    def _refusals(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise OutputError(
                f"{self._waits} in a file in the folder for temporary files, which cannot be "
                f"written ({error.strerror}); make room there, {self._remedy}"
            ) from None


class StoredJudgement(NamedTuple):
    """The judgement of a picture.

    Attributes:
        vantage: The cell over which its votes count.
        cells: Shape (n, 2): columns and rows of the cells in the picture.
        shares: Shape (n,): the part of each that is ROI; -1 if it is not in the picture.
        marks: The detector's marks, packed.
        weights: Shape (n,): weights of the shares, 0 to 1; 1 if votes are counted.
        small: A JPEG of the picture, small.
        unsure: Shape (n,): True for a cell unlike all that the detector knows.
        unfamiliar: Pixels unlike all that it knows, packed; empty for a detector without examples.
        unlike: Features of some of them, (places, features).
        numbers: Numbers of the classes in the picture.
        classes: The share of each class in the cells, (n, classes).
        class_marks: The number of each pixel's class, packed; empty without classes.
    """

    vantage: Cell
    cells: NDArray[np.intp]
    shares: NDArray[np.float64]
    marks: bytes
    weights: NDArray[np.float64]
    small: bytes
    unsure: NDArray[np.bool_]
    unfamiliar: bytes = b""
    unlike: NDArray[np.float32] | None = None
    numbers: tuple[int, ...] = ()
    classes: NDArray[np.float64] | None = None
    class_marks: bytes = b""

    def class_shares(self, some: NDArray[np.bool_]) -> tuple[ClassShare, ...]:
        """Return the shares of classes in some of the cells, those above 0, with three digits."""
        if self.classes is None:
            return ()
        shares = self.classes.round(3)
        at, column = np.nonzero((shares > 0.0) & some[:, None])
        numbers = np.array(self.numbers, np.intp)[column].tolist()
        rows = zip(self.cells[at].tolist(), numbers, shares[at, column].tolist(), strict=True)
        return tuple(ClassShare(Cell(*cell), number, share) for cell, number, share in rows)


class Spool(ScratchFile):
    """Judgements of pictures by number, in a file that vanishes with this object; for any thread.

    >>> cells, weights, unsure = np.array([[1, 2]]), np.array([0.7]), np.array([False])
    >>> stored = StoredJudgement(
    ...     Cell(0, 0), cells, np.array([0.5]), b"marks", weights, b"", unsure
    ... )
    >>> with Spool() as spool:
    ...     spool.put(7, stored)
    ...     found = spool.get(7)
    >>> found.cells.tolist(), found.shares.tolist(), found.marks
    ([[1, 2]], [0.5], b'marks')
    """

    def __init__(self) -> None:
        super().__init__("judgements of pictures wait", "or set TMPDIR to another folder")
        self._kept: dict[int, tuple[int, int]] = {}

    def put(self, number: int, stored: StoredJudgement) -> None:
        """Keep a judgement, or replace it. Raises `OutputError` on a full disk."""
        data = pickle.dumps(stored)
        self._kept[number] = self.append(data), len(data)

    def get(self, number: int) -> StoredJudgement:
        """Return the judgement of a number. Raises `KeyError` if there is none."""
        stored: StoredJudgement = pickle.loads(self.read(*self._kept[number]))
        return stored


_WORDS: int = 128


class FeatureFile(ScratchFile):
    """Features in a file that vanishes with this object; for any thread."""

    def __init__(self) -> None:
        remedy = "set TMPDIR to another folder, or replay with --refine off"
        super().__init__("features of pictures wait", remedy)

    def put(self, features: Features) -> KeptFeatures:
        """Keep features; raises `OutputError` on a full disk."""
        points = features.points.astype(np.float64).tobytes()
        offset = self.append(points, features.descriptors.tobytes())
        size = features.width_px, features.height_px
        return KeptFeatures(self, offset, len(features.points), *size)


@dataclass(frozen=True, slots=True)
class KeptFeatures:
    """`Features` that are read from the file at each access."""

    file: FeatureFile
    offset: int
    count: int
    width_px: int
    height_px: int

    @property
    def points(self) -> NDArray[np.float64]:
        """See `Features.points`."""
        return np.frombuffer(self.file.read(self.offset, 16 * self.count)).reshape(-1, 2)

    @property
    def descriptors(self) -> NDArray[np.uint8]:
        """See `Features.descriptors`."""
        data = self.file.read(self.offset + 16 * self.count, _WORDS * self.count)
        return np.frombuffer(data, np.uint8).reshape(-1, _WORDS)
