"""A radio over Zenoh: from peer to peer, or by a router.

Nothing goes to a host that was not named: no scouting, no gossip. A datagram is sent once to each
neighbour, and dropped if a link is stuck. Zenoh's threads pass received datagrams to the event
loop. A thread opens the session, and reopens it if Zenoh gave it up or all were silent for long.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from missions.errors import LinkError
from uavmap.base import messages
from uavmap.base.extras import install_command
from uavmap.fleet.radio import FleetEndpoint

TCP_BYTES: Final = 156
"""Bytes beside a datagram: Ethernet, IPv4, TCP, Zenoh's frame and key, one acknowledgement."""
UDP_BYTES: Final = 64
"""The same for UDP, without acknowledgements."""
LARGEST_BYTES: Final = 1_400
LEASE_S: Final = 24.0
"""Silence after which a neighbour is gone, s: eight beats of a member."""
KEEP_ALIVES: Final = 3
"""Number of keep-alives in a lease; they are sent only if nothing else is."""
RETRY_S: Final = (2.0, 15.0)
"""Time between two attempts to connect, s: at first, and at most."""
SILENT_S: Final = (30.0, 120.0)
"""Silence after which a session is reopened, s: at first, and at most."""
DECLARE_S: Final = 20.0
"""Time between declarations over UDP, which may be lost, s."""
LOOK_S: Final = 0.5
CLOSE_S: Final = 3.0
MAX_WAITING: Final = 256
"""Maximum number of datagrams that wait for the event loop; more are dropped."""
_WHERE: Final = re.compile(r" at \S+\.rs:\d+\.?")
SEND_BUFFER_BYTES: Final = 8_192
"""Send buffer of a TCP link, bytes: data that waits longer than a few beats is old."""


@dataclass(frozen=True, slots=True)
class ZenohLinks:
    """The network of one member."""

    listen: tuple[FleetEndpoint, ...] = ()
    peers: tuple[FleetEndpoint, ...] = ()
    routers: tuple[FleetEndpoint, ...] = ()
    """Routers; with any, all goes by one of them."""

    @property
    def all(self) -> tuple[FleetEndpoint, ...]:
        """Return every endpoint of it."""
        return (*self.listen, *self.peers, *self.routers)

    def config(self) -> dict[str, Any]:
        """Return the configuration for Zenoh."""
        connect = self.routers or self.peers
        retry = {
            "period_init_ms": int(1000 * RETRY_S[0]),
            "period_max_ms": int(1000 * RETRY_S[1]),
            "period_increase_factor": 1.5,
        }
        unicast = {"open_timeout": 5000, "accept_timeout": 5000, "accept_pending": 16}
        return {
            "mode": "client" if self.routers else "peer",
            "connect": {
                "endpoints": [endpoint.url for endpoint in connect],
                "timeout_ms": -1,  # in the background, without an end
                "exit_on_failure": False,
                "retry": retry,
            },
            "listen": {
                "endpoints": [endpoint.url for endpoint in self.listen],
                "timeout_ms": 0,
                "exit_on_failure": True,
            },
            "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
            "adminspace": {"enabled": False},
            "transport": {
                "shared_memory": {"enabled": False},
                "unicast": {**unicast, "max_sessions": 64, "qos": {"enabled": False}},
                "link": {
                    "tcp": {"so_sndbuf": SEND_BUFFER_BYTES},
                    "tx": {
                        "lease": int(1000 * LEASE_S),
                        "keep_alive": KEEP_ALIVES,
                        "batch_size": 2 * LARGEST_BYTES,
                    },
                    "rx": {"max_message_size": 2 * LARGEST_BYTES},
                },
            },
        }


