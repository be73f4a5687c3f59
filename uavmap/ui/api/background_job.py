"""A flight in a thread of its own, and how whoever waits for it interrupts it.

A flight has an event loop with a clock of its own. A notebook and an asyncio program have a loop
that runs already, and a thread can have but one. So every flight that is asked for in Python gets
a thread. Whoever waits hears Ctrl-C and cancellation, and passes them on (`Caller`): aircraft are
brought home as they are by the command, and nobody stops waiting before that is over.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any, Final, Generic, TypeVar

from missions.errors import AircraftError, UavmapError, leaves
from uavmap.runner.operator.caller import Caller
from uavmap.runner.operator.interrupts import SIGNALS

T = TypeVar("T")
Job = Callable[[Caller], T]


def waited_for(job: Job[T]) -> T:
    """Run a job in a thread of its own; returns what it returns, raises what it raises.

    SIGINT, SIGTERM and SIGHUP press on the job's caller meanwhile, where this is the program's main
    thread. `KeyboardInterrupt` when the job was interrupted, also where it came to a good end: the
    aircraft are at home then, and a program that goes on would send out the next.
    """
    work = _Work(job)
    with _pressed_by(SIGNALS, work.caller):
        work.start()
        work.done.wait()
    return work.result()


async def awaited(job: Job[T]) -> T:
    """The same for a program whose event loop runs: the loop goes on meanwhile.

    A cancellation presses on the job's caller, and is let through when the job is over. SIGTERM
    and SIGHUP press as well, where the loop is in the main thread; Ctrl-C cancels by itself.
    """
    work, loop = _Work(job), asyncio.get_running_loop()
    over = asyncio.Event()

    def tell() -> None:
        with contextlib.suppress(RuntimeError):  # the loop was closed: nobody waits any more
            loop.call_soon_threadsafe(over.set)

    cancelled: asyncio.CancelledError | None = None
    with _pressed_by(SIGNALS[1:], work.caller):
        work.start(tell)
        while not over.is_set():
            try:
                await over.wait()
            except asyncio.CancelledError as error:
                cancelled = error
                work.caller.press()
    if cancelled is not None:
        # what became of the aircraft is told with it
        with contextlib.suppress(KeyboardInterrupt):
            work.result()
        raise cancelled
    return work.result()


class _Work(Generic[T]):
    """A job and its thread."""

    def __init__(self, job: Job[T]) -> None:
        self._job = job
        self._result: list[T] = []
        self._failure: BaseException | None = None
        self.caller = Caller()
        self.done = threading.Event()

    def start(self, tell: Callable[[], None] = lambda: None) -> None:
        """Begin; `tell` is called in the job's thread when it is over.

        The thread is no daemon: a program that ends waits until the aircraft are looked after.
        """

        def run() -> None:
            try:
                self._result.append(self._job(self.caller))
            except BaseException as failure:
                self._failure = failure
            finally:
                self.done.set()
                tell()

        threading.Thread(target=run, name="uavmap flight").start()

    def result(self) -> T:
        """What the job returned; raises what it raised, without the groups of its tasks.

        Raises `KeyboardInterrupt` where it was interrupted and came to a good end all the same.
        """
        if self._failure is not None:
            failure, self._failure = self._failure, None
            raise single(failure)
        if self.caller.presses:
            raise KeyboardInterrupt("the flight was interrupted; its results are in its folder")
        return self._result[0]


def single(failure: BaseException) -> BaseException:
    """What to raise for a failure: an error of a group where all of it are errors of ours.

    The gravest is raised, an aircraft that is down before all else; the others are its notes. A
    group with a defect of the program stays as it is.

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
"""By signal, the callers that hear it: only the main thread changes this."""
_BEFORE: Final[dict[int, Any]] = {}
"""By signal, the handler that was there."""


@contextlib.contextmanager
def _pressed_by(signals: tuple[signal.Signals, ...], caller: Caller) -> Iterator[None]:
    """Meanwhile these signals press, if this is the main thread: no other one hears any."""
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
