"""Simulated vehicles on real loopback sockets, in real time or at a speed-up.

UDP: a vehicle has one socket that sends to a port where a client listens (what MAVSDK calls
`udpin://127.0.0.1:14550`), and also to whoever else has spoken to it. TCP: a vehicle listens and
serves one client at a time (`tcpout://127.0.0.1:5760`), as ArduPilot's own simulator does.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Sequence
from typing import Literal, TypeAlias
from urllib.parse import urlsplit

from sitl.camera.http import PictureServer
from sitl.sockets.client_sockets import LOOPBACK, TcpPort, UdpPort
from sitl.vehicle import SimVehicle

__all__ = ["LOOPBACK", "PORTS_BETWEEN_VEHICLES", "Transport", "serve"]

PORTS_BETWEEN_VEHICLES = 10
BASE_PORT = {"udp": 14550, "tcp": 5760}

_STEP_S = 0.05
_TICK_S = 0.01  # how often to look whether a step is due
_BURST_S = 0.1  # wall time of stepping before the sockets get their turn

Transport: TypeAlias = Literal["udp", "tcp"]
Port: TypeAlias = UdpPort | TcpPort


async def serve(
    vehicles: Sequence[SimVehicle],
    *,
    speedup: float = 1.0,
    transport: Transport = "udp",
    base_port: int | None = None,
    http_port: int | None,
    on_ready: Callable[[list[str]], None],
) -> None:
    """Fly `vehicles` on loopback sockets until cancelled; then all sockets are closed.

    "udp": the client listens, vehicle i sends to 127.0.0.1, port `base_port + 10 i` (14550 first),
    and to up to seven others that speak to it. "tcp": the vehicle listens at that port (5760
    first); it is its USB port, where unsigned frames are heard even when it signs. `on_ready` gets
    the URLs to connect with, in the order of the vehicles.

    Pictures are served at `http_port`, so the vehicles' `image_url_prefix` has to begin with that
    address; with None they are not. All vehicles share a world, and are stepped together.

    Raises `ValueError` for a speed-up or a picture address that cannot be served, `OSError` when
    a port is taken.
    """
    if not 0.0 < speedup <= 1000.0:
        raise ValueError(f"a speed-up is above 0 and at most 1000: {speedup}")
    if transport not in BASE_PORT:
        raise ValueError(f'a transport is "udp" or "tcp": {transport}')
    if http_port is not None:
        for vehicle in vehicles:
            _check_prefix(vehicle.spec.image_url_prefix, http_port)
    first = BASE_PORT[transport] if base_port is None else base_port
    pictures = PictureServer(lambda path: _find(vehicles, path))
    ports: list[Port] = []
    try:
        if http_port is not None:
            await pictures.open(http_port)
        for i, vehicle in enumerate(vehicles):
            vehicle.set_speedup(speedup)
            port = UdpPort(vehicle) if transport == "udp" else TcpPort(vehicle)
            ports.append(port)
            await port.open(first + PORTS_BETWEEN_VEHICLES * i)
        on_ready([port.url for port in ports])
        await _run(vehicles, ports, speedup)
    finally:
        for port in ports:
            await port.close()
        await pictures.close()


async def _run(vehicles: Sequence[SimVehicle], ports: Sequence[Port], speedup: float) -> None:
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
            for vehicle, port in zip(vehicles, ports, strict=True):
                vehicle.step(_STEP_S)
                port.flush()
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
