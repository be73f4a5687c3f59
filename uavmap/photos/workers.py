"""Work on many items in threads: the answers in the items' order, few at a time in memory."""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Final, Protocol, TypeVar

import cv2

from uavmap.photos.sources.picture_record import Picture

Item = TypeVar("Item")
Answer = TypeVar("Answer")


class Crew(Protocol):
    """Examines pictures: threads here, or a cluster (`uavmap.photos.cluster`)."""

    def in_order(self, work: Callable[[Item], Answer], items: Iterable[Item]) -> Iterator[Answer]:
        """Yield `work` of every item, in their order; what it raises is raised here."""
        ...

    def sent(self, picture: Picture, max_width_px: int) -> Picture:
        """Return the picture in the form that the crew can use, at least so wide."""
        ...


@dataclass(frozen=True, slots=True)
class Threads:
    """Threads of this process; None: one a core."""

    count: int | None = None

    def in_order(self, work: Callable[[Item], Answer], items: Iterable[Item]) -> Iterator[Answer]:
        """See `Crew.in_order`."""
        return in_order(work, items, self.count or worker_count())

    def sent(self, picture: Picture, max_width_px: int) -> Picture:
        """See `Crew.sent`: as it is, on this computer."""
        return picture


def worker_count() -> int:
    """Return how many cores this process may use."""
    return max(1, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1)


def thread_count(crew: Crew) -> int:
    """Return the threads for work of a crew that has to be done here."""
    return (crew.count if isinstance(crew, Threads) else None) or worker_count()


def in_order(
    work: Callable[[Item], Answer], items: Iterable[Item], workers: int
) -> Iterator[Answer]:
    """Yield `work` of every item, in their order; what it raises is raised here.

    At most `workers` + 1 answers wait, however fast the first are.

    >>> list(in_order(lambda n: n * n, range(5), workers=3))
    [0, 1, 4, 9, 16]
    """
    if workers == 1:
        yield from map(work, items)
        return
    waiting: deque[Future[Answer]] = deque()
    with ThreadPoolExecutor(workers) as pool, _ONE_THREAD_EACH:
        try:
            for item in items:
                waiting.append(pool.submit(work, item))
                if len(waiting) > workers:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()


GoOn = Callable[[], None]
"""Raises `StoppedError` once the answer is not needed any more."""


class StoppedError(Exception):
    """The answer of this work is not needed any more."""


@contextmanager
def beside(work: Callable[[GoOn], Answer]) -> Iterator[Future[Answer]]:
    """Run `work` in a thread of its own, beside the block.

    It should call its argument now and then: that ends it when the block fails, or is interrupted.

    >>> with beside(lambda go_on: 6 * 7) as answer:
    ...     answer.result()
    42
    """
    over = threading.Event()

    def go_on() -> None:
        if over.is_set():
            raise StoppedError

    with ThreadPoolExecutor(1) as pool:
        try:
            yield pool.submit(work, go_on)
        except BaseException:
            over.set()
            raise


@dataclass(slots=True)
class _OneThreadEach:
    """Takes OpenCV's own threads away, which would stand in the way of ours.

    Several may work at the same time: the last one gives OpenCV its threads back.
    """

    at_work: int = 0
    before: int = 0
    lock: threading.Lock = field(default_factory=threading.Lock)

    def __enter__(self) -> None:
        with self.lock:
            if not self.at_work:
                self.before = cv2.getNumThreads()
                cv2.setNumThreads(1)
            self.at_work += 1

    def __exit__(self, *_: object) -> None:
        with self.lock:
            self.at_work -= 1
            if not self.at_work:
                cv2.setNumThreads(self.before)


_ONE_THREAD_EACH: Final = _OneThreadEach()
