"""What carries datagrams between members."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol


class Radio(Protocol):
    """Carries datagrams to whoever can hear them; any may be lost, doubled, or come late."""

    def send(self, datagram: bytes) -> None:
        """Send to all. Never raises, never waits."""
        ...

    def listen(self, heard: Callable[[bytes], None]) -> None:
        """Have what comes in passed on, in the event loop's thread."""
        ...
