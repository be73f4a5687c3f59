"""Time as the event loop tells it: real, faster than real, or virtual.

Nothing in the service knows which. A loop asks its selector to wait until the next timer; the
virtual clock does not wait but moves on to that instant, so a 73-minute mission runs as fast as
it can be computed, in an order that depends on nothing but the program. A scaled clock waits a
fraction of the time.
"""

from __future__ import annotations

import asyncio
import selectors
import time
from collections.abc import Coroutine, Mapping
from typing import Any, Protocol, TypeVar

T = TypeVar("T")


class Clock(Protocol):
    """Where a loop's time comes from."""

    def now_s(self) -> float:
        """Seconds since the clock was made."""
        ...

    def wait(self, selector: selectors.BaseSelector, timeout_s: float | None) -> _Ready:
        """Wait for a file or for the time to pass, whichever comes first."""
        ...


_Ready = list[tuple[selectors.SelectorKey, int]]


class ScaledClock:
    """Real time, `speedup` times as fast. Speed-up 1 is the ordinary clock."""

    def __init__(self, speedup: float = 1.0) -> None:
        self._speedup = speedup
        self._start_s = time.monotonic()

    def now_s(self) -> float:
        """Seconds since the clock was made."""
        return (time.monotonic() - self._start_s) * self._speedup

    def wait(self, selector: selectors.BaseSelector, timeout_s: float | None) -> _Ready:
        """Wait as long as that takes on this clock."""
        return selector.select(None if timeout_s is None else timeout_s / self._speedup)


class VirtualClock:
    """Time that jumps to the next timer; with `pace`, no faster than so many times real time."""

    def __init__(self, pace: float | None = None) -> None:
        self._now_s = 0.0
        self._pace = pace
        self._start_s = time.monotonic()

    def now_s(self) -> float:
        """Virtual seconds since the clock was made."""
        return self._now_s

    def wait(self, selector: selectors.BaseSelector, timeout_s: float | None) -> _Ready:
        """Move on by the time-out unless a file is ready (a signal, mostly)."""
        if timeout_s is None or timeout_s <= 0:
            return selector.select(timeout_s)
        real_s = 0.0
        if self._pace is not None:
            due_s = self._start_s + (self._now_s + timeout_s) / self._pace
            real_s = max(due_s - time.monotonic(), 0.0)
        if ready := selector.select(real_s):
            return ready
        self._now_s += timeout_s
        return []


class _ClockSelector(selectors.BaseSelector):
    """A selector that waits by a clock."""

    def __init__(self, clock: Clock) -> None:
        self._inner = selectors.DefaultSelector()
        self._clock = clock

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        return self._inner.register(fileobj, events, data)

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        return self._inner.unregister(fileobj)

    def modify(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        return self._inner.modify(fileobj, events, data)

    def select(self, timeout: float | None = None) -> _Ready:
        return self._clock.wait(self._inner, timeout)

    def close(self) -> None:
        self._inner.close()

    def get_map(self) -> Mapping[Any, selectors.SelectorKey]:
        return self._inner.get_map()


_MAIN = "uavmap's main task"


class ClockLoop(asyncio.SelectorEventLoop):
    """An event loop on a clock."""

    def __init__(self, clock: Clock) -> None:
        super().__init__(_ClockSelector(clock))
        self._clock = clock

    def time(self) -> float:
        """The clock's time."""
        return self._clock.now_s()


def run(main: Coroutine[Any, Any, T], clock: Clock) -> T:
    """Run a coroutine to its end on a clock, as `asyncio.run` does.

    >>> async def nap() -> float:
    ...     await asyncio.sleep(3600.0)
    ...     return asyncio.get_running_loop().time()
    >>> run(nap(), VirtualClock())
    3600.0
    """
    with asyncio.Runner(loop_factory=lambda: ClockLoop(clock)) as runner:
        return runner.run(_named(main))


async def _named(main: Coroutine[Any, Any, T]) -> T:
    if (task := asyncio.current_task()) is not None:
        task.set_name(_MAIN)
    return await main


def main_task() -> asyncio.Task[Any] | None:
    """What `run` runs in this thread; None outside of it."""
    try:
        tasks = asyncio.all_tasks()
    except RuntimeError:
        return None
    return next((task for task in tasks if task.get_name() == _MAIN), None)
