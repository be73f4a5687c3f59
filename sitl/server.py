"""Simulated vehicles on real loopback sockets, in real time or at a speed-up.

Each vehicle has one UDP socket that sends to a port where a client listens (what MAVSDK calls
`udpin://127.0.0.1:14550`), and also to whoever else has spoken to it.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Sequence
from typing import cast
from urllib.parse import urlsplit

from sitl.pictures import PictureServer
from sitl.vehicle import SimVehicle

LOOPBACK = "127.0.0.1"
PORTS_BETWEEN_VEHICLES = 10

_STEP_S = 0.05
_TICK_S = 0.01  # how often to look whether a step is due
_BURST_S = 0.1  # wall time of stepping before the sockets get their turn
_MAX_DATAGRAM = 1400
_MAX_OTHERS = 7

Address = tuple[str, int]


class VehicleLink(asyncio.DatagramProtocol):
    """The UDP end of one vehicle."""

    def __init__(self, vehicle: SimVehicle, client: Address) -> None:
        self._vehicle = vehicle
        self._listener = client
        self._others: dict[Address, None] = {}  # who spoke last comes last
        self._transport: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the socket (asyncio)."""
        self._transport = cast(asyncio.DatagramTransport, transport)

    def datagram_received(self, data: bytes, addr: Address) -> None:
        """A client speaks; it is heard, and told from now on (asyncio)."""
        if addr != self._listener:
            self._others.pop(addr, None)
            self._others[addr] = None
            if len(self._others) > _MAX_OTHERS:
                del self._others[next(iter(self._others))]
        self.send(self._vehicle.receive(data))

    def error_received(self, exc: Exception) -> None:
        """Nobody listens at the other end (asyncio): a link that is down, nothing more."""

    def send(self, data: bytes) -> None:
        """To every client, in datagrams of whole frames."""
        if self._transport is None or not data:
            return
        for datagram in _datagrams(data):
            for client in (self._listener, *self._others):
                self._transport.sendto(datagram, client)


def _datagrams(data: bytes) -> list[bytes]:
    """Cut at frame borders: a frame never spans two datagrams."""
    datagrams, start, at = [], 0, 0
    while at < len(data):
        size = data[at + 1] + 12  # MAVLink 2, unsigned: what the vehicles send
        if at + size - start > _MAX_DATAGRAM and at > start:
            datagrams.append(data[start:at])
            start = at
        at += size
    datagrams.append(data[start:])
    return datagrams


async def serve(
    vehicles: Sequence[SimVehicle],
    *,
    speedup: float = 1.0,
    base_port: int = 14550,
    http_port: int,
    on_ready: Callable[[list[str]], None],
) -> None:
    """Fly `vehicles` on loopback sockets until cancelled; then all sockets are closed.

    The client listens: vehicle i sends to 127.0.0.1, port `base_port + 10 i`. `on_ready` gets the
    URLs to connect with, in the order of the vehicles. Pictures are served at `http_port`, so the
    vehicles' `image_url_prefix` has to begin with that address. All vehicles share a world, and
    are stepped together.

    Raises `ValueError` for a speed-up or a picture address that cannot be served, `OSError` when
    a port is taken.
    """
    if not 0.0 < speedup <= 1000.0:
        raise ValueError(f"a speed-up is above 0 and at most 1000: {speedup}")
    for vehicle in vehicles:
        _check_prefix(vehicle.spec.image_url_prefix, http_port)
    pictures = PictureServer(lambda path: _find(vehicles, path))
    transports: list[asyncio.DatagramTransport] = []
    try:
        await pictures.open(http_port)
        links, urls = [], []
        loop = asyncio.get_running_loop()
        for i, vehicle in enumerate(vehicles):
            port = base_port + PORTS_BETWEEN_VEHICLES * i
            link = VehicleLink(vehicle, (LOOPBACK, port))
            transport, _ = await loop.create_datagram_endpoint(
                lambda link=link: link,  # type: ignore[misc]
                local_addr=(LOOPBACK, 0),
            )
            transports.append(transport)
            links.append(link)
            urls.append(f"udpin://{LOOPBACK}:{port}")
        on_ready(urls)
        await _run(vehicles, links, speedup)
    finally:
        for transport in transports:
            transport.close()
        await pictures.close()


async def _run(
    vehicles: Sequence[SimVehicle], links: Sequence[VehicleLink], speedup: float
) -> None:
    """Keep the vehicles' time at `speedup` times the wall's.

    A machine that is too slow lets the simulation fall behind; what it cannot catch up within a
    burst is dropped, not hurried after.
    """
    started_s, owed_s = time.monotonic(), 0.0
    while True:
        now_s = time.monotonic()
        owed_s += (now_s - started_s) * speedup
        started_s = now_s
        while owed_s >= _STEP_S:
            for vehicle, link in zip(vehicles, links, strict=True):
                link.send(vehicle.step(_STEP_S))
            owed_s -= _STEP_S
            if time.monotonic() - now_s > _BURST_S:
                owed_s = min(owed_s, _STEP_S)
                break
        await asyncio.sleep(max(0.0, min(_TICK_S, (_STEP_S - owed_s) / speedup)))


def _find(vehicles: Sequence[SimVehicle], path: str) -> bytes | None:
    for vehicle in vehicles:
        image = vehicle.image(vehicle.spec.image_url_prefix.rstrip("/") + path)
        if image is not None:
            return image
    return None


def _check_prefix(prefix: str, http_port: int) -> None:
    parts = urlsplit(prefix)
    if (parts.scheme, parts.hostname, parts.port, parts.path) != ("http", LOOPBACK, http_port, "/"):
        raise ValueError(
            f"pictures are served at http://{LOOPBACK}:{http_port}/, "
            f"but the vehicle announces them at {prefix}"
        )
