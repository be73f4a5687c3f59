"""Where members of a fleet reach each other: `tcp/HOST:PORT`, `udp/HOST:PORT`, a multicast group.

The notation is Zenoh's. A multicast group names its interface, so nothing is sent by another one.
"""

from __future__ import annotations

import ipaddress
import re
from dataclasses import dataclass
from typing import Final

from missions.errors import LinkError

_ENDPOINT: Final = re.compile(
    r"(?P<transport>[a-z]+)/(?P<host>\[[0-9A-Fa-f:.%]+\]|[^\[\]:/#?]+):(?P<port>\d{1,5})"
    r"(#iface=(?P<interface>[^#;=\s]{1,15}))?"
)
_SHAPE: Final = "tcp/192.168.7.11:7447, udp/192.168.7.11:7447, or udp/224.0.0.224:7447#iface=wlan0"


@dataclass(frozen=True, slots=True)
class FleetEndpoint:
    """One of them."""

    transport: str
    """tcp or udp."""
    host: str
    port: int
    interface: str | None = None

    @property
    def multicast(self) -> bool:
        """Whether it is a group, which all hear who have joined it."""
        try:
            return ipaddress.ip_address(self.host).is_multicast
        except ValueError:  # a name
            return False

    @property
    def url(self) -> str:
        """As Zenoh writes it."""
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
