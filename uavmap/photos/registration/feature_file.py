"""Features of pictures, kept on disk while a set is registered: they are most of its memory."""

from __future__ import annotations

import contextlib
import tempfile
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import IO, Self

import numpy as np
from numpy.typing import NDArray

from missions.errors import OutputError
from vision.registration import Features

_WORDS: int = 128


@contextlib.contextmanager
def _told() -> Iterator[None]:
    """What the disk refuses, as a line for people."""
    try:
        yield
    except OSError as error:
        raise OutputError(
            "features of pictures wait in a file in the folder for temporary files, which cannot "
            f"be written ({error.strerror}); make room there, have TMPDIR name another folder, or "
            "replay with --refine off"
        ) from None


def _temporary() -> IO[bytes]:
    with _told():
        return tempfile.TemporaryFile(buffering=0)


@dataclass(slots=True)
class FeatureFile:
    """Features in a file that vanishes with this object; for any thread.

    >>> some = Features(np.array([[1.5, 2.0]]), np.full((1, 128), 7, np.uint8), 320, 240)
    >>> with FeatureFile() as file:
    ...     kept = file.put(some)
    ...     kept.points.tolist(), int(kept.descriptors.sum()), kept.width_px
    ([[1.5, 2.0]], 896, 320)
    """

    _file: IO[bytes] = field(default_factory=_temporary)
    _end: int = 0
    _one_at_a_time: threading.Lock = field(default_factory=threading.Lock)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def put(self, features: Features) -> KeptFeatures:
        """Keep features; raises `OutputError` on a full disk."""
        data = features.points.astype(np.float64).tobytes() + features.descriptors.tobytes()
        with self._one_at_a_time, _told():
            offset = self._end
            self._file.seek(offset)
            rest = memoryview(data)
            while rest:
                rest = rest[self._file.write(rest) :]
            self._end += len(data)
        size = features.width_px, features.height_px
        return KeptFeatures(self, offset, len(features.points), *size)

    def read(self, offset: int, length: int) -> bytes:
        """Bytes of the file."""
        with self._one_at_a_time, _told():
            self._file.seek(offset)
            return self._file.read(length)


@dataclass(frozen=True, slots=True)
class KeptFeatures:
    """`Features` that are read whenever they are asked for."""

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
