"""Messages between a flight and a process that shows it, such as that of its page.

A message has two big-endian lengths of 4 bytes, a JSON object, and bytes, such as a picture. The
process sends lines of JSON: reports, or orders. Orders mean the same as the keys, and pass the same
gate, guardians and rules.
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

Message = dict[str, Any]
"""The JSON object of a message."""
_HEAD: Final = struct.Struct(">II")
MAX_JSON_BYTES: Final = 1 << 26
MAX_BYTES: Final = 1 << 28
MAX_LINE_BYTES: Final = 1 << 12
"""Maximum length of a line from the process, bytes."""
MAP_PATH: Final = "/map.geojson"
"""Path of the live map for a GIS at the page's server."""


def packed(message: Message, data: bytes = b"") -> bytes:
    """Encode a message.
    >>> packed({"kind": "over"})
    b'\\x00\\x00\\x00\\x0f\\x00\\x00\\x00\\x00{"kind":"over"}'
    """
    text = json.dumps(message, separators=(",", ":")).encode()
    return _HEAD.pack(len(text), len(data)) + text + data


async def read(reader: asyncio.StreamReader) -> tuple[Message, bytes]:
    """Return the next message. Raises `asyncio.IncompleteReadError`, `ValueError`."""
    json_bytes, data_bytes = _HEAD.unpack(await reader.readexactly(_HEAD.size))
    if json_bytes > MAX_JSON_BYTES or data_bytes > MAX_BYTES:
        raise ValueError("not a message of a flight: too long")
    message = json.loads(await reader.readexactly(json_bytes))
    if not isinstance(message, dict):
        raise ValueError("not a message of a flight: not a JSON object")
    return message, await reader.readexactly(data_bytes)


def back() -> Callable[[Message], None]:
    """Return the function that sends a line to the flight; prints now go to standard error."""
    out = os.dup(sys.stdout.fileno())
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())

    def send(message: Message) -> None:
        with contextlib.suppress(OSError):
            os.write(out, json.dumps(message).encode() + b"\n")

    return send


async def messages() -> asyncio.StreamReader:
    """Return the reader of the flight's messages from standard input."""
    reader = asyncio.StreamReader(limit=1 << 20)
    loop = asyncio.get_running_loop()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    return reader


class Lines:
    """Lines of JSON from pieces; other lines, and those that are too long, are dropped.

    >>> lines = Lines()
    >>> lines.parse(b'{"do": "pa'), lines.parse(b'use"}' + bytes([10]))
    ([], [{'do': 'pause'}])
    """

    def __init__(self) -> None:
        self._left = b""

    def parse(self, piece: bytes) -> list[Message]:
        """Return the objects that are complete with this piece."""
        *whole, left = (self._left + piece).split(b"\n")
        self._left = left[:MAX_LINE_BYTES]
        found = []
        for line in whole:
            try:
                message = json.loads(line) if len(line) < MAX_LINE_BYTES else None
            except (ValueError, RecursionError):
                message = None
            if isinstance(message, dict):
                found.append(message)
        return found
