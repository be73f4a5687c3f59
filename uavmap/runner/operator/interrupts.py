"""Interrupts of the operator: the first recalls all vehicles, the second leaves that to autopilots.

Only a program's main thread receives signals; `Caller.press` interrupts a flight in another one.
The present map is written before the process ends.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import signal
import threading
from collections.abc import Awaitable, Callable, Iterable, Iterator
from pathlib import Path
from types import FrameType
from typing import Final, TypeVar

from missions.errors import JournalError, leaves
from uavmap.base.clock import main_task
from uavmap.runner.service import Service

T = TypeVar("T")
PAUSE, GO_ON = signal.SIGUSR1, signal.SIGUSR2
_LOG: Final = logging.getLogger("uavmap.flight")
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Caller:
    """A caller that waits for a flight in another thread. Any thread may call `press`."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._listening: list[tuple[asyncio.AbstractEventLoop, Callable[[], object]]] = []
        """The flight's loop, and its action at a press; the innermost context is the last."""
        self._early = 0
        self.presses = 0

    def press(self) -> None:
        """Act as Ctrl-C: recall, then leave at once.

        It is kept for a flight to come, and has no effect after the flight.
        """
        with self._lock:
            self.presses += 1
            if not self._listening:
                self._early += 1
                return
            # the loop cannot be closed meanwhile: it is released under the same lock
            self._listening[-1][0].call_soon_threadsafe(self._handle_press)

    def _handle_press(self) -> None:
        if self._listening:
            self._listening[-1][1]()

    @contextlib.contextmanager
    def handling(self, act: Callable[[], object]) -> Iterator[None]:
        """Call `act` for each press, earlier ones included; only the innermost context receives
        it."""
        loop = asyncio.get_running_loop()
        with self._lock:
            self._listening.append((loop, act))
            early, self._early = self._early, 0
        for _ in range(early):
            loop.call_soon(self._handle_press)
        try:
            yield
        finally:
            with self._lock:
                self._listening.pop()

    async def until_done(self, flight: Awaitable[T]) -> T:
        """Run a flight; a press that no context receives ends it with `KeyboardInterrupt`."""
        task = asyncio.current_task()
        assert task is not None
        with self.handling(task.cancel):
            try:
                return await flight
            except asyncio.CancelledError:
                raise KeyboardInterrupt from None


@contextlib.contextmanager
def interrupts(service: Service, caller: Caller | None = None) -> Iterator[None]:
    """Recall real aircraft at the first Ctrl-C, SIGTERM, SIGHUP or press of the `caller`; then
    cancel.

    SIGUSR1 pauses the mission, SIGUSR2 continues it. Before the service has begun, or after it
    failed, the first counts as the second. Cancels the task in the context: `KeyboardInterrupt`.
    """
    loop = asyncio.get_running_loop()
    task = asyncio.current_task()
    presses = 0

    def interrupted() -> None:
        nonlocal presses
        presses += 1
        if presses == 1 and service.flying:
            _LOG.info("coming home and landing; press Ctrl-C again to leave that to the autopilots")
            service.recall()
        elif presses == 1 and service.ended and service.state.is_over:
            _LOG.info("the mission is over, its end is kept; press Ctrl-C again to leave at once")
        elif task is not None:
            task.cancel()

    with contextlib.ExitStack() as hearing:
        if caller is None:
            hearing.enter_context(_signals(loop, interrupted, service))
        else:
            hearing.enter_context(caller.handling(interrupted))
        try:
            yield
        except asyncio.CancelledError:
            raise KeyboardInterrupt from None


@contextlib.contextmanager
def like_control_c() -> Iterator[None]:
    """Let SIGTERM and SIGHUP act as Ctrl-C unless a context receives them. Only in the main
    thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    cancelled = False

    def pressed(number: int, frame: FrameType | None) -> None:
        nonlocal cancelled
        act = signal.getsignal(signal.SIGINT)
        if callable(act):
            act(number, frame)
            return
        # a job in the background ignores Ctrl-C, so the runner of the loop does not receive it
        task = main_task()
        if task is None or cancelled:
            raise KeyboardInterrupt
        cancelled = True
        task.cancel()
        task.get_loop().call_soon_threadsafe(lambda: None)  # it may be waiting

    with handled(SIGNALS[1:], pressed):
        try:
            yield
        except asyncio.CancelledError:
            if cancelled:
                raise KeyboardInterrupt from None
            raise


@contextlib.contextmanager
def handled(
    numbers: Iterable[int], handler: Callable[[int, FrameType | None], None]
) -> Iterator[None]:
    """Handle signals in the context, but for those that the process ignores."""
    received = [number for number in numbers if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, handler) for number in received}
    try:
        yield
    finally:
        for number, handler_before in before.items():
            signal.signal(number, handler_before)


@contextlib.contextmanager
def _signals(
    loop: asyncio.AbstractEventLoop, interrupted: Callable[[], None], service: Service
) -> Iterator[None]:
    before = {number: signal.getsignal(number) for number in SIGNALS}
    for number in SIGNALS:
        loop.add_signal_handler(number, interrupted)
    loop.add_signal_handler(PAUSE, service.pause)
    loop.add_signal_handler(GO_ON, service.go_on)
    try:
        yield
    finally:
        for number in (*SIGNALS, PAUSE, GO_ON):
            loop.remove_signal_handler(number)
        # the loop restores the default action, which would end the process
        for number, handler in before.items():
            signal.signal(number, handler)


# --- the map of a flight that was left before its end ---------------------------------------
def leave_map(write: Callable[[], object], failure: BaseException, folder: Path) -> None:
    """Write the present map, unless the journal was the `failure`; use `hold_signals`.

    Raises nothing: without a map, a line has its command.
    """
    found = leaves(failure) if isinstance(failure, BaseExceptionGroup) else [failure]
    if any(isinstance(error, JournalError) for error in found):
        return  # no map can be made, and the error line gives the reason
    later = f"`uavmap export {folder} --to gpkg` makes it from the journal"
    try:
        write()
    except KeyboardInterrupt:
        _LOG.info(f"the map so far is not written; {later}")
    except Exception as error:
        _LOG.info(f"the map so far cannot be written ({error}); {later}")
    else:
        _LOG.info(f"the map so far is in {folder}")


@contextlib.contextmanager
def hold_signals() -> Iterator[None]:
    """Handle the first signal that would end the process; the second ends its work.

    Enter it before any line that asks the operator, who may press again at once.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # signals belong to the main thread, which waits for this one
        return
    presses = 0

    def pressed(*_: object) -> None:
        nonlocal presses
        presses += 1
        if presses > 1:
            raise KeyboardInterrupt
        with contextlib.suppress(RuntimeError):  # it came in the middle of another line
            _LOG.info("the map so far is being written; Ctrl-C once more leaves it out")

    with handled(SIGNALS, pressed):
        yield
