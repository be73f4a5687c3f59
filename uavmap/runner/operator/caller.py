"""A flight as another thread interrupts it.

Only a program's main thread receives signals. A flight in another thread is interrupted by
`press`, which does what Ctrl-C does.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Awaitable, Callable, Iterator
from typing import Any, Protocol, TypeVar

T = TypeVar("T")


class Steered(Protocol):
    """A service, as an operator steers it."""

    @property
    def state(self) -> Any:
        """What the mission knows: `vehicles` by their numbers."""

    @property
    def flying(self) -> bool:
        """Whether the flight has begun, and is not over."""

    @property
    def ended(self) -> bool:
        """Whether nothing is taken in any more."""

    def pause(self) -> bool:
        """Have all vehicles hold."""

    def go_on(self) -> bool:
        """End a pause."""

    def recall(self) -> None:
        """Call all vehicles home."""

    def recall_vehicle(self, number: int) -> bool:
        """Call one vehicle home."""

    def skip_cell(self, number: int) -> bool:
        """Leave out the cell that a vehicle observes, or is to observe."""

    def land_here(self, number: int) -> bool:
        """Have a vehicle land where it is."""


class Caller:
    """Who waits for a flight in another thread. `press` may be called from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._listening: list[tuple[asyncio.AbstractEventLoop, Callable[[], object]]] = []
        """The flight's loop, and what it does at a press; the innermost context is the last."""
        self._early = 0
        self.presses = 0
        """How often the caller has interrupted."""

    def press(self) -> None:
        """Do as Ctrl-C: a first time recall, a second time leave at once.

        Before the flight it is kept for it; after its end it does nothing.
        """
        with self._lock:
            self.presses += 1
            if not self._listening:
                self._early += 1
                return
            # the loop cannot be closed meanwhile: it is let go of under the same lock
            self._listening[-1][0].call_soon_threadsafe(self._pressed)

    def _pressed(self) -> None:
        if self._listening:
            self._listening[-1][1]()

    @contextlib.contextmanager
    def heard(self, act: Callable[[], object]) -> Iterator[None]:
        """Call `act` for each press, earlier ones included; the innermost context hears."""
        loop = asyncio.get_running_loop()
        with self._lock:
            self._listening.append((loop, act))
            early, self._early = self._early, 0
        for _ in range(early):
            loop.call_soon(self._pressed)
        try:
            yield
        finally:
            with self._lock:
                self._listening.pop()

    async def until_done(self, flight: Awaitable[T]) -> T:
        """Run a flight; a press that nothing in it hears ends it with `KeyboardInterrupt`."""
        task = asyncio.current_task()
        assert task is not None
        with self.heard(task.cancel):
            try:
                return await flight
            except asyncio.CancelledError:
                raise KeyboardInterrupt from None
