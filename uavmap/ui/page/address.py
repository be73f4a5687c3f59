"""Where a page is served: a port that is bound before anything begins."""

from __future__ import annotations

import contextlib
import importlib.util
import ipaddress
import socket
from typing import Final

from missions.errors import OutputError, UavmapError
from uavmap.base.extras import install_command

PORT: Final = 8470
LOOPBACK: Final = "127.0.0.1"


def need_nicegui() -> None:
    """Raise `UavmapError` where NiceGUI is missing."""
    if importlib.util.find_spec("nicegui") is None:
        raise UavmapError(f"the live page needs NiceGUI: {install_command('page')}")


def bound(host: str, port: int, option: str) -> socket.socket:
    """Bind a port and listen; 0 for any that is free. `option` is how the port is given.

    Raises `OutputError` where the port is taken, or the host is none of this computer.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    try:
        # else the port of a page that has just ended could not be had for a minute
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((host, port))
        listening.listen(64)
    except (OSError, OverflowError) as error:
        listening.close()
        reason = getattr(error, "strerror", None) or error
        raise OutputError(
            f"{option}: the page cannot be served on {host} port {port} ({reason}); give another "
            f"port, or `{option} 0` for any that is free"
        ) from None
    return listening


def shown(host: str) -> str:
    """The host to put into a URL: of all addresses, the one that others reach this computer by."""
    with contextlib.suppress(ValueError):
        if not ipaddress.ip_address(host).is_unspecified:
            return f"[{host}]" if ":" in host else host
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, contextlib.suppress(OSError):
        probe.connect(("192.0.2.1", 9))  # nothing is sent: it only chooses a network
        return str(probe.getsockname()[0])
    return LOOPBACK
