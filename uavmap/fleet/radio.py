"""The carriers of datagrams between members: endpoints, and the radio of a multicast group.

Members reach each other at `tcp/HOST:PORT`, `udp/HOST:PORT` (Zenoh's notation) or a multicast
group, which names its interface, so nothing is sent by another one.
"""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import logging
import re
import socket
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from missions.errors import LinkError
from uavmap.fleet.sealing import Seal

_ENDPOINT: Final = re.compile(
    r"(?P<transport>[a-z]+)/(?P<host>\[[0-9A-Fa-f:.%]+\]|[^\[\]:/#?]+):(?P<port>\d{1,5})"
    r"(#iface=(?P<interface>[^#;=\s]{1,15}))?"
)
_SHAPE: Final = "tcp/192.168.7.11:7447, udp/192.168.7.11:7447, or udp/224.0.0.224:7447#iface=wlan0"


@dataclass(frozen=True, slots=True)
class FleetEndpoint:
    """An endpoint of a fleet's network."""

    transport: str
    """tcp or udp."""
    host: str
    port: int
    interface: str | None = None

    @property
    def multicast(self) -> bool:
        """True if it is a group, which all members receive that have joined it."""
        try:
            return ipaddress.ip_address(self.host).is_multicast
        except ValueError:  # a host name
            return False

    @property
    def url(self) -> str:
        """URL in Zenoh's notation."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        end = "" if self.interface is None else f"#iface={self.interface}"
        return f"{self.transport}/{host}:{self.port}{end}"


def parse_endpoint(option: str, text: str) -> FleetEndpoint:
    """Parse the endpoint of an option. Raises `LinkError` with the remedy.

    >>> parse_endpoint("--listen", "udp/224.0.0.224:7447#iface=wlan0").multicast
    True
    >>> parse_endpoint("--peer", "drone-2:7447")
    Traceback (most recent call last):
    missions.errors.LinkError: --peer drone-2:7447: write ...
    """
    match = _ENDPOINT.fullmatch(text.strip())
    if match is None or match["transport"] not in ("tcp", "udp"):
        raise LinkError(f"{option} {text}: write {_SHAPE}")
    endpoint = FleetEndpoint(
        match["transport"], match["host"].strip("[]"), int(match["port"]), match["interface"]
    )
    if not 0 < endpoint.port < 65536:
        raise LinkError(f"{option} {text}: a port is 1 to 65535")
    if not endpoint.multicast:
        return endpoint
    if option != "--listen":
        raise LinkError(f"{option} {text}: a multicast group is joined: --listen {text}")
    if endpoint.transport != "udp" or ":" in endpoint.host:
        raise LinkError(f"{option} {text}: a group is udp over IPv4: udp/224.0.0.224:7447#iface=…")
    if endpoint.interface is None:
        raise LinkError(
            f"{option} {text}: name the interface of the radio, else it might go out by another: "
            f"{text}#iface=wlan0"
        )
    return endpoint


class Radio(Protocol):
    """Carries datagrams to all in range; any may be lost, doubled, or come late."""

    @property
    def overhead_bytes(self) -> int:
        """Bytes of a datagram on its way besides itself."""

    def send(self, datagram: bytes) -> None:
        """Send to all. Never raises, never waits."""

    def listen(self, received: Callable[[bytes], None]) -> None:
        """Pass received datagrams on, in the event loop's thread."""


@dataclass(frozen=True, slots=True)
class SealedRadio:
    """The communication of one member of a fleet with the others."""

    radio: Radio
    seal: Seal


@dataclass(frozen=True, slots=True)
class Radios:
    """Several radios as one: each carries everything. Without any it is silent."""

    parts: Sequence[Radio] = ()

    @property
    def overhead_bytes(self) -> int:
        """Maximum overhead of its radios."""
        return max((radio.overhead_bytes for radio in self.parts), default=0)

    def send(self, datagram: bytes) -> None:
        """Send by each."""
        for radio in self.parts:
            radio.send(datagram)

    def listen(self, received: Callable[[bytes], None]) -> None:
        """Pass datagrams received by any radio on."""
        for radio in self.parts:
            radio.listen(received)


