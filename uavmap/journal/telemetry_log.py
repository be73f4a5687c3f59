"""flight.tlog: every MAVLink frame of a flight with its time, as ground stations record it.

A record is the time in microseconds since 1970 (big-endian, 8 bytes) and the frame. A disk that
refuses the log never stops a flight: that is reported once, and the log tries again later.
"""

from __future__ import annotations

import contextlib
import errno
import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Final, Self

RETRY_S: Final = 5.0
"""Mission time between two attempts after a failure, s."""


class TlogWriter:
    """Appends frames to a .tlog file, whole records only; reports missing ones at the end."""

    def __init__(
        self,
        path: Path,
        utc_s: Callable[[], float],
        *,
        append: bool = False,
        say: Callable[[str], None] | None = None,
    ) -> None:
        self._path = path
        self._utc_s = utc_s
        self._log = say
        self._file: int | None = None
        self._size = 0
        self._append = append
        self._closed = False
        self._logged = False
        self._retry_s = float("-inf")
        self.lost = 0
        """Number of frames that are not in the file."""

    def __enter__(self) -> Self:
        try:
            self._open()
        except OSError as error:
            self._note_failure(error, self._utc_s())
        return self

    def __exit__(self, *_: object) -> None:
        self._closed = True
        if self._file is not None:
            with contextlib.suppress(OSError):
                os.close(self._file)
        if self.lost and self._log is not None:
            self._log(f"{self._path} lacks {self.lost} frames")

    def record(self, frame: bytes) -> None:
        """Write one frame with the present time. Never raises for an error of the disk."""
        now_s = self._utc_s()
        if self._closed or now_s < self._retry_s:
            self.lost += 1
            return
        try:
            self._open()
            self._write(struct.pack(">Q", round(now_s * 1e6)) + frame)
        except OSError as error:
            self.lost += 1
            self._note_failure(error, now_s)

    def _open(self) -> None:
        if self._file is None:
            flags = os.O_WRONLY | os.O_CREAT | (0 if self._append else os.O_TRUNC)
            self._file = os.open(self._path, flags, 0o666)
            self._size = os.lseek(self._file, 0, os.SEEK_END)
            self._append = True  # after a failure the existing file is kept

    def _write(self, data: bytes) -> None:
        """Write all of the data or nothing, unbuffered: a killed process leaves whole records."""
        assert self._file is not None
        written = os.pwrite(self._file, data, self._size)
        if written < len(data):
            # a full disk writes a part; the next record would follow a torn one
            os.ftruncate(self._file, self._size)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self._size += written

    def _note_failure(self, error: OSError, now_s: float) -> None:
        self._retry_s = now_s + RETRY_S
        if self._log is not None and not self._logged:
            self._logged = True
            self._log(f"{self._path} cannot be written ({error.strerror}); the flight goes on")