class ZenohRadio:
    """A member's radio over Zenoh. `open` it in the loop's thread, `close` it at the end."""

    def __init__(self, links: ZenohLinks, key: str) -> None:
        self._zenoh = imported_zenoh()
        self._links = links
        self._key = key
        self._log = messages.bound("uavmap.fleet")
        self._loop: asyncio.AbstractEventLoop | None = None
        self._listeners: list[Callable[[bytes], None]] = []
        self._publisher: Any = None
        self._waiting = 0
        self._received_s = 0.0
        self._broken = threading.Event()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._keep, name="fleet radio", daemon=True)
        self._logged = ""
        self.opened = 0
        """Number of opened sessions."""

    @property
    def overhead_bytes(self) -> int:
        """Overhead of its most expensive link, bytes."""
        tcp = any(endpoint.transport == "tcp" for endpoint in self._links.all)
        return TCP_BYTES if tcp else UDP_BYTES

    def listen(self, received: Callable[[bytes], None]) -> None:
        """Pass received datagrams on."""
        self._listeners.append(received)

    def open(self) -> None:
        """Begin."""
        self._loop = asyncio.get_running_loop()
        self._thread.start()

    def send(self, datagram: bytes) -> None:
        """Send to all neighbours; drop without a session."""
        publisher = self._publisher
        if publisher is None or len(datagram) > LARGEST_BYTES:
            return
        try:
            publisher.put(datagram)
        except Exception:  # the session is gone, whatever Zenoh's error
            self._publisher = None
            self._broken.set()

    async def close(self) -> None:
        """End the session; wait for it `CLOSE_S` seconds at most."""
        self._stop.set()
        self._broken.set()
        self._publisher = None
        await asyncio.to_thread(self._thread.join, CLOSE_S)
        self._loop = None

    # --- in the thread that keeps the session ----------------------------------------------------
    def _keep(self) -> None:
        silent_s, retry_s = SILENT_S[0], RETRY_S[0]
        while not self._stop.is_set():
            try:
                config = self._zenoh.Config.from_json5(json.dumps(self._links.config()))
                session = self._zenoh.open(config)
                self.opened += 1
            except Exception as error:
                self._log_text(_error_text(error))
                self._stop.wait(retry_s)
                retry_s = min(1.5 * retry_s, RETRY_S[1])
                continue
            retry_s = RETRY_S[0]
            began_s = self._received_s = time.monotonic()
            try:
                self._live(session, silent_s)
            except Exception as error:
                self._log_text(_error_text(error))
            finally:
                self._publisher = None
                with contextlib.suppress(Exception):
                    session.close()
            self._stop.wait(RETRY_S[0])
            received = self._received_s > began_s
            silent_s = SILENT_S[0] if received else min(2.0 * silent_s, SILENT_S[1])

    def _live(self, session: Any, silent_s: float) -> None:
        self._broken.clear()
        subscriber = self._subscribed(session)
        self._publisher = session.declare_publisher(
            self._key,
            congestion_control=self._zenoh.CongestionControl.DROP,
            allowed_destination=self._zenoh.Locality.REMOTE,
        )
        if self._logged:
            self._log_text("the network of the fleet is open")
            self._logged = ""
        by_udp = any(endpoint.transport == "udp" for endpoint in self._links.all)
        declared_s = time.monotonic()
        while not self._broken.wait(LOOK_S) and not self._stop.is_set():
            now_s = time.monotonic()
            if session.is_closed() or now_s - self._received_s > silent_s:
                return
            if by_udp and now_s - declared_s > DECLARE_S:
                subscriber.undeclare()
                subscriber, declared_s = self._subscribed(session), now_s

    def _subscribed(self, session: Any) -> Any:
        return session.declare_subscriber(
            self._key,
            self._zenoh.handlers.Callback(self._came_in, indirect=False),
            allowed_origin=self._zenoh.Locality.REMOTE,
        )

    def _log_text(self, text: str) -> None:
        """Log a text that was not the last one, in the loop's thread."""
        if text == self._logged:
            return
        self._logged = text
        self._in_loop(self._log.line, text)

    def _in_loop(self, call: Callable[..., None], *arguments: Any) -> bool:
        loop = self._loop
        if loop is None:
            return False
        try:
            loop.call_soon_threadsafe(call, *arguments)
        except RuntimeError:  # it is closed: the flight is over
            return False
        return True

    # --- in Zenoh's threads ----------------------------------------------------------------------
    def _came_in(self, sample: Any) -> None:
        with contextlib.suppress(Exception):  # an exception here would go nowhere
            datagram = bytes(sample.payload)
            self._received_s = time.monotonic()
            if len(datagram) <= LARGEST_BYTES and self._waiting < MAX_WAITING:
                self._waiting += 1
                if not self._in_loop(self._pass_on, datagram):
                    self._waiting -= 1

    def _pass_on(self, datagram: bytes) -> None:
        self._waiting -= 1
        if not self._stop.is_set():
            for received in self._listeners:
                received(datagram)


def imported_zenoh() -> Any:
    """Return Zenoh, which only members of a fleet need. Raises `LinkError` if it is missing."""
    try:
        import zenoh  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise LinkError(
            f"members of a fleet need Zenoh ({error}): {install_command('fleet')}; or join a "
            "multicast group: --listen udp/224.0.0.224:7447#iface=wlan0"
        ) from None
    return zenoh


def _error_text(error: Exception) -> str:
    """Return Zenoh's error text, without the place in its sources."""
    words = " ".join(_WHERE.sub("", str(error)).split())
    return f"the network of the fleet: {words}; tried again"
