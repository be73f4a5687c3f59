"""A flight in its own thread, and its interruption by the caller.

A thread can have only one event loop, and both a flight and a notebook need one. The caller
receives Ctrl-C and cancellation and passes them on (`Caller`): the aircraft return, and the caller
waits for that.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, wait
from types import FrameType
from typing import Any, Final, TypeVar

from missions.errors import AircraftError, UavmapError, leaves
from uavmap.runner.operator.interrupts import SIGNALS, Caller

T = TypeVar("T")
Job = Callable[[Caller], T]


def run_blocking(job: Job[T]) -> T:
    """Run a job in its own thread; return its result, or raise its exception.

    In the main thread SIGINT, SIGTERM and SIGHUP press on the job's caller. An interrupted job
    raises `KeyboardInterrupt` even after a good end: else the program would fly the next mission.
    """
    caller = Caller()
    with _pressed_by(SIGNALS, caller):
        wait([work := _begun(job, caller)])
    return _result(work, caller)


async def run_async(job: Job[T]) -> T:
    """Run a job as `run_blocking` does, while the program's event loop continues.

    A cancellation presses on the job's caller, and is raised when the job is over. In the main
    thread SIGTERM and SIGHUP press as well; Ctrl-C is a cancellation there.
    """
    caller, loop, over = Caller(), asyncio.get_running_loop(), asyncio.Event()

    def on_end(_: Future[T]) -> None:
        with contextlib.suppress(RuntimeError):  # the loop is closed: no caller waits any more
            loop.call_soon_threadsafe(over.set)

    cancelled: asyncio.CancelledError | None = None
    with _pressed_by(SIGNALS[1:], caller):
        work = _begun(job, caller)
        work.add_done_callback(on_end)
        while not over.is_set():
            try:
                await over.wait()
            except asyncio.CancelledError as error:
                cancelled = error
                caller.press()
    if cancelled is not None:
        # an error about aircraft that are not at home is raised instead
        with contextlib.suppress(KeyboardInterrupt):
            _result(work, caller)
        raise cancelled
    return _result(work, caller)


def _begun(job: Job[T], caller: Caller) -> Future[T]:
    """Start a job in a thread. It is no daemon: a program that ends waits for the aircraft."""
    work: Future[T] = Future()

    def run() -> None:
        try:
            work.set_result(job(caller))
        except BaseException as failure:
            work.set_exception(failure)

    threading.Thread(target=run, name="uavmap flight").start()
    return work


def _result(work: Future[T], caller: Caller) -> T:
    """Return the job's result, or raise its exception; `KeyboardInterrupt` after an interrupt."""
    if (failure := work.exception()) is not None:
        raise single(failure)
    if caller.presses:
        raise KeyboardInterrupt("the flight was interrupted; its results are in its folder")
    return work.result()


def single(failure: BaseException) -> BaseException:
    """Return the exception to raise: of a group of our errors the gravest, others as notes.

    An aircraft that is down is the gravest. A group with a defect of the program stays a group.

    >>> from missions.errors import LinkError
    >>> single(ExceptionGroup("tasks", [LinkError("silent"), AircraftError("vehicle 1 is down")]))
    AircraftError('vehicle 1 is down')
    """
    if not isinstance(failure, BaseExceptionGroup):
        return failure
    found = leaves(failure)
    interrupts = [error for error in found if isinstance(error, KeyboardInterrupt)]
    if interrupts:
        return interrupts[0]
    if not all(isinstance(error, UavmapError) for error in found):
        return failure
    first, *others = sorted(found, key=lambda error: not isinstance(error, AircraftError))
    for other in others:
        first.add_note(str(other))
    return first


# --- signals -------------------------------------------------------------------------------------
_LISTENING: Final[dict[int, list[Caller]]] = {}
"""Callers that receive each signal; only the main thread changes this."""
_BEFORE: Final[dict[int, Any]] = {}
"""Former handler of each signal."""


@contextlib.contextmanager
def _pressed_by(signals: tuple[signal.Signals, ...], caller: Caller) -> Iterator[None]:
    """Press on a caller for these signals, in the main thread: other threads receive none."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    for number in signals:
        if number not in _LISTENING:
            _BEFORE[number] = signal.signal(number, _on_signal)
        _LISTENING.setdefault(number, []).append(caller)
    try:
        yield
    finally:
        for number in signals:
            _LISTENING[number].remove(caller)
            if not _LISTENING[number]:
                del _LISTENING[number]
                signal.signal(number, _BEFORE.pop(number) or signal.SIG_DFL)


def _on_signal(number: int, _: FrameType | None) -> None:
    for caller in list(_LISTENING.get(number, ())):
        caller.press()
