"""One browser has the controls; the others watch, and may request them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

ASK_S: Final = 10.0
"""Time without an answer after which the controls pass to the browser that requests them, s."""
GONE_S: Final = 10.0
"""Time without contact after which a browser loses the controls, s."""


@dataclass(frozen=True, slots=True)
class Request:
    """A browser's request for the controls."""

    visitor: str
    since_s: float


class Controls:
    """The right of one browser to run commands.

    >>> controls = Controls(now_s=lambda: 0.0)
    >>> controls.note("a"), controls.are_held_by("a"), controls.are_held_by("b")
    (None, True, False)
    """

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._holder: str | None = None
        self._seen_s: dict[str, float] = {}
        self._request: Request | None = None

    def note(self, visitor: str) -> None:
        """Note that a browser is in contact. If no browser has the controls, it gets them.

        The controls pass to a browser that has requested them if the holder does not answer for
        `ASK_S`.
        """
        now_s = self._now_s()
        self._seen_s[visitor] = now_s
        gone = self._holder is None or self._is_gone(self._holder, now_s)
        if self._request is not None and self._is_gone(self._request.visitor, now_s):
            self._request = None
        if self._request is not None and (gone or now_s - self._request.since_s >= ASK_S):
            self._holder, self._request = self._request.visitor, None
        elif gone:
            self._holder = visitor

    def _is_gone(self, visitor: str, now_s: float) -> bool:
        return now_s - self._seen_s.get(visitor, -math.inf) > GONE_S

    def forget(self, visitor: str) -> None:
        """Forget a browser that is closed."""
        self._seen_s.pop(visitor, None)
        if self._holder == visitor:
            self._holder = None
        if self._request is not None and self._request.visitor == visitor:
            self._request = None

    def are_held_by(self, visitor: str) -> bool:
        """Return whether a browser has the controls."""
        return self._holder == visitor

    def request(self, visitor: str) -> None:
        """Request the controls for a browser."""
        if self._holder != visitor and self._request is None:
            self._request = Request(visitor, self._now_s())

    @property
    def are_requested(self) -> bool:
        """True if a browser has requested the controls and waits for the answer."""
        return self._request is not None

    def are_requested_by(self, visitor: str) -> bool:
        """Return whether this browser has requested the controls and waits for the answer."""
        return self._request is not None and self._request.visitor == visitor

    def answer(self, visitor: str, *, yes: bool) -> None:
        """Give the controls to the other browser, or keep them: the holder's answer."""
        if self._holder == visitor and self._request is not None:
            self._holder = self._request.visitor if yes else visitor
            self._request = None
