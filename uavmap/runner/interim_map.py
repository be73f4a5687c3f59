"""The map of a flight that was left before its end: from its journal, before the process ends."""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from missions.errors import JournalError, leaves
from uavmap.runner.operator.interrupts import SIGNALS, handled

_LOG: Final = logging.getLogger("uavmap.flight")


def leave_map(write: Callable[[], object], failure: BaseException, folder: Path) -> None:
    """Write what is known; call it `patiently`, when nobody depends on this process any more.

    `failure` is why the flight has ended. Raises nothing: where the map cannot be written, or the
    operator does not wait for it, a line has the command that makes it.
    """
    found = leaves(failure) if isinstance(failure, BaseExceptionGroup) else [failure]
    if any(isinstance(error, JournalError) for error in found):
        return  # there is nothing to make a map from, and the line says what is wrong with it
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
def patiently() -> Iterator[None]:
    """The first signal that would end the process is answered, the second does end what it does.

    From before anything is said of how it goes on: whoever reads that may press again at once.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # signals are the main thread's, who waits for this one
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
