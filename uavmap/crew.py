"""The people on the ground: a battery is swapped, everybody stands clear, take-off is allowed.

At a terminal the service asks and waits for Enter. Elsewhere nobody can answer: the vehicles that
wait stay on the ground, and `uavmap resume` is the word to go on.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable
from typing import TextIO


class Crew:
    """Asks for battery swaps, one at a time."""

    def __init__(
        self, say: Callable[[str], None], *, automatic: bool, stream: TextIO | None = None
    ) -> None:
        self._say = say
        self._automatic = automatic
        self._stream = stream or sys.stdin
        self._asking = asyncio.Lock()
        self.waiting: set[int] = set()

    @property
    def absent(self) -> bool:
        """Whether nobody will ever answer."""
        return not self._automatic and not self._stream.isatty()

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
                await self._line()
        finally:
            self.waiting.discard(vehicle)

    async def _line(self) -> None:
        """Wait for a line from the operator."""
        loop = asyncio.get_running_loop()
        entered = asyncio.Event()
        loop.add_reader(self._stream.fileno(), entered.set)
        try:
            await entered.wait()
            self._stream.readline()
        finally:
            loop.remove_reader(self._stream.fileno())
