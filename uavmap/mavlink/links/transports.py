"""Bytes to and from a vehicle; the session decodes them.

Every transport passes its bytes to `on_bytes` from the event loop and never blocks the reader. An
ArduPilot simulation freezes when its TCP client stops reading. `on_bytes` returns whether the
vehicle sent them, by which a listening socket knows its peer.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import socket
import time
from collections import defaultdict
from collections.abc import AsyncIterator, Callable, Collection, Hashable, Mapping
from functools import partial
from typing import Any, Final, cast

from missions.errors import LinkError
from uavmap.mavlink.links.framing import Splitter, sender_of
from uavmap.mavlink.links.serial_port import REOPEN_S, SerialPort
from uavmap.mavlink.links.urls import Endpoint

PEER_SILENT_S: Final = 10.0
"""Silence after which our vehicle may be received from another address, real seconds."""
MAX_STRANGERS: Final = 16
"""Maximum number of strangers that a link logs."""
MAX_AT_ONCE: Final = 1000
"""Maximum number of datagrams in one turn of the loop: a flood must not stop the rest."""
_DATAGRAM_BYTES: Final = 65_535

OnBytes = Callable[[bytes], bool]
"""Takes received bytes; returns whether our vehicle sent some of them."""
Log = Callable[[str], None]
Address = tuple[str, int]


class Strangers:
    """Senders on a link that are not its vehicle; each is logged once."""

    def __init__(self, endpoint: Endpoint, say: Log) -> None:
        self._url = endpoint.url
        self._log = say
        self._known: set[Any] = set()

    def log(self, address: Any, what: str) -> None:
        """Log the action of a stranger, the first time."""
        if address in self._known or len(self._known) >= MAX_STRANGERS:
            return
        self._known.add(address)
        self._log(f"{self._url}: {_place(address)} {what}")

    def log_move(self, before: Any, now: Any) -> None:
        """Log that the vehicle is received from another address."""
        self._log(f"{self._url}: the vehicle is received from {_place(now)}, not {_place(before)}")


def _place(address: Any) -> str:
    host, port = address[:2]
    return host if port is None else f"{host} port {port}"


async def bound_socket(host: str, port: int, family: int = 0) -> socket.socket:
    """Return a UDP socket of an address of this machine. Raises `OSError`."""
    loop = asyncio.get_running_loop()
    found = await loop.getaddrinfo(host, port, family=family, type=socket.SOCK_DGRAM)
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

    asyncio takes one datagram a turn: after long turns old telemetry would be read as of now.
    """

    def __init__(self, made: socket.socket) -> None:
        self._socket = made
        self._loop = asyncio.get_running_loop()

    def deliver_to(self, hear: Callable[[bytes, Address], None]) -> None:
        """Begin to read."""
        self._loop.add_reader(self._socket.fileno(), self._read, hear)

    def _read(self, hear: Callable[[bytes, Address], None]) -> None:
        for _ in range(MAX_AT_ONCE):
            try:
                data, address = self._socket.recvfrom(_DATAGRAM_BYTES)
            except OSError:  # it is empty, or closed
                return
            hear(data, (str(address[0]), int(address[1])))

    def send(self, data: bytes, address: Address) -> None:
        """Send a datagram; one that the system refuses is lost, as on its way."""
        with contextlib.suppress(OSError):
            self._socket.sendto(data, address)

    def close(self) -> None:
        """Stop reading, and release the port."""
        if self._socket.fileno() >= 0:
            self._loop.remove_reader(self._socket.fileno())
            self._socket.close()


class UdpLink:
    """A UDP link. With a named peer it receives only from that one.

    A listening link keeps to the address from which it first received the vehicle. Only after a
    long silence does it receive others, and then follows the vehicle to its new address.
    """

    def __init__(
        self, socket: UdpSocket, on_bytes: OnBytes, strangers: Strangers, named: Address | None
    ) -> None:
        self._socket = socket
        self._on_bytes = on_bytes
        self._strangers = strangers
        self._named = named is not None
        self._peer: Address | None = named
        self._received_s = float("-inf")

    @property
    def peer_host(self) -> str | None:
        """Address of the host at the other end; None without one."""
        return None if self._peer is None else self._peer[0]

    @property
    def destination(self) -> Hashable:
        """Equal for two links over the same socket to the same place."""
        return (id(self._socket), self._peer)

    def receive(self, data: bytes, address: Address) -> None:
        """Handle a datagram from an address."""
        if address == self._peer:
            if self._on_bytes(data):
                self._received_s = time.monotonic()
            return
        silent_s = time.monotonic() - self._received_s
        if self._named or (self._peer is not None and silent_s < PEER_SILENT_S):
            self._strangers.log(address, "sends as well, and is ignored")
            return
        if self._on_bytes(data):
            if self._peer is not None:
                self._strangers.log_move(self._peer, address)
            self._peer, self._received_s = address, time.monotonic()

    def send(self, data: bytes) -> None:
        """Send to the peer; drop without one."""
        if self._peer is not None:
            self._socket.send(data, self._peer)


