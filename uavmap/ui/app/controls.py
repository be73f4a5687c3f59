"""One browser holds the controls; the others watch, and may ask for them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

ASK_S: Final = 10.0
"""Time after which controls pass to the browser that asks, if the holder says nothing, s."""
GONE_S: Final = 10.0
"""Time without a sign after which a browser no longer holds the controls, s."""


@dataclass(frozen=True, slots=True)
class Asks:
    """A browser that asks for the controls."""

    visitor: str
    since_s: float


class Controls:
    """Which browser may run commands.

    >>> controls = Controls(now_s=lambda: 0.0)
    >>> controls.seen("a"), controls.held_by("a"), controls.held_by("b")
    (None, True, False)
    """

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._holder: str | None = None
        self._seen_s: dict[str, float] = {}
        self._asks: Asks | None = None

    def seen(self, visitor: str) -> None:
        """Note that a browser is there: the first one holds the controls, and again once all left.

        Controls pass to a browser that has asked, if their holder says nothing for `ASK_S`.
        """
        now_s = self._now_s()
        self._seen_s[visitor] = now_s
        gone = self._holder is None or self._is_gone(self._holder, now_s)
        if self._asks is not None and self._is_gone(self._asks.visitor, now_s):
            self._asks = None
        if self._asks is not None and (gone or now_s - self._asks.since_s >= ASK_S):
            self._holder, self._asks = self._asks.visitor, None
        elif gone:
            self._holder = visitor

    def _is_gone(self, visitor: str, now_s: float) -> bool:
        return now_s - self._seen_s.get(visitor, -math.inf) > GONE_S

    def left(self, visitor: str) -> None:
        """Note that a browser is closed."""
        self._seen_s.pop(visitor, None)
        if self._holder == visitor:
            self._holder = None
        if self._asks is not None and self._asks.visitor == visitor:
            self._asks = None

    def held_by(self, visitor: str) -> bool:
        """Return whether a browser holds the controls."""
        return self._holder == visitor

    def ask(self, visitor: str) -> None:
        """Ask for the controls."""
        if self._holder != visitor and self._asks is None:
            self._asks = Asks(visitor, self._now_s())

    def asked_s(self) -> float | None:
        """Return for how long another browser has asked; None where none does."""
        return None if self._asks is None else self._now_s() - self._asks.since_s

    def asks(self, visitor: str) -> bool:
        """Return whether a browser has asked, and has no answer yet."""
        return self._asks is not None and self._asks.visitor == visitor

    def answer(self, visitor: str, *, yes: bool) -> None:
        """Hand the controls over, or keep them: the holder's answer."""
        if self._holder == visitor and self._asks is not None:
            self._holder = self._asks.visitor if yes else visitor
            self._asks = None
