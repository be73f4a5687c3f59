"""Messages between a flight and a process that shows it, such as that of its page.

A message is two big-endian lengths of 4 bytes, words as a JSON object, and bytes: a picture, mostly
nothing. Lines of JSON come back: orders, which mean the same as the keys and pass the same gate,
guardians and rules, or reports.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import struct
import sys
from collections.abc import Callable
from typing import Any, Final

Words = dict[str, Any]
_HEAD: Final = struct.Struct(">II")
MOST_WORDS_BYTES: Final = 1 << 26
MOST_BYTES: Final = 1 << 28
MOST_LINE_BYTES: Final = 1 << 12
"""A line back is no longer: an order, or why the page does not begin."""
MAP_PATH: Final = "/map.geojson"
"""Where the page's server has the live map for a GIS."""


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


def back() -> Callable[[Words], None]:
    """Return what sends a line to the flight; from now on, prints go to the standard error."""
    out = os.dup(sys.stdout.fileno())
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())

    def send(words: Words) -> None:
        with contextlib.suppress(OSError):
            os.write(out, json.dumps(words).encode() + b"\n")

    return send


async def messages() -> asyncio.StreamReader:
    """Return the reader of the flight's messages, which come by standard input."""
    reader = asyncio.StreamReader(limit=1 << 20)
    loop = asyncio.get_running_loop()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    return reader


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
