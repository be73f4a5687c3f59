"""A radio of plain datagrams to a multicast group: every member in reach hears each one once.

Zenoh can join a group, but from three members on (releases up to 1.10) they answer each other's
declarations without end, 40 MB a minute and more. A socket needs none.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import struct
from collections.abc import Callable
from typing import Final

from uavmap.fleet.endpoints import FleetEndpoint

_LOG: Final = logging.getLogger("uavmap.fleet")
HEADER_BYTES: Final = 14 + 20 + 8
"""Of Ethernet (a Wi-Fi header is about as long), IPv4 and UDP."""
LARGEST_BYTES: Final = 1_400
RETRY_S: Final = 2.0
"""So long after an interface went, or was not there, it is tried again: of the loop's time."""
MOST_AT_ONCE: Final = 64
"""So many datagrams are read before others have their turn."""


class MulticastRadio:
    """A member's radio in a group. Open it in the loop's thread; `close` it at the end."""

    overhead_bytes: Final = HEADER_BYTES

    def __init__(self, endpoint: FleetEndpoint) -> None:
        self._endpoint = endpoint
        self._listeners: list[Callable[[bytes], None]] = []
        self._socket: socket.socket | None = None
        self._again: asyncio.TimerHandle | None = None
        self._told = ""

    def listen(self, heard: Callable[[bytes], None]) -> None:
        """Have what comes in passed on."""
        self._listeners.append(heard)

    def open(self) -> None:
        """Join the group, or try again and again until that can be."""
        self._again = None
        try:
            self._socket = _joined(self._endpoint)
        except OSError as error:
            self._lost(error)
            return
        asyncio.get_running_loop().add_reader(self._socket, self._read)
        if self._told:
            _LOG.info(f"{self._endpoint.url}: is there now")
        self._told = ""

    def send(self, datagram: bytes) -> None:
        """Send to the group; nothing while its interface is not there."""
        if self._socket is None or len(datagram) > LARGEST_BYTES:
            return
        try:
            self._socket.sendto(datagram, (self._endpoint.host, self._endpoint.port))
        except BlockingIOError:  # the interface is busy: it is lost as one on the air is
            return
        except OSError as error:
            self._lost(error)

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

    def _lost(self, error: OSError) -> None:
        """Say so once, and join anew in a while."""
        self._leave()
        reason = error.strerror or str(error)
        if reason != self._told:
            self._told = reason
            _LOG.info(f"{self._endpoint.url}: {reason}; it is tried again")
        self._again = asyncio.get_running_loop().call_later(RETRY_S, self.open)

    def _read(self) -> None:
        for _ in range(MOST_AT_ONCE):
            if self._socket is None:
                return
            try:
                datagram = self._socket.recv(LARGEST_BYTES + 1)
            except BlockingIOError:
                return
            except OSError as error:
                self._lost(error)
                return
            if len(datagram) <= LARGEST_BYTES:
                for heard in self._listeners:
                    heard(datagram)


def _joined(endpoint: FleetEndpoint) -> socket.socket:
    """A socket that sends to a group and hears it, by one interface only. Raises `OSError`."""
    assert endpoint.interface is not None
    index = socket.if_nametoindex(endpoint.interface)
    group = socket.inet_aton(endpoint.host)
    with contextlib.ExitStack() as failing:
        made = failing.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        made.setblocking(False)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if hasattr(socket, "SO_REUSEPORT"):
            made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        made.bind((endpoint.host, endpoint.port))  # nothing but what is sent to the group
        by_interface = struct.pack("=4s4si", group, socket.inet_aton("0.0.0.0"), index)
        made.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, by_interface)
        made.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, by_interface)
        made.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 1)
        failing.pop_all()
    return made