_LOG: Final = logging.getLogger("uavmap.fleet")
# --- a multicast group ---------------------------------------------------------------------------
HEADER_BYTES: Final = 14 + 20 + 8
"""Bytes of Ethernet (a Wi-Fi header is about as long), IPv4 and UDP."""
LARGEST_BYTES: Final = 1_400
RETRY_S: Final = 2.0
"""Time after which a lost interface is tried again, s of the loop."""
MAX_AT_ONCE: Final = 64
"""Number of datagrams that are read before other tasks have their turn."""


class MulticastRadio:
    """A member's radio in a group. Open it in the loop's thread; `close` it at the end."""

    overhead_bytes: Final = HEADER_BYTES

    def __init__(self, endpoint: FleetEndpoint) -> None:
        self._endpoint = endpoint
        self._listeners: list[Callable[[bytes], None]] = []
        self._socket: socket.socket | None = None
        self._again: asyncio.TimerHandle | None = None
        self._logged = ""

    def listen(self, received: Callable[[bytes], None]) -> None:
        """Pass received datagrams on."""
        self._listeners.append(received)

    def open(self) -> None:
        """Join the group, or try again until that succeeds."""
        self._again = None
        try:
            self._socket = _joined(self._endpoint)
        except OSError as error:
            self._note_loss(error)
            return
        asyncio.get_running_loop().add_reader(self._socket, self._read)
        if self._logged:
            _LOG.info(f"{self._endpoint.url}: is there now")
        self._logged = ""

    def send(self, datagram: bytes) -> None:
        """Send to the group; drop while its interface is missing."""
        if self._socket is None or len(datagram) > LARGEST_BYTES:
            return
        try:
            self._socket.sendto(datagram, (self._endpoint.host, self._endpoint.port))
        except BlockingIOError:  # the interface is busy: it is lost as one on the air is
            return
        except OSError as error:
            self._note_loss(error)

    def close(self) -> None:
        """Leave the group."""
        if self._again is not None:
            self._again.cancel()
        self._leave()

    def _leave(self) -> None:
        if self._socket is not None:
            asyncio.get_running_loop().remove_reader(self._socket)
            self._socket.close()
            self._socket = None

    def _note_loss(self, error: OSError) -> None:
        self._leave()
        reason = error.strerror or str(error)
        if reason != self._logged:
            self._logged = reason
            _LOG.info(f"{self._endpoint.url}: {reason}; it is tried again")
        self._again = asyncio.get_running_loop().call_later(RETRY_S, self.open)

    def _read(self) -> None:
        for _ in range(MAX_AT_ONCE):
            if self._socket is None:
                return
            try:
                datagram = self._socket.recv(LARGEST_BYTES + 1)
            except BlockingIOError:
                return
            except OSError as error:
                self._note_loss(error)
                return
            if len(datagram) <= LARGEST_BYTES:
                for received in self._listeners:
                    received(datagram)


def _joined(endpoint: FleetEndpoint) -> socket.socket:
    """Return a socket that sends to and receives from a group, by one interface only.

    Raises `OSError`.
    """
    assert endpoint.interface is not None
    index = socket.if_nametoindex(endpoint.interface)
    group = socket.inet_aton(endpoint.host)
    with contextlib.ExitStack() as failing:
        made = failing.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        made.setblocking(False)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if hasattr(socket, "SO_REUSEPORT"):
            made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        made.bind((endpoint.host, endpoint.port))  # only datagrams that are sent to the group
        by_interface = struct.pack("=4s4si", group, socket.inet_aton("0.0.0.0"), index)
        made.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, by_interface)
        made.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, by_interface)
        made.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 1)
        failing.pop_all()
    return made
