"""What all cameras have in common that take pictures without being told, on this computer."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from uavmap.aircraft.cameras.cadence import Cadence
from uavmap.aircraft.cameras.source import Announcement, never


class LocalSource:
    """A camera that is no MAVLink component: what it takes anyway is taken when it is ordered.

    `latency_s` is from an exposure until its picture is there.
    """

    def __init__(self, latency_s: float) -> None:
        self._latency_s = latency_s
        self._cadence = Cadence()
        self._heard: Callable[[Announcement], None] = lambda announcement: None

    def listen(self, heard: Callable[[Announcement], None]) -> None:
        """Call `heard` with each picture."""
        self._heard = heard

    async def start(
        self, interval_s: float, count: int, coming: Callable[[], bool] = never
    ) -> None:
        """Take those pictures from now on that an interval lies between."""
        self._cadence.start(asyncio.get_running_loop().time(), interval_s, count)

    def stop(self) -> None:
        """Take no more."""
        self._cadence.stop()

    def ended(self) -> None:
        """A count ends by itself here."""

    def uncertain(self) -> None:
        """It is always known what this camera does."""

    def ask_again(self, index: int) -> None:
        """Nothing is lost on the way from this camera."""