MAX_UNSENT: Final = 1 << 18
"""Maximum number of bytes that wait for a TCP peer; more are lost, as on any other link."""
_KEEPALIVE_S: Final = 5


class TcpLink:
    """A TCP link: one connection at a time."""

    def __init__(self, on_bytes: OnBytes, strangers: Strangers) -> None:
        self.on_bytes = on_bytes
        self._strangers = strangers
        self._transport: asyncio.Transport | None = None
        self.gone = asyncio.Event()
        """Set when a connection has ended."""

    @property
    def peer_host(self) -> str | None:
        """Address of the host at the other end; None without one."""
        if self._transport is None:
            return None
        return str(self._transport.get_extra_info("peername")[0])

    @property
    def destination(self) -> Hashable:
        """Itself: no other link leads there."""
        return id(self)

    def made(self, transport: asyncio.Transport) -> bool:
        """Accept or refuse a new connection; return whether it is the link's."""
        peer = transport.get_extra_info("peername")
        if peer is None:  # it has gone again already
            return False
        if self._transport is not None:
            # by host: a port is new with each try
            self._strangers.log((peer[0], None), "tries to connect as well, and is refused")
            return False
        self._transport = transport
        self.gone.clear()
        _keep_alive(transport.get_extra_info("socket"))
        return True

    def note_loss(self, transport: asyncio.Transport) -> None:
        """Handle the end of a connection: the next client may come."""
        if transport is self._transport:
            self._transport = None
            self.gone.set()

    def send(self, data: bytes) -> None:
        """Send; drop without a connection."""
        transport = self._transport
        if transport is None or transport.is_closing():
            return
        if transport.get_write_buffer_size() < MAX_UNSENT:  # else the other end does not read
            transport.write(data)

    def close(self) -> None:
        """End the connection, if there is one."""
        if self._transport is not None:
            self._transport.abort()


