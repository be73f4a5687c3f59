"""The people on the ground: a battery is swapped, everybody stands clear, take-off is allowed.

At a terminal the service asks and waits for Enter. Elsewhere nobody can answer: the vehicles that
wait stay on the ground, and `uavmap resume` is the word to go on.
"""

from __future__ import annotations

import asyncio
import contextlib
import sys
import termios
from collections.abc import Awaitable, Callable
from typing import TextIO


class Crew:
    """Asks for battery swaps, one at a time."""

    def __init__(
        self, say: Callable[[str], None], *, automatic: bool, stream: TextIO | None = None
    ) -> None:
        self._say = say
        self._automatic = automatic
        self._stream: TextIO | None = stream or sys.stdin
        self._asking = asyncio.Lock()
        self.waiting: set[int] = set()
        self.enter: Callable[[], Awaitable[bool]] = self._entered
        """Waits for Enter, pressed after the question; False when the terminal is gone."""

    @property
    def absent(self) -> bool:
        """Whether nobody will ever answer."""
        if self._automatic:
            return False
        return self._stream is None or not self._stream.isatty()

    async def swap(self, vehicle: int) -> None:
        """Returns when the battery of a vehicle is swapped and it may take off again."""
        if self._automatic:
            return
        self.waiting.add(vehicle)
        try:
            if self.absent:
                self._say(f"vehicle {vehicle} waits on the ground for a fresh battery")
                await asyncio.Event().wait()
            async with self._asking:
                self._say(
                    f"vehicle {vehicle} has landed: swap its battery, stand clear, press Enter; "
                    "it takes off by itself"
                )
                if not await self.enter():
                    await asyncio.Event().wait()
        finally:
            self.waiting.discard(vehicle)

    async def _entered(self) -> bool:
        """Wait for Enter; False when the terminal is gone, which is nobody's word."""
        if self._stream is None:
            return False
        loop, file = asyncio.get_running_loop(), self._stream.fileno()
        readable = asyncio.Event()
        with contextlib.suppress(termios.error):
            termios.tcflush(file, termios.TCIFLUSH)  # what was typed before is no answer
        loop.add_reader(file, readable.set)
        try:
            await readable.wait()
            return self._stream.readline().endswith("\n")
        except OSError:
            return False
        finally:
            loop.remove_reader(file)
