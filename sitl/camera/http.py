"""The announced pictures over HTTP/1.1, GET only, on the loopback interface.

A small asyncio server instead of one in a thread: it runs between two steps of the vehicles, so a
picture is looked up and rendered without a lock.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

_MAX_HEADER_BYTES = 16_384
_IDLE_S = 30.0


class PictureServer:
    """Serves what `find(path)` returns; `path` begins with a slash."""

    def __init__(self, find: Callable[[str], bytes | None]) -> None:
        self._find = find
        self._server: asyncio.Server | None = None
        self._writers: set[asyncio.StreamWriter] = set()
        self._talks: set[asyncio.Task[None]] = set()

    async def open(self, port: int) -> int:
        """Listen on 127.0.0.1; port 0 takes any free one. Returns the port."""
        self._server = await asyncio.start_server(
            self._talk, "127.0.0.1", port, limit=_MAX_HEADER_BYTES
        )
        return int(self._server.sockets[0].getsockname()[1])

    async def close(self) -> None:
        """Close the listening socket and every connection."""
        if self._server is None:
            return
        self._server.close()
        for writer in list(self._writers):
            writer.close()
        await self._server.wait_closed()
        if self._talks:  # they end by themselves now that their connections are closed
            await asyncio.wait(self._talks)

    async def _talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.add(writer)
        if (task := asyncio.current_task()) is not None:
            self._talks.add(task)
            task.add_done_callback(self._talks.discard)
        try:
            while await self._answer(reader, writer):
                pass
        except (
            TimeoutError,
            ConnectionError,
            asyncio.IncompleteReadError,
            asyncio.LimitOverrunError,
        ):
            pass  # the other side is gone, silent, or speaks no HTTP: only its connection ends
        finally:
            self._writers.discard(writer)
            writer.close()

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bool:
        """One request and its response; whether the connection stays open."""
        async with asyncio.timeout(_IDLE_S):
            head = await reader.readuntil(b"\r\n\r\n")
        lines = head.decode("latin-1").split("\r\n")
        words = lines[0].split(" ")
        headers = {
            name.strip().lower(): value.strip().lower()
            for name, _, value in (line.partition(":") for line in lines[1:])
        }
        if len(words) != 3 or not words[2].startswith("HTTP/1."):
            writer.write(_response("400 Bad Request", b"", "close"))
            return False
        # a body would be read as the next request: such a connection ends here
        keep = words[2] == "HTTP/1.1" and headers.get("connection") != "close"
        keep = keep and headers.get("content-length", "0") == "0"
        keep = keep and "transfer-encoding" not in headers
        connection = "keep-alive" if keep else "close"
        if words[0] not in ("GET", "HEAD"):
            writer.write(_response("405 Method Not Allowed", b"", connection))
        else:
            data = self._find(words[1].partition("?")[0])
            if data is None:
                writer.write(_response("404 Not Found", b"", connection))
            else:
                writer.write(_response("200 OK", data, connection, words[0] == "HEAD"))
        await writer.drain()
        return keep


def _response(status: str, body: bytes, connection: str, head_only: bool = False) -> bytes:
    head = (
        f"HTTP/1.1 {status}\r\n"
        "Content-Type: image/jpeg\r\n"
        f"Content-Length: {len(body)}\r\n"
        f"Connection: {connection}\r\n\r\n"
    )
    return head.encode("ascii") + (b"" if head_only else body)
