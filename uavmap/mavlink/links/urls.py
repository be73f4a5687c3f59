"""Connection URLs in the styles of MAVSDK and of pymavlink.

MAVSDK                              pymavlink, MAVProxy
udpin://0.0.0.0:14540               udpin:0.0.0.0:14550   udp:127.0.0.1:14550 (listens)
udpout://192.168.1.12:14550         udpout:192.168.1.12:14550
tcpout://192.168.1.12:5760          tcp:192.168.1.12:5760
tcpin://0.0.0.0:5760                tcpin:0.0.0.0:5760
serial:///dev/ttyACM0:57600         /dev/ttyACM0,57600

`?system=2` at the end selects one of several vehicles on a URL.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Literal

from missions.errors import LinkError

Transport = Literal["udpin", "udpout", "tcpin", "tcpout", "serial"]

_SYNONYMS: dict[str, Transport] = {
    "udp": "udpin",
    "udpin": "udpin",
    "udpout": "udpout",
    "tcp": "tcpout",
    "tcpout": "tcpout",
    "tcpin": "tcpin",
    "serial": "serial",
}
_NETWORK = re.compile(r"(?P<scheme>[a-z]+):(//)?(?P<host>\[[^\]]*\]|[^:/]*):(?P<port>\d+)/?")
_SERIAL_URL = re.compile(r"serial:(//)?(?P<device>[^:]+)(:(?P<baud>\d+))?")
_SERIAL_PATH = re.compile(r"(?P<device>/dev/[^,]+|COM\d+)(,(?P<baud>\d+))?")
_WHICH = re.compile(r"system=(?P<system>\d{1,3})")
DEFAULT_BAUD = 57600


@dataclass(frozen=True, slots=True)
class Endpoint:
    """The address of a vehicle. `host` is a device path and `port` a baud rate for serial."""

    transport: Transport
    host: str
    port: int
    system: int | None = None
    """System id of the vehicle; None: the first that is received."""

    @property
    def url(self) -> str:
        """The URL in MAVSDK's style."""
        host = f"[{self.host}]" if ":" in self.host else self.host  # an IPv6 address
        which = "" if self.system is None else f"?system={self.system}"
        return f"{self.transport}://{host}:{self.port}{which}"

    @property
    def port_of_all(self) -> Endpoint:
        """The same for any system: several vehicles may share it."""
        return replace(self, system=None)


def parse_url(url: str) -> Endpoint:
    """Return the endpoint of a URL. Raises `LinkError` with the remedy.

    >>> parse_url("udp:127.0.0.1:14550")
    Endpoint(transport='udpin', host='127.0.0.1', port=14550, system=None)
    >>> parse_url("/dev/ttyACM0,115200").url
    'serial:///dev/ttyACM0:115200'
    >>> parse_url("udpin://0.0.0.0:14550?system=2").system
    2
    """
    text, _, which = url.strip().partition("?")
    endpoint = _parsed(url, text)
    if "?" not in url:
        return endpoint
    found = _WHICH.fullmatch(which)
    if found is None or not 0 < int(found["system"]) < 256:
        raise LinkError(f"{url!r}: behind the ? stands system=N, with a system id of 1 to 255")
    return replace(endpoint, system=int(found["system"]))


def _parsed(url: str, text: str) -> Endpoint:
    if match := _SERIAL_PATH.fullmatch(text) or _SERIAL_URL.fullmatch(text):
        baud = int(match["baud"] or DEFAULT_BAUD)
        if baud == 0:
            raise LinkError(f"{url!r}: the baud rate must be positive (default {DEFAULT_BAUD})")
        return Endpoint("serial", match["device"], baud)
    match = _NETWORK.fullmatch(text)
    transport = _SYNONYMS.get(match["scheme"]) if match else None
    if match is None or transport is None or transport == "serial":
        raise LinkError(
            f"{url!r} is not a connection URL; write udpin://0.0.0.0:14550, "
            "udpout://HOST:PORT, tcpout://HOST:PORT or serial:///dev/ttyACM0:57600"
        )
    host, port = match["host"].strip("[]"), int(match["port"])
    if not 0 < port < 65536:
        raise LinkError(f"{url!r}: port {port} is not between 1 and 65535")
    if not host:
        raise LinkError(f"{url!r} names no host; write {transport}://0.0.0.0:{port}")
    if transport in ("udpout", "tcpout") and host == "0.0.0.0":
        raise LinkError(
            f"{url!r}: nothing can be sent to 0.0.0.0; name the vehicle's address, or listen "
            f"with {transport.replace('out', 'in')}://0.0.0.0:{port}"
        )
    return Endpoint(transport, host, port)
