"""The interface of a camera for a mission: a source of pictures.

A source is started and stopped; each picture meanwhile is announced, with the time of its exposure,
and loaded on demand. Each source handles silence, vanished devices and other clocks itself; the
order notices a missing picture. A `Cadence` selects the ordered pictures of a camera that takes
them anyway.
"""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Final

from missions.units import LatLon, Quaternion
from uavmap.base.image_files import Image

Loaded = bytes | Image
"""A picture as it was loaded: a file (JPEG, PNG), or decoded."""


def nothing_came() -> bool:
    """Return False: no picture is known to have come."""
    return False


@dataclass(frozen=True, slots=True)
class ReportedPose:
    """The pose of a picture as the camera reports it; None for missing values."""

    position: LatLon | None = None
    height_m: float = 0.0
    """Height above home, m; it belongs to `position`."""
    attitude: Quaternion | None = None
    """Rotation from the camera's axes to NED."""


@dataclass(frozen=True, slots=True)
class Announcement:
    """A picture that was taken."""

    name: str
    """Name for errors."""
    taken_s: float
    """Time of the exposure on the loop's clock, s."""
    load: Callable[[], Awaitable[Loaded]]
    """Returns the picture. Raises `LinkError` if it is not available, `ImageError` if it is
    invalid."""
    index: int | None = None
    """Its number, counted by the camera without a gap; None if it cannot be requested again."""
    reported: ReportedPose = ReportedPose()
    fault: str | None = None
    """Reason why `taken_s` cannot be right, for a pose that depends on it."""
    kind: str = "picture"
    """Source of the announcement: the kind of message, for the count of refused ones."""


class FrameSource(ABC):
    """A camera. A `start` during captures begins anew.

    Pictures taken between `stop` and the next `start` are not announced.
    """

    def __init__(self) -> None:
        self._deliver: Callable[[Announcement], None] = lambda announcement: None

    def listen(self, received: Callable[[Announcement], None]) -> None:
        """Call only `received` with each picture, from the loop, in their order."""
        self._deliver = received

    @abstractmethod
    async def start(
        self, interval_s: float, count: int, coming: Callable[[], bool] = nothing_came
    ) -> None:
        """Take pictures at least `interval_s` apart; a count of 0 continues until stopped.

        `coming` returns whether pictures come, which is as good as an answer. Raises
        `CommandRefusedError` if the camera refuses, `LinkError` without an answer.
        """

    @abstractmethod
    def stop(self) -> None:
        """Stop at once, without waiting for an answer."""

    def note_end(self) -> None:  # noqa: B027 - not every camera needs it
        """Note that all pictures of a count have come: the camera has stopped by itself."""

    def uncertain(self) -> None:  # noqa: B027
        """Note that the camera's state is unknown: another process may have begun it, or it
        restarted."""

    def ask_again(self, index: int) -> None:  # noqa: B027
        """Have a lost announcement repeated, if that is possible."""


EARLY_SHARE: Final = 0.25
"""Share of the interval by which a picture may be early: no camera keeps time exactly."""
SLACK_S: Final = 0.05
"""Accuracy of a picture's time, s: one that seems older than the order by this is accepted."""


class Cadence:
    """The rhythm of an order, for a camera that takes pictures by itself."""

    def __init__(self) -> None:
        self._interval_s = 0.0
        self._left: int | None = 0
        """Number of pictures that are still wanted; None: until stopped."""
        self._due_s = 0.0
        self._early_s = SLACK_S
        self._first = True

    def start(self, now_s: float, interval_s: float, count: int) -> None:
        """Begin anew: none older than now, `interval_s` apart, `count` or, at 0, until stopped."""
        self._interval_s = interval_s
        self._left = count if count > 0 else None
        self._due_s, self._early_s, self._first = now_s, SLACK_S, True

    def stop(self) -> None:
        """Select no more."""
        self._left = 0

    def wants(self, taken_s: float) -> bool:
        """Return whether a picture of this time would be selected."""
        return self._left != 0 and taken_s >= self._due_s - self._early_s

    def selects(self, taken_s: float) -> bool:
        """Return whether it is selected; the next one is due an interval later."""
        if not self.wants(taken_s):
            return False
        if self._left is not None:
            self._left -= 1
        # keeps the rhythm; missed ones are not replaced
        next_s = self._due_s + self._interval_s
        begins = self._first or next_s <= taken_s
        self._due_s = taken_s + self._interval_s if begins else next_s
        self._first = False
        self._early_s = max(EARLY_SHARE * self._interval_s, 2.0 * SLACK_S)
        return True


class LocalSource(FrameSource):
    """A camera that is no MAVLink component: of its own pictures the ordered ones are used.

    `latency_s` is the time from an exposure until its picture is there.
    """

    def __init__(self, latency_s: float) -> None:
        super().__init__()
        self._latency_s = latency_s
        self._cadence = Cadence()

    async def start(
        self, interval_s: float, count: int, coming: Callable[[], bool] = nothing_came
    ) -> None:
        """Select pictures from now on, an interval apart."""
        self._cadence.start(asyncio.get_running_loop().time(), interval_s, count)

    def stop(self) -> None:
        """Select no more."""
        self._cadence.stop()
