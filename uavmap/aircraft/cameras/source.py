"""What a mission needs of a camera, whatever it is: a source of pictures.

A source is started and stopped; each picture meanwhile is announced, with the time of its exposure,
and loaded on demand. Silence, devices that vanish and other clocks are its own matter; a missing
picture is noticed by the order. A `Cadence` selects the ordered pictures of a camera that takes
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


def never() -> bool:
    """Nothing is known to have come."""
    return False


@dataclass(frozen=True, slots=True)
class ToldPose:
    """The pose of a picture as the camera reports it; None for what it does not report."""

    position: LatLon | None = None
    height_m: float = 0.0
    """Above home; it belongs to `position`."""
    attitude: Quaternion | None = None
    """From the camera's axes to NED."""


@dataclass(frozen=True, slots=True)
class Announcement:
    """A picture that was taken."""

    name: str
    """What to call it in an error."""
    taken_s: float
    """When it was exposed, on the loop's clock."""
    load: Callable[[], Awaitable[Loaded]]
    """The picture. Raises `LinkError` where it cannot be had, `ImageError` where it is none."""
    index: int | None = None
    """Its number, counted by the camera without a gap; None where none could be asked for again."""
    told: ToldPose = ToldPose()
    fault: str | None = None
    """Why `taken_s` cannot be right, for a pose that depends on it."""
    kind: str = "picture"
    """What announced it: the kind of message, for the count of what was refused."""


class FrameSource(ABC):
    """A camera. A `start` while pictures are taken begins anew; nothing is announced that was taken
    between `stop` and the next `start`."""

    def __init__(self) -> None:
        self._heard: Callable[[Announcement], None] = lambda announcement: None

    def listen(self, heard: Callable[[Announcement], None]) -> None:
        """Call `heard`, and nothing else, with each picture, from the loop, in their order."""
        self._heard = heard

    @abstractmethod
    async def start(
        self, interval_s: float, count: int, coming: Callable[[], bool] = never
    ) -> None:
        """Take pictures, so far apart or somewhat more; a count of 0 goes on until stopped.

        `coming` says that pictures are seen to come, which is as good as an answer. Raises
        `CommandRefusedError` where the camera refuses, `LinkError` where nothing answers.
        """

    @abstractmethod
    def stop(self) -> None:
        """Take no more; at once, and without waiting for an answer."""

    def ended(self) -> None:  # noqa: B027 - not every camera has to be told
        """All pictures of a count have come: it has stopped by itself."""

    def uncertain(self) -> None:  # noqa: B027
        """Nobody knows what it does: another process may have begun it, or it restarted."""

    def ask_again(self, index: int) -> None:  # noqa: B027
        """Have a lost announcement repeated, if that is possible."""


EARLY: Final = 0.25
"""A picture may be early by this share of the interval: no camera keeps time exactly."""
SLACK_S: Final = 0.05
"""What the time of a picture is known to: of one that seems older than the order by no more."""


class Cadence:
    """The rhythm of an order, for a camera that takes pictures by itself."""

    def __init__(self) -> None:
        self._interval_s = 0.0
        self._left: int | None = 0
        """Pictures that are still wanted; None: until stopped."""
        self._due_s = 0.0
        self._early_s = SLACK_S
        self._first = True

    def start(self, now_s: float, interval_s: float, count: int) -> None:
        """Begin anew: none older than now, `interval_s` apart, `count` or, at 0, until stopped."""
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
    `latency_s` passes from an exposure until its picture is there."""

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
