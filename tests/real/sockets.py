"""UDP sockets of this computer."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import Callable
from typing import Any, Final, TypeAlias, cast

Address: TypeAlias = tuple[str, int]
LOOPBACK: Final = "127.0.0.1"
_KEPT_BYTES: Final = 1 << 20
"""Size of the receive buffer, bytes: a busy computer that reads late loses no frame."""


class Socket(asyncio.DatagramProtocol):
    """A socket that passes each datagram to a function."""

    def __init__(self, take: Callable[[bytes, Address], None]) -> None:
        self._take = take
        self._transport: asyncio.DatagramTransport | None = None

    async def open(self, port: int = 0) -> None:
        one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _KEPT_BYTES)
        one.setblocking(False)
        one.bind((LOOPBACK, port))
        await asyncio.get_running_loop().create_datagram_endpoint(lambda: self, sock=one)

    def close(self) -> None:
        if self._transport is not None:
            self._transport.close()

    def send(self, data: bytes, address: Address) -> None:
        if self._transport is not None and not self._transport.is_closing():
            self._transport.sendto(data, address)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.DatagramTransport, transport)

    def datagram_received(self, data: bytes, addr: tuple[str | Any, int]) -> None:
        self._take(data, addr)

    def error_received(self, exc: Exception) -> None:
        """Ignore a missing listener: a program was killed, or has not begun."""


def is_free(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one, contextlib.suppress(OSError):
        one.bind((LOOPBACK, port))
        return True
    return False
