"""The last pictures of a camera over HTTP: GET only, and nothing but them."""

from __future__ import annotations

import asyncio
import contextlib
from collections import OrderedDict
from collections.abc import AsyncIterator
from typing import Final

from missions.errors import LinkError

KEPT_BYTES: Final = 128 * 2**20
KEPT: Final = 400
_MAX_HEAD_BYTES: Final = 16_384
_IDLE_S: Final = 30.0


class PictureStore:
    """The last pictures by their path, such as "/12.jpg"; so many, and so many bytes."""

    def __init__(self) -> None:
        self._pictures: OrderedDict[str, bytes] = OrderedDict()
        self._bytes = 0

    def put(self, path: str, data: bytes) -> None:
        """Keep a picture."""
        self._pictures[path] = data
        self._bytes += len(data)
        while len(self._pictures) > 1 and (self._bytes > KEPT_BYTES or len(self._pictures) > KEPT):
            _, old = self._pictures.popitem(last=False)
            self._bytes -= len(old)

    def get(self, path: str) -> bytes | None:
        """A picture, None where it is not kept (any more)."""
        return self._pictures.get(path)


@contextlib.asynccontextmanager
async def served(store: PictureStore, host: str, port: int) -> AsyncIterator[int]:
    """Serve a store until the end of the context; the port. Raises `LinkError`."""

    async def talk(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(
            TimeoutError, OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError
        ):
            async with asyncio.timeout(_IDLE_S):
                head = await reader.readuntil(b"\r\n\r\n")
                writer.write(_answer(store, head))
                await writer.drain()
        writer.close()

    try:
        server = await asyncio.start_server(talk, host, port, limit=_MAX_HEAD_BYTES)
    except OSError as error:
        raise LinkError(
            f"--serve {host}:{port}: pictures cannot be served there ({error.strerror}); name an "
            "address of this computer and a free port"
        ) from None
    try:
        yield int(server.sockets[0].getsockname()[1])
    finally:
        server.close()


def _answer(store: PictureStore, head: bytes) -> bytes:
    method, _, rest = head.partition(b"\r\n")[0].decode("latin-1").partition(" ")
    path, _, version = rest.partition(" ")
    if not version.startswith("HTTP/1."):
        return _response("400 Bad Request", b"")
    if method != "GET":
        return _response("405 Method Not Allowed", b"")
    data = store.get(path.partition("?")[0])
    return _response("404 Not Found", b"") if data is None else _response("200 OK", data)


def _response(status: str, body: bytes) -> bytes:
    head = (
        f"HTTP/1.1 {status}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(body)}\r\n"
        "Connection: close\r\n\r\n"
    )
    return head.encode("ascii") + body
