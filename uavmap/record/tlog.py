"""flight.tlog: every MAVLink frame of a flight with its time, as ground stations record it.

A record is the time in microseconds since 1970 (big-endian, 8 bytes) and the frame.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Self


class TlogWriter:
    """Appends frames to a .tlog file."""

    def __init__(self, path: Path, utc_s: Callable[[], float], *, append: bool = False) -> None:
        # unbuffered: a killed process leaves whole records, and a resume appends to them
        self._file = path.open("ab" if append else "wb", buffering=0)
        self._utc_s = utc_s

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def record(self, frame: bytes) -> None:
        """Write one frame with the time now."""
        self._file.write(struct.pack(">Q", round(self._utc_s() * 1e6)) + frame)
