"""Time as the event loop reports it: real, faster than real, or virtual.

A loop asks its selector to wait until the next timer. The virtual clock does not wait but moves on
to that instant. So a mission of 73 minutes runs as fast as it can be computed, always in the same
order. A scaled clock waits a fraction of the time.
"""

from __future__ import annotations

import asyncio
import contextlib
import selectors
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from typing import Any, Final, Protocol, TypeVar

T = TypeVar("T")
_STEP_S: Final = 0.2
"""Minimum wait of a time-out in real seconds, seconds of the loop."""
WINDOW_WALL_S: Final = 10.0
"""Window over which the rates of two clocks are compared, real seconds."""
OFF: Final = 1.5
"""Maximum ratio of two rates that a busy machine explains."""
_REPORTED_AT: Final = 2
"""Number of wrong windows in a row before a report: the first may contain a change of pace."""


class Clock(Protocol):
    """Source of a loop's time."""

    def now_s(self) -> float:
        """Return seconds since the clock was made."""

    def wait(self, select: _Select, timeout_s: float | None) -> _Ready:
        """Wait for a file or for the time to pass, whichever comes first."""


_Ready = list[tuple[selectors.SelectorKey, int]]
_Select = Callable[[float | None], _Ready]


class ScaledClock:
    """Real time, `speedup` times as fast, zero at `start_s` of the computer's monotonic clock."""

    def __init__(self, speedup: float = 1.0, start_s: float | None = None) -> None:
        self._speedup = speedup
        self.start_s = time.monotonic() if start_s is None else start_s

    def now_s(self) -> float:
        """Return seconds since `start_s`."""
        return (time.monotonic() - self.start_s) * self._speedup

    def wait(self, select: _Select, timeout_s: float | None) -> _Ready:
        """Wait for that time on this clock."""
        return select(None if timeout_s is None else timeout_s / self._speedup)


class VirtualClock:
    """Time that jumps to the next timer; `pace` limits it to that multiple of real time."""

    def __init__(self, pace: float | None = None) -> None:
        self._now_s = 0.0
        self._pace = pace
        self._start_s = time.monotonic()

    def now_s(self) -> float:
        """Virtual seconds since the clock was made."""
        return self._now_s

    def wait(self, select: _Select, timeout_s: float | None) -> _Ready:
        """Move on by the time-out unless a file is ready (a signal, mostly)."""
        if timeout_s is None or timeout_s <= 0:
            return select(timeout_s)
        real_s = 0.0
        if self._pace is not None:
            due_s = self._start_s + (self._now_s + timeout_s) / self._pace
            real_s = max(due_s - time.monotonic(), 0.0)
        if ready := select(real_s):
            return ready
        self._now_s += timeout_s
        return []


class _ClockSelector(selectors.DefaultSelector):
    def __init__(self, clock: Clock) -> None:
        super().__init__()
        self._clock = clock

    def select(self, timeout: float | None = None) -> _Ready:
        return self._clock.wait(super().select, timeout)


_MAIN = "uavmap's main task"


class ClockLoop(asyncio.SelectorEventLoop):
    """An event loop on a clock."""

    def __init__(self, clock: Clock) -> None:
        super().__init__(_ClockSelector(clock))
        self._clock = clock

    def time(self) -> float:
        """Return the clock's time."""
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
    """Return the task of `run` in this thread; None outside of it."""
    try:
        tasks = asyncio.all_tasks()
    except RuntimeError:
        return None
    return next((task for task in tasks if task.get_name() == _MAIN), None)


class MissionClock:
    """Mission time: the loop's, from `start_s`, the mission time at which the loop's was zero."""

    def __init__(self, start_s: float) -> None:
        self.start_s = start_s

    def now_s(self) -> float:
        """Return the mission time, in seconds."""
        return self.start_s + asyncio.get_running_loop().time()

    def set(self, now_s: float) -> None:
        """Set the mission time."""
        self.start_s = now_s - asyncio.get_running_loop().time()


@contextlib.asynccontextmanager
async def wall_timeout(seconds: float) -> AsyncIterator[None]:
    """Limit a block like `asyncio.timeout`, in real seconds: servers do not follow `--speedup`."""
    loop = asyncio.get_running_loop()
    end_s = time.monotonic() + seconds
    handle: asyncio.Handle | None = None
    async with asyncio.timeout(None) as limit:

        def look() -> None:
            nonlocal handle
            left_s = end_s - time.monotonic()
            if left_s <= 0.0:
                limit.reschedule(loop.time())
            else:  # on a fast clock it is too early then, and checks again
                handle = loop.call_later(min(max(left_s, _STEP_S), 1.0), look)

        look()
        try:
            yield
        finally:
            if handle is not None:
                handle.cancel()


class ClockRate:
    """A comparison of a vehicle's clock with the loop's, over windows in seconds of the loop.

    It shows a wrong `--speedup`, by which all times are wrong, and so is the power.

    >>> rate = ClockRate(window_s=10.0, speedup=1.0)
    >>> [fault for t in range(40) if (fault := rate.check(float(t), 3.0 * t))]
    ['its clock runs 3.0 times as fast as this flight reckons; is --speedup 3 meant?']
    """

    def __init__(self, window_s: float, speedup: float) -> None:
        self._window_s = window_s
        self._speedup = speedup
        self._begin: tuple[float, float] | None = None
        """Our time and the vehicle's at the beginning of the window."""
        self._last_s = float("-inf")
        self._wrong = 0

    def check(self, loop_s: float, boot_s: float) -> str:
        """Compare the vehicle's time; return its fault, once until the pace is right again."""
        restarted, self._last_s = boot_s < self._last_s, boot_s
        if self._begin is None or restarted:
            self._begin = (loop_s, boot_s)
            return ""
        span_s = loop_s - self._begin[0]
        if span_s < self._window_s:
            return ""
        rate = (boot_s - self._begin[1]) / span_s
        self._begin = (loop_s, boot_s)
        self._wrong = 0 if 1.0 / OFF < rate < OFF else self._wrong + 1
        if self._wrong != _REPORTED_AT or rate <= 0.0:  # the gate refuses a clock that stands still
            return ""
        return (
            f"its clock runs {rate:.1f} times as fast as this flight reckons; is --speedup "
            f"{self._speedup * rate:.2g} meant?"
        )
