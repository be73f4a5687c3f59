"""An operator who interrupts: everybody comes home; a second time the autopilots see to that."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from types import FrameType
from typing import Final

from uavmap.base.clock import main_task
from uavmap.runner.operator.caller import Caller
from uavmap.runner.operator.steered import Steered

PAUSE, GO_ON = signal.SIGUSR1, signal.SIGUSR2
_LOG: Final = logging.getLogger("uavmap.flight")
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextlib.contextmanager
def interrupts(service: Steered, caller: Caller | None = None) -> Iterator[None]:
    """While real aircraft are flown: Ctrl-C, SIGTERM or SIGHUP once recalls, a second time cancels.

    SIGUSR1 pauses the mission, SIGUSR2 lets it go on. A flight in a thread of its own hears its
    `caller` instead of signals, which are the main thread's.

    Cancels the task that entered the context, out of which comes `KeyboardInterrupt` then. Before
    the service has begun the first time counts as the second.
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
        elif task is not None:
            task.cancel()

    with contextlib.ExitStack() as hearing:
        if caller is None:
            hearing.enter_context(_signals(loop, interrupted, service))
        else:
            hearing.enter_context(caller.heard(interrupted))
        try:
            yield
        except asyncio.CancelledError:
            raise KeyboardInterrupt from None


@contextlib.contextmanager
def like_control_c() -> Iterator[None]:
    """SIGTERM and SIGHUP do what Ctrl-C does, where nothing else hears them: no signal ends the
    process without a word. Only in the main thread, whose signals are."""
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
        # a job in the background has Ctrl-C ignored, so the runner of the loop does not hear it
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
    """Handle signals meanwhile, but for those that the process ignores."""
    heard = [number for number in numbers if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, handler) for number in heard}
    try:
        yield
    finally:
        for number, handler_before in before.items():
            signal.signal(number, handler_before)


@contextlib.contextmanager
def _signals(
    loop: asyncio.AbstractEventLoop, interrupted: Callable[[], None], service: Steered
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
        for number, handler in before.items():  # the loop leaves what would end the process
            signal.signal(number, handler)
