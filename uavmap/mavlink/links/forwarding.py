"""Ground stations on the links of the vehicles: frames passed on without a changed byte.

    a vehicle's frames -> every ground station
    a ground station's frames -> the target vehicle; all vehicles without a target

No sender waits. A slow station loses frames, and the vehicles are still received. Our own frames to
vehicles are not passed on: a station would take them for a second ground station's traffic.
"""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator, Callable, Sequence
from typing import Protocol

from uavmap.mavlink.links.framing import Splitter, target_of
from uavmap.mavlink.links.transports import Transport, open_transport
from uavmap.mavlink.links.urls import parse_url


class VehicleLink(Protocol):
    """The link to one vehicle."""

    @property
    def system_id(self) -> int:
        """System id, 0 before its first message."""

    @property
    def transport(self) -> Transport:
        """Transport of its frames."""


class Forwarding:
    """Passes frames between vehicles and ground stations. `record` gets the stations' frames."""

    def __init__(self, record: Callable[[bytes], None]) -> None:
        self._record = record
        self._links: list[VehicleLink] = []
        self._stations: list[Transport] = []

    def add(self, way: VehicleLink) -> Callable[[bytes], None]:
        """Add a vehicle; return a function that takes its bytes as they come."""
        self._links.append(way)
        splitter = Splitter()

        def receive(data: bytes) -> None:
            if frames := splitter.feed(data):
                whole = b"".join(frames)
                for station in self._stations:
                    station.send(whole)

        return receive

    @contextlib.asynccontextmanager
    async def open(self, urls: Sequence[str], say: Callable[[str], None]) -> AsyncIterator[None]:
        """Open the links to the ground stations. Raises `LinkError` if that fails."""
        async with contextlib.AsyncExitStack() as stack:
            for url in urls:
                station = open_transport(parse_url(url), self._from_station(), say)
                self._stations.append(await stack.enter_async_context(station))
            yield

    def _from_station(self) -> Callable[[bytes], bool]:
        splitter = Splitter()

        def receive(data: bytes) -> bool:
            frames = splitter.feed(data)
            for frame in frames:
                self._record(frame)
                self._to_vehicles(frame)
            return bool(frames)

        return receive

    def _to_vehicles(self, frame: bytes) -> None:
        target = target_of(frame)
        meant = [way for way in self._links if target and way.system_id == target] or self._links
        # vehicles behind one router share a link, on which one send reaches all
        for transport in {way.transport.destination: way.transport for way in meant}.values():
            transport.send(frame)
