"""A vehicle's sockets: UDP with several clients, TCP with one.

No call waits for a client. A client that does not read loses whole frames, and one that vanishes
is forgotten; the vehicle and its other clients do not notice.
"""

from __future__ import annotations

import asyncio
from collections import OrderedDict, deque
from typing import cast

from sitl.codec import cut
from sitl.mavlink.links import Link
from sitl.vehicle import SimVehicle

LOOPBACK = "127.0.0.1"

_MAX_DATAGRAM = 1400
_MAX_CLIENTS = 8
_MAX_WAITING = 8  # TCP clients behind the one that is served
_MAX_UNSENT = 1 << 18  # bytes that wait for a client; then frames are dropped

Address = tuple[str, int]


class UdpPort(asyncio.DatagramProtocol):
    """One UDP socket that sends to a listening client and to those that have sent to it."""

    def __init__(self, vehicle: SimVehicle) -> None:
        self.url = ""
        self._vehicle = vehicle
        self._reboots = vehicle.fail.reboots
        self._listener: Address = (LOOPBACK, 0)
        self._clients: OrderedDict[Address, Link] = OrderedDict()  # the last sender comes last
        self._transport: asyncio.DatagramTransport | None = None
        self._full = False

    async def open(self, port: int) -> None:
        """Begin to send to a client that listens at `port`."""
        self._listener = (LOOPBACK, port)
        self.url = f"udpin://{LOOPBACK}:{port}"
        self._clients[self._listener] = self._vehicle.connect()
        loop = asyncio.get_running_loop()
        await loop.create_datagram_endpoint(lambda: self, local_addr=(LOOPBACK, 0))

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the socket (asyncio)."""
        self._transport = cast(asyncio.DatagramTransport, transport)

    def datagram_received(self, data: bytes, addr: Address) -> None:
        """Take a client's bytes; a new client receives the telemetry from now on (asyncio)."""
        link = self._clients.get(addr)
        if link is None:
            link = self._clients[addr] = self._vehicle.connect()
            if len(self._clients) > _MAX_CLIENTS:
                self._forget(next(client for client in self._clients if client != self._listener))
        self._clients.move_to_end(addr)
        link.receive(data)
        self.flush()

    def pause_writing(self) -> None:
        """Drop frames while the system takes none (asyncio)."""
        self._full = True

    def resume_writing(self) -> None:
        """Send again (asyncio)."""
        self._full = False

    def error_received(self, exc: Exception) -> None:
        """Ignore that no client listens at the other end (asyncio): the link is down."""

    def flush(self) -> None:
        """Send to every client, in datagrams of whole frames."""
        if self._reboots != self._vehicle.fail.reboots:
            # it restarts with another port, so the old ones are void
            self._reboots = self._vehicle.fail.reboots
            for client in list(self._clients):
                if client != self._listener:
                    self._forget(client)
        transport = self._transport
        for client, link in self._clients.items():
            data = link.read()
            if not data or transport is None or transport.is_closing():
                continue
            for datagram in datagrams(data):
                if not self._full:
                    transport.sendto(datagram, client)

    def _forget(self, client: Address) -> None:
        self._vehicle.disconnect(self._clients.pop(client))

    async def close(self) -> None:
        """Close the socket."""
        for client in list(self._clients):
            self._forget(client)
        if self._transport is not None:
            self._transport.close()


class TcpPort:
    """A listening socket that serves one client; others wait until it goes."""

    def __init__(self, vehicle: SimVehicle) -> None:
        self.url = ""
        self._vehicle = vehicle
        self._reboots = vehicle.fail.reboots
        self._link = vehicle.connect(trusted=True)
        self._server: asyncio.Server | None = None
        self._served: Connection | None = None
        self._waiting: deque[Connection] = deque()

    async def open(self, port: int) -> None:
        """Listen at `port`."""
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(lambda: Connection(self), LOOPBACK, port)
        self.url = f"tcpout://{LOOPBACK}:{port}"

    def add_client(self, connection: Connection) -> None:
        """Serve a client, let it wait, or drop it."""
        if self._served is None:
            self._serve(connection)
        elif len(self._waiting) < _MAX_WAITING:
            self._waiting.append(connection)
            # not at once: a Python before 3.11.4 begins to read after this, and forgets the pause
            asyncio.get_running_loop().call_soon(self._hold, connection)
        else:
            connection.transport.abort()

    def _hold(self, connection: Connection) -> None:
        if connection in self._waiting:
            connection.transport.pause_reading()

    def receive(self, connection: Connection, data: bytes) -> None:
        """Take the served client's bytes."""
        if connection is self._served:
            self._link.receive(data)
            self.flush()

    def remove_client(self, connection: Connection) -> None:
        """Serve the next client, if the served one has gone."""
        if connection is not self._served:
            if connection in self._waiting:
                self._waiting.remove(connection)
            return
        self._served = None
        while self._waiting and self._served is None:
            following = self._waiting.popleft()
            if not following.transport.is_closing():
                following.transport.resume_reading()
                self._serve(following)

    def _serve(self, connection: Connection) -> None:
        # a new link: what the last client left unfinished is not put before this one's words
        self._vehicle.disconnect(self._link)
        self._link = self._vehicle.connect(trusted=True)
        self._served = connection
        connection.transport.write(self._vehicle.banner)

    def flush(self) -> None:
        """Send to the served client, as far as it reads."""
        data = self._link.read()
        served = self._served
        if self._reboots != self._vehicle.fail.reboots:
            self._reboots = self._vehicle.fail.reboots
            if served is not None:
                served.transport.abort()
            return
        if served is None or not data or served.transport.is_closing():
            return
        if served.transport.get_write_buffer_size() <= _MAX_UNSENT:
            served.transport.write(data)

    async def close(self) -> None:
        """Close the socket and its connections."""
        self._vehicle.disconnect(self._link)
        waiting, self._waiting = list(self._waiting), deque()
        for connection in (self._served, *waiting):
            if connection is not None:
                connection.transport.abort()
        self._served = None
        if self._server is not None:
            self._server.close()
            await self._server.wait_closed()


class Connection(asyncio.Protocol):
    """One TCP connection of a port."""

    transport: asyncio.Transport

    def __init__(self, port: TcpPort) -> None:
        self._port = port

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the socket (asyncio)."""
        self.transport = cast(asyncio.Transport, transport)
        self._port.add_client(self)

    def data_received(self, data: bytes) -> None:
        """Take the client's bytes (asyncio)."""
        self._port.receive(self, data)

    def connection_lost(self, exc: Exception | None) -> None:
        """Note that it has gone (asyncio)."""
        self._port.remove_client(self)


def datagrams(data: bytes) -> list[bytes]:
    """Join whole frames to datagrams: a frame never spans two."""
    made = [b""]
    for frame in cut(data):
        if made[-1] and len(made[-1]) + len(frame) > _MAX_DATAGRAM:
            made.append(b"")
        made[-1] += frame
    return made
