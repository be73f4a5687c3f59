"""Pieces in the pipes to and from MAVSDK's process.

A piece is a letter, a length (4 bytes, little-endian), and data.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from typing import Any, Final

FRAMES: Final = b"F"
"""Bytes of the link."""
JSON_OBJECT: Final = b"W"
"""A JSON object."""
_HEAD: Final = struct.Struct("<cI")
MAX_BYTES: Final = 1 << 20
"""Maximum length of a piece: a longer one is an error of its writer."""


def frames_piece(data: bytes) -> bytes:
    """Return a piece that holds bytes of the link."""
    return _HEAD.pack(FRAMES, len(data)) + data


def object_piece(what: dict[str, Any]) -> bytes:
    """Return a piece that holds an object."""
    data = json.dumps(what).encode()
    return _HEAD.pack(JSON_OBJECT, len(data)) + data


class Pieces:
    """Splits a stream into its pieces."""

    def __init__(self) -> None:
        self._unread = bytearray()

    def feed(self, data: bytes) -> Iterator[tuple[bytes, bytes]]:
        """Yield the pieces, (letter, content), that are whole by now. Raises `ValueError` for
        none."""
        self._unread += data
        while len(self._unread) >= _HEAD.size:
            letter, length = _HEAD.unpack_from(self._unread)
            if letter not in (FRAMES, JSON_OBJECT) or length > MAX_BYTES:
                raise ValueError(f"no piece begins with {bytes(self._unread[: _HEAD.size])!r}")
            end = _HEAD.size + length
            if len(self._unread) < end:
                return
            piece = bytes(self._unread[_HEAD.size : end])
            del self._unread[:end]
            yield letter, piece