def _keep_alive(connection: socket.socket) -> None:
    """Have the system detect within some 15 s that the other end is gone without closing."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in (("TCP_KEEPIDLE", _KEEPALIVE_S), ("TCP_KEEPINTVL", 3), ("TCP_KEEPCNT", 3)):
        if (option := getattr(socket, name, None)) is not None:  # macOS lacks one of them
            connection.setsockopt(socket.IPPROTO_TCP, option, value)
    if (option := getattr(socket, "TCP_USER_TIMEOUT", None)) is not None:
        connection.setsockopt(socket.IPPROTO_TCP, option, 3 * _KEEPALIVE_S * 1000)


class _TcpConnection(asyncio.Protocol):
    """One connection of a TCP link, or one that it refuses."""

    def __init__(self, link: TcpLink) -> None:
        self._link = link
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        made = cast(asyncio.Transport, transport)
        if self._link.made(made):
            self._transport = made
        else:  # not at once: asyncio is about to read from it
            asyncio.get_running_loop().call_soon(made.abort)

    def data_received(self, data: bytes) -> None:
        if self._transport is not None:
            self._link.on_bytes(data)

    def connection_lost(self, exc: Exception | None) -> None:
        if self._transport is not None:
            self._link.note_loss(self._transport)


Transport = UdpLink | TcpLink | SerialPort
"""One open link; data that it cannot send is dropped."""
_Opened = tuple[Transport, Callable[[], None]]


@contextlib.asynccontextmanager
async def open_transport(
    endpoint: Endpoint, on_bytes: OnBytes, say: Log = lambda text: None
) -> AsyncIterator[Transport]:
    """Open the transport of an endpoint, and close it at the end.

    `say` logs other senders. Raises `LinkError` if it cannot be opened.
    """
    opener = {
        "udpin": _open_udp,
        "udpout": _open_udp,
        "tcpin": _open_tcp_server,
        "tcpout": _open_tcp_client,
        "serial": _open_serial,
    }[endpoint.transport]
    try:
        transport, close = await opener(endpoint, on_bytes, Strangers(endpoint, say))
    except (OSError, ValueError, OverflowError) as error:  # the last two for a baud rate
        raise _not_opened(endpoint, error) from None
    try:
        yield transport
    finally:
        close()
        await asyncio.sleep(0)  # let the loop drop the file before it closes


def _not_opened(endpoint: Endpoint, error: Exception) -> LinkError:
    text = f"{endpoint.url} cannot be opened: {error}"
    if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
        text += (
            "; another program listens there, perhaps a ground station: end it, or have the "
            "vehicle send to another port, and pass its frames on with --forward"
        )
    return LinkError(text)


@contextlib.asynccontextmanager
async def open_shared(
    endpoint: Endpoint, on_bytes: Mapping[int, OnBytes], say: Log = lambda text: None
) -> AsyncIterator[Mapping[int, Transport]]:
    """Open one link that several vehicles share: a transport for each, by system id.

    On a listening UDP socket each vehicle may use an address of its own. Other systems are logged
    once and ignored. Raises `LinkError` as `open_transport`.
    """
    strangers = Strangers(endpoint, say)
    if endpoint.transport != "udpin":
        splitter = Splitter()

        def deliver(data: bytes) -> bool:
            groups = _by_system(splitter.feed(data), on_bytes, strangers)
            ours = [on_bytes[system](group) for system, group in groups]
            return any(ours)

        async with open_transport(endpoint, deliver, say) as one:
            yield dict.fromkeys(on_bytes, one)
        return
    try:
        shared = UdpSocket(await bound_socket(endpoint.host, endpoint.port))
    except OSError as error:
        raise _not_opened(endpoint, error) from None
    each = {
        system: UdpLink(shared, received, strangers, None) for system, received in on_bytes.items()
    }

    def hear(data: bytes, address: Address) -> None:
        for system, group in _by_system(Splitter().feed(data), each, strangers):
            each[system].receive(group, address)

    shared.deliver_to(hear)
    try:
        yield each
    finally:
        shared.close()


def _by_system(
    frames: list[bytes], ours: Collection[int], strangers: Strangers
) -> list[tuple[int, bytes]]:
    """Return the frames of each of our systems in one piece; others are logged once."""
    groups: defaultdict[int, bytes] = defaultdict(bytes)
    for frame in frames:
        groups[sender_of(frame)[0]] += frame
    for system in groups.keys() - set(ours):
        strangers.log((f"system {system}", None), "sends here, and is no vehicle of this flight")
    return [(system, group) for system, group in groups.items() if system in ours]


async def _open_udp(endpoint: Endpoint, on_bytes: OnBytes, strangers: Strangers) -> _Opened:
    if endpoint.transport == "udpin":
        named, made = None, await bound_socket(endpoint.host, endpoint.port)
    else:
        found = await asyncio.get_running_loop().getaddrinfo(endpoint.host, endpoint.port)
        family, _, _, _, peer = found[0]
        named = (str(peer[0]), int(peer[1]))
        made = await bound_socket("::" if len(peer) == 4 else "0.0.0.0", 0, family)
    opened = UdpSocket(made)
    udp = UdpLink(opened, on_bytes, strangers, named)
    opened.deliver_to(udp.receive)
    return udp, opened.close


async def _open_tcp_client(endpoint: Endpoint, on_bytes: OnBytes, strangers: Strangers) -> _Opened:
    tcp = TcpLink(on_bytes, strangers)
    connecting = asyncio.get_running_loop().create_connection
    connect = partial(connecting, lambda: _TcpConnection(tcp), endpoint.host, endpoint.port)

    async def stay_connected() -> None:
        """Reconnect after the end of a connection, for as long as it takes."""
        while True:
            await tcp.gone.wait()
            await asyncio.sleep(REOPEN_S)
            with contextlib.suppress(OSError):
                await connect()

    await connect()
    staying = asyncio.create_task(stay_connected())

    def close() -> None:
        staying.cancel()
        tcp.close()

    return tcp, close


async def _open_tcp_server(endpoint: Endpoint, on_bytes: OnBytes, strangers: Strangers) -> _Opened:
    tcp = TcpLink(on_bytes, strangers)
    make_server = asyncio.get_running_loop().create_server
    server = await make_server(lambda: _TcpConnection(tcp), endpoint.host, endpoint.port)

    def close() -> None:
        server.close()
        tcp.close()

    return tcp, close


async def _open_serial(endpoint: Endpoint, on_bytes: OnBytes, _: Strangers) -> _Opened:
    port = SerialPort(endpoint.host, endpoint.port, on_bytes)
    return port, port.close
