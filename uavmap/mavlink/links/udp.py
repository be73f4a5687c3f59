"""UDP links: sockets that are read until they are empty, and whom a link keeps to."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import time
from collections.abc import Callable, Hashable
from typing import Any, Final

from uavmap.mavlink.links.urls import Endpoint

PEER_SILENT_S: Final = 10.0
"""Real seconds of silence after which our vehicle may be heard from another address."""
MOST_STRANGERS: Final = 16
"""How many strangers a link names; of more it says nothing."""
MOST_AT_ONCE: Final = 1000
"""Datagrams that are read in one turn of the loop: a flood must not stop everything else."""
_DATAGRAM_BYTES: Final = 65_535

OnBytes = Callable[[bytes], bool]
"""Takes what was heard; whether our vehicle spoke in it."""
Say = Callable[[str], None]
Address = tuple[str, int]


class Strangers:
    """Who spoke to a link without being its vehicle; each is told of once."""

    def __init__(self, endpoint: Endpoint, say: Say) -> None:
        self._url = endpoint.url
        self._say = say
        self._known: set[Any] = set()

    def tell(self, address: Any, what: str) -> None:
        """Say what somebody did, the first time."""
        if address in self._known or len(self._known) >= MOST_STRANGERS:
            return
        self._known.add(address)
        self._say(f"{self._url}: {_place(address)} {what}")

    def moved(self, before: Any, now: Any) -> None:
        """Say that the vehicle is heard from another address."""
        self._say(f"{self._url}: the vehicle is heard from {_place(now)}, not {_place(before)}")


def _place(address: Any) -> str:
    host, port = address[:2]
    return host if port is None else f"{host} port {port}"


async def bound_socket(host: str, port: int, family: int = 0) -> socket.socket:
    """A UDP socket of an address of this machine. Raises `OSError`."""
    found = await asyncio.get_running_loop().getaddrinfo(
        host, port, family=family, type=socket.SOCK_DGRAM
    )
    kind, _, _, _, address = found[0]
    made = socket.socket(kind, socket.SOCK_DGRAM)
    try:
        made.setblocking(False)
        made.bind(address)
    except OSError:
        made.close()
        raise
    return made


class UdpSocket:
    """A UDP socket that is read until it is empty.

    asyncio takes one datagram a turn of its loop: after a long turn, or several, telemetry of
    seconds ago would be read as if it were of now.
    """

    def __init__(self, made: socket.socket) -> None:
        self._socket = made
        self._loop = asyncio.get_running_loop()

    def deliver_to(self, hear: Callable[[bytes, Address], None]) -> None:
        """Begin to read."""
        self._loop.add_reader(self._socket.fileno(), self._read, hear)

    def _read(self, hear: Callable[[bytes, Address], None]) -> None:
        for _ in range(MOST_AT_ONCE):
            try:
                data, address = self._socket.recvfrom(_DATAGRAM_BYTES)
            except OSError:  # it is empty, or closed
                return
            hear(data, (str(address[0]), int(address[1])))

    def send(self, data: bytes, address: Address) -> None:
        """Send a datagram; one that the system does not take is lost, as on its way."""
        with contextlib.suppress(OSError):
            self._socket.sendto(data, address)

    def close(self) -> None:
        """Stop reading, and give the port back."""
        if self._socket.fileno() >= 0:
            self._loop.remove_reader(self._socket.fileno())
            self._socket.close()


class UdpLink:
    """A UDP link. With a named peer it hears that one and nobody else.

    A listening one keeps to the address from which it first heard the vehicle. Only after a long
    silence does it hear others, and it follows the vehicle to where that speaks from then.
    """

    def __init__(
        self, socket: UdpSocket, on_bytes: OnBytes, strangers: Strangers, named: Address | None
    ) -> None:
        self._socket = socket
        self._on_bytes = on_bytes
        self._strangers = strangers
        self._named = named is not None
        self._peer: Address | None = named
        self._heard_s = float("-inf")

    @property
    def peer_host(self) -> str | None:
        """The address of the host at the other end; None for nobody yet."""
        return None if self._peer is None else self._peer[0]

    @property
    def way(self) -> Hashable:
        """Equal for two that lead over the same socket to the same place."""
        return (id(self._socket), self._peer)

    def hear(self, data: bytes, address: Address) -> None:
        """A datagram came from an address."""
        if address == self._peer:
            if self._on_bytes(data):
                self._heard_s = time.monotonic()
            return
        silent_s = time.monotonic() - self._heard_s
        if self._named or (self._peer is not None and silent_s < PEER_SILENT_S):
            self._strangers.tell(address, "speaks too, and is not heard")
            return
        if self._on_bytes(data):
            if self._peer is not None:
                self._strangers.moved(self._peer, address)
            self._peer, self._heard_s = address, time.monotonic()

    def send(self, data: bytes) -> None:
        """Send to the peer, or drop where there is none yet."""
        if self._peer is not None:
            self._socket.send(data, self._peer)
