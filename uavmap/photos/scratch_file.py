"""Bytes that wait on disk while a set of pictures is worked on, in a file without a name."""

from __future__ import annotations

import contextlib
import tempfile
import threading
from collections.abc import Iterator
from typing import Self

from missions.errors import OutputError


class ScratchFile:
    """A file that vanishes with this object; for any thread.

    Every call raises `OutputError` where the disk refuses: `waits` is what is in the file,
    `remedy` what helps besides more room.
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
        """Keep bytes; returns where they begin."""
        with self._one_at_a_time, self._refusals():
            offset = self._end
            self._file.seek(offset)
            rest = memoryview(b"".join(parts))
            self._end += len(rest)
            while rest:
                rest = rest[self._file.write(rest) :]
            return offset

    def read(self, offset: int, length: int) -> bytes:
        """Return bytes that were kept."""
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
