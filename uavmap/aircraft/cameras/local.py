"""Cameras that take pictures without being told, on this computer: what they have in common.

Which of the pictures that come anyway are those that were ordered is decided by a `Cadence`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Final

from uavmap.aircraft.cameras.source import FrameSource, never

EARLY: Final = 0.25
"""A picture may be early by this share of the interval: no camera keeps time exactly."""
SLACK_S: Final = 0.05
"""What the time of a picture is known to: of one that seems older than the order by no more."""


class Cadence:
    """The rhythm of an order, for a camera that takes pictures without being told.

    >>> cadence = Cadence()
    >>> cadence.start(10.0, 1.0, 2)
    >>> [t_s for t_s in (9.9, 10.1, 10.5, 11.0, 12.0) if cadence.take(t_s)]
    [10.1, 11.0]
    """

    def __init__(self) -> None:
        self._interval_s = 0.0
        self._left: int | None = 0
        """Pictures that are still wanted; None: until stopped."""
        self._due_s = 0.0
        self._early_s = SLACK_S
        self._first = True

    def start(self, now_s: float, interval_s: float, count: int) -> None:
        """Begin anew: none older than now; so far apart, and so many, or 0 until stopped."""
        self._interval_s = interval_s
        self._left = count if count > 0 else None
        self._due_s, self._early_s, self._first = now_s, SLACK_S, True

    def stop(self) -> None:
        """No more."""
        self._left = 0

    def wants(self, taken_s: float) -> bool:
        """Whether a picture of this time would be taken."""
        return self._left != 0 and taken_s >= self._due_s - self._early_s

    def take(self, taken_s: float) -> bool:
        """Whether it is taken; the next one is due an interval later."""
        if not self.wants(taken_s):
            return False
        if self._left is not None:
            self._left -= 1
        # keeps the rhythm; what was missed is not made up for
        next_s = self._due_s + self._interval_s
        begins = self._first or next_s <= taken_s
        self._due_s = taken_s + self._interval_s if begins else next_s
        self._first = False
        self._early_s = max(EARLY * self._interval_s, 2.0 * SLACK_S)
        return True


class LocalSource(FrameSource):
    """A camera that is no MAVLink component: what it takes anyway is taken when it is ordered.

    `latency_s` is from an exposure until its picture is there.
    """

    def __init__(self, latency_s: float) -> None:
        super().__init__()
        self._latency_s = latency_s
        self._cadence = Cadence()

    async def start(
        self, interval_s: float, count: int, coming: Callable[[], bool] = never
    ) -> None:
        """Take those pictures from now on that an interval lies between."""
        self._cadence.start(asyncio.get_running_loop().time(), interval_s, count)

    def stop(self) -> None:
        """Take no more."""
        self._cadence.stop()
