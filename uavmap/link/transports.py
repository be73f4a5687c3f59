"""Bytes to and from a vehicle. What they mean is the session's business.

Every transport hands what it hears to `on_bytes` from the event loop and never blocks the reader:
an ArduPilot simulation freezes when its TCP client stops reading.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Callable
from typing import Any, Final, Protocol, cast

import serial

from missions.errors import LinkError
from uavmap.link.urls import Endpoint

PEER_SILENT_S: Final = 3.0
"""Real seconds after which somebody else may take a silent peer's place."""

OnBytes = Callable[[bytes], None]


class Transport(Protocol):
    """One open link."""

    def send(self, data: bytes) -> None:
        """Send, or drop where nobody listens."""
        ...


@contextlib.asynccontextmanager
async def open_transport(endpoint: Endpoint, on_bytes: OnBytes) -> AsyncIterator[Transport]:
    """Open the transport that an endpoint names, and close it at the end.

    Raises `LinkError` where it cannot be opened.
    """
    opener = {
        "udpin": _open_udp,
        "udpout": _open_udp,
        "tcpin": _open_tcp_server,
        "tcpout": _open_tcp_client,
        "serial": _open_serial,
    }[endpoint.transport]
    try:
        transport, close = await opener(endpoint, on_bytes)
    except (OSError, ValueError, OverflowError) as error:  # the last two for a baud rate
        raise LinkError(f"{endpoint.url} cannot be opened: {error}") from None
    try:
        yield transport
    finally:
        close()
        await asyncio.sleep(0)  # let the loop drop the file before it closes


_Opened = tuple[Transport, Callable[[], None]]


class _Udp(asyncio.DatagramProtocol):
    """A UDP socket. A listening one keeps to the first that speaks, until that falls silent."""

    def __init__(self, on_bytes: OnBytes, peer: tuple[str, int] | None) -> None:
        self._on_bytes = on_bytes
        self._peer: Any = peer
        self._heard_s = float("-inf")
        self._transport: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.DatagramTransport, transport)

    def datagram_received(self, data: bytes, addr: Any) -> None:
        now_s = time.monotonic()
        if addr != self._peer and now_s - self._heard_s < PEER_SILENT_S:
            return  # a second sender on this port; two vehicles must not be taken for one
        self._peer, self._heard_s = addr, now_s
        self._on_bytes(data)

    def send(self, data: bytes) -> None:
        if self._transport is not None and self._peer is not None:
            self._transport.sendto(data, self._peer)


async def _open_udp(endpoint: Endpoint, on_bytes: OnBytes) -> _Opened:
    loop = asyncio.get_running_loop()
    address = (endpoint.host, endpoint.port)
    if endpoint.transport == "udpin":
        transport, udp = await loop.create_datagram_endpoint(
            lambda: _Udp(on_bytes, None), local_addr=address
        )
    else:
        family, _, _, _, peer = (await loop.getaddrinfo(*address))[0]
        wildcard = ("::" if len(peer) == 4 else "0.0.0.0", 0)
        transport, udp = await loop.create_datagram_endpoint(
            lambda: _Udp(on_bytes, (str(peer[0]), int(peer[1]))), local_addr=wildcard, family=family
        )
    return udp, transport.close


class _Tcp(asyncio.Protocol):
    """A TCP connection; a server keeps the latest client."""

    def __init__(self, on_bytes: OnBytes) -> None:
        self._on_bytes = on_bytes
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.close()
        self._transport = cast(asyncio.Transport, transport)

    def data_received(self, data: bytes) -> None:
        self._on_bytes(data)

    def send(self, data: bytes) -> None:
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(data)

    def close(self) -> None:
        if self._transport is not None:
            self._transport.abort()


async def _open_tcp_client(endpoint: Endpoint, on_bytes: OnBytes) -> _Opened:
    loop = asyncio.get_running_loop()
    _, tcp = await loop.create_connection(lambda: _Tcp(on_bytes), endpoint.host, endpoint.port)
    return tcp, tcp.close


async def _open_tcp_server(endpoint: Endpoint, on_bytes: OnBytes) -> _Opened:
    loop = asyncio.get_running_loop()
    tcp = _Tcp(on_bytes)
    server = await loop.create_server(lambda: tcp, endpoint.host, endpoint.port)

    def close() -> None:
        server.close()
        tcp.close()

    return tcp, close


class _Serial:
    """A serial port, read when the loop says that there is something to read."""

    def __init__(self, port: serial.Serial) -> None:
        self._port = port

    def send(self, data: bytes) -> None:
        # full, or unplugged: the session will miss the heartbeats
        with contextlib.suppress(serial.SerialException):
            self._port.write(data)


async def _open_serial(endpoint: Endpoint, on_bytes: OnBytes) -> _Opened:
    loop = asyncio.get_running_loop()
    port = serial.Serial(endpoint.host, endpoint.port, timeout=0, write_timeout=0.2)

    def read() -> None:
        try:
            data = port.read(4096)
        except serial.SerialException:  # unplugged: the session will miss the heartbeats
            loop.remove_reader(port.fileno())
            return
        if data:
            on_bytes(data)

    loop.add_reader(port.fileno(), read)

    def close() -> None:
        loop.remove_reader(port.fileno())
        port.close()

    return _Serial(port), close
