"""A flight in a thread of its own, and how its caller interrupts it.

A thread can have but one event loop: a flight has its own, and so has a notebook. The caller
receives Ctrl-C and cancellation and passes them on (`Caller`): aircraft are brought home, and the
caller waits for that.
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


def waited_for(job: Job[T]) -> T:
    """Run a job in a thread of its own; return its result, raise its exception.

    In the main thread SIGINT, SIGTERM and SIGHUP press on the job's caller. An interrupted job
    raises `KeyboardInterrupt` even after a good end: a program would fly on else.
    """
    caller = Caller()
    with _pressed_by(SIGNALS, caller):
        wait([work := _begun(job, caller)])
    return _result(work, caller)


async def awaited(job: Job[T]) -> T:
    """Do as `waited_for` while the program's event loop goes on.

    A cancellation presses on the job's caller, and is let through when the job is over. In the main
    thread SIGTERM and SIGHUP press as well; Ctrl-C cancels by itself.
    """
    caller, loop, over = Caller(), asyncio.get_running_loop(), asyncio.Event()

    def tell(_: Future[T]) -> None:
        with contextlib.suppress(RuntimeError):  # the loop was closed: no caller waits any more
            loop.call_soon_threadsafe(over.set)

    cancelled: asyncio.CancelledError | None = None
    with _pressed_by(SIGNALS[1:], caller):
        work = _begun(job, caller)
        work.add_done_callback(tell)
        while not over.is_set():
            try:
                await over.wait()
            except asyncio.CancelledError as error:
                cancelled = error
                caller.press()
    if cancelled is not None:
        # the fate of the aircraft is raised with it
        with contextlib.suppress(KeyboardInterrupt):
            _result(work, caller)
        raise cancelled
    return _result(work, caller)


def _begun(job: Job[T], caller: Caller) -> Future[T]:
    """Begin a job in a thread, which is no daemon: a program that ends waits for the aircraft."""
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
    """Return what to raise for a failure: of a group of our errors the gravest, others as notes.

    An aircraft that is down comes first. A group with a defect of the program stays as it is.

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
"""By signal, the callers that receive it: only the main thread changes this."""
_BEFORE: Final[dict[int, Any]] = {}
"""By signal, the handler that was there."""


@contextlib.contextmanager
def _pressed_by(signals: tuple[signal.Signals, ...], caller: Caller) -> Iterator[None]:
    """Have these signals press meanwhile, in the main thread, which alone receives any."""
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
