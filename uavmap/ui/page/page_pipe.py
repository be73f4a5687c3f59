"""Messages between a flight and the process of its page.

A message is two big-endian lengths of 4 bytes, words as a JSON object, and bytes: a picture, mostly
nothing. Orders come back as lines of JSON; they mean the same as the keys, and pass the same gate,
guardians and rules.
"""

from __future__ import annotations

import asyncio
import json
import struct
from typing import Any, Final

Words = dict[str, Any]
_HEAD: Final = struct.Struct(">II")
MOST_WORDS_BYTES: Final = 1 << 26
MOST_BYTES: Final = 1 << 28
MOST_LINE_BYTES: Final = 1 << 12
"""A line back is no longer: an order, or why the page does not begin."""


def packed(words: Words, data: bytes = b"") -> bytes:
    """A message.

    >>> packed({"kind": "over"})
    b'\\x00\\x00\\x00\\x0f\\x00\\x00\\x00\\x00{"kind":"over"}'
    """
    text = json.dumps(words, separators=(",", ":")).encode()
    return _HEAD.pack(len(text), len(data)) + text + data


async def read(reader: asyncio.StreamReader) -> tuple[Words, bytes]:
    """Return the next message. Raises `asyncio.IncompleteReadError`, `ValueError`."""
    words_bytes, data_bytes = _HEAD.unpack(await reader.readexactly(_HEAD.size))
    if words_bytes > MOST_WORDS_BYTES or data_bytes > MOST_BYTES:
        raise ValueError("no message of a flight")
    words = json.loads(await reader.readexactly(words_bytes))
    if not isinstance(words, dict):
        raise ValueError("no message of a flight")
    return words, await reader.readexactly(data_bytes)


class Lines:
    """Lines of JSON out of pieces; what is none, or too long, is left out.

    >>> lines = Lines()
    >>> lines.of(b'{"do": "pa'), lines.of(b'use"}' + bytes([10]))
    ([], [{'do': 'pause'}])
    """

    def __init__(self) -> None:
        self._left = b""

    def of(self, piece: bytes) -> list[Words]:
        """The objects that are complete with this piece."""
        *whole, left = (self._left + piece).split(b"\n")
        self._left = left[:MOST_LINE_BYTES]
        found = []
        for line in whole:
            try:
                words = json.loads(line) if len(line) < MOST_LINE_BYTES else None
            except ValueError:
                words = None
            if isinstance(words, dict):
                found.append(words)
        return found
