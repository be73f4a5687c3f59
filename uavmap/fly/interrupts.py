"""An operator who interrupts: everybody comes home; a second time the autopilots see to that."""

from __future__ import annotations

import asyncio
import contextlib
import signal
from collections.abc import Callable, Iterator
from typing import Protocol

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Recallable(Protocol):
    """What is needed of a service."""

    @property
    def flying(self) -> bool:
        """Whether it has begun."""
        ...

    def recall(self) -> None:
        """Bring everybody home."""
        ...


@contextlib.contextmanager
def interrupts(service: Recallable, say: Callable[[str], None]) -> Iterator[None]:
    """While real aircraft are flown: Ctrl-C, SIGTERM or SIGHUP once recalls, a second time cancels.

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
            say("coming home and landing; press Ctrl-C again to leave that to the autopilots")
            service.recall()
        elif task is not None:
            task.cancel()

    for number in SIGNALS:
        loop.add_signal_handler(number, interrupted)
    try:
        yield
    except asyncio.CancelledError:
        raise KeyboardInterrupt from None
    finally:
        for number in SIGNALS:
            loop.remove_signal_handler(number)
