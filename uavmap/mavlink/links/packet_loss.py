"""How much of what a vehicle sends is lost on its way, by the numbers of its frames."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

Message = Any  # pymavlink carries no types

_GAP: Final = 128
"""A number that is farther ahead is one of a frame that came late, or of a sender that restarted:
frames are numbered with a byte."""


@dataclass(slots=True)
class Losses:
    """Frames heard and missing, by (system, component) that sent them."""

    heard: dict[tuple[int, int], int] = field(default_factory=dict)
    missing: dict[tuple[int, int], int] = field(default_factory=dict)
    _last: dict[tuple[int, int], int] = field(default_factory=dict)

    def take(self, message: Message) -> None:
        """Count a frame, whatever is in it."""
        sender = message.get_srcSystem(), message.get_srcComponent()
        sequence = message.get_seq()
        last = self._last.get(sender)
        self.heard[sender] = self.heard.get(sender, 0) + 1
        gap = 0 if last is None else (sequence - last - 1) % 256
        if gap >= _GAP:  # overtaken on its way: it was counted as missing
            self.missing[sender] = max(self.missing.get(sender, 0) - 1, 0)
            return
        self.missing[sender] = self.missing.get(sender, 0) + gap
        self._last[sender] = sequence

    def counts(self, sender: tuple[int, int]) -> tuple[int, int]:
        """How many frames of a sender were heard, and how many of its numbers were missing."""
        return self.heard.get(sender, 0), self.missing.get(sender, 0)
