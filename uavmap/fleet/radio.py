"""What carries datagrams between members."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from uavmap.fleet.sealing import Seal


class Radio(Protocol):
    """Carries datagrams to whoever can hear them; any may be lost, doubled, or come late."""

    @property
    def overhead_bytes(self) -> int:
        """What a datagram takes on the way besides itself."""

    def send(self, datagram: bytes) -> None:
        """Send to all. Never raises, never waits."""

    def listen(self, heard: Callable[[bytes], None]) -> None:
        """Have what comes in passed on, in the event loop's thread."""


@dataclass(frozen=True, slots=True)
class SealedRadio:
    """How one member of a fleet speaks with the others."""

    radio: Radio
    seal: Seal


@dataclass(frozen=True, slots=True)
class Radios:
    """Several as one: each carries everything. Without any it is silent."""

    parts: Sequence[Radio] = ()

    @property
    def overhead_bytes(self) -> int:
        """That of the dearest."""
        return max((radio.overhead_bytes for radio in self.parts), default=0)

    def send(self, datagram: bytes) -> None:
        """Send by each."""
        for radio in self.parts:
            radio.send(datagram)

    def listen(self, heard: Callable[[bytes], None]) -> None:
        """Have what comes in by any passed on."""
        for radio in self.parts:
            radio.listen(heard)
