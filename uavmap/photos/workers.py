"""Work on many pictures, in threads or on a Dask cluster, with answers in the items' order.

Few items are in memory at a time. On a cluster a picture's bytes travel with it: workers need
neither the files nor the detector's, only the same version of uavmap. The map is the same, byte for
byte. Dask gives the work of a dead worker to another.
"""

from __future__ import annotations

import os
import pickle
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, Final, NamedTuple, Protocol, Self, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.errors import ImageError, StudyError, UavmapError
from uavmap.base.extras import dask_client
from uavmap.base.opencv_threads import ONE_THREAD_EACH
from uavmap.base.version import __version__
from uavmap.photos.sources.photo_file import FileContent, decoded
from uavmap.photos.sources.picture_record import Picture

Item = TypeVar("Item")
Answer = TypeVar("Answer")


class Crew(Protocol):
    """Examines pictures: `Threads` here, or a `Cluster`."""

    def in_order(self, work: Callable[[Item], Answer], items: Iterable[Item]) -> Iterator[Answer]:
        """Yield the answer of `work` to every item, in order; errors of `work` are raised here."""
        ...

    def sent(self, picture: Picture, max_width_px: int) -> Picture:
        """Return the picture in the form that the crew needs, at least that wide."""
        ...


@dataclass(frozen=True, slots=True)
class Threads:
    """Threads of this process; None for one a core.

    >>> list(Threads(3).in_order(lambda n: n * n, range(5)))
    [0, 1, 4, 9, 16]
    """

    count: int | None = None

    def in_order(self, work: Callable[[Item], Answer], items: Iterable[Item]) -> Iterator[Answer]:
        """See `Crew.in_order`. At most `count` + 1 answers wait, however fast the first are."""
        workers = self.count or worker_count()
        if workers == 1:
            yield from map(work, items)
            return
        waiting: deque[Future[Answer]] = deque()
        with ThreadPoolExecutor(workers) as pool, ONE_THREAD_EACH:
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

    def sent(self, picture: Picture, max_width_px: int) -> Picture:
        """See `Crew.sent`: unchanged, on this computer."""
        return picture


def worker_count() -> int:
    """Return the number of cores that this process may use."""
    return max(1, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1)


def threads_of(crew: Crew) -> Threads:
    """Return the threads for the work of a crew that runs here."""
    return crew if isinstance(crew, Threads) else Threads()


# --- a cluster -----------------------------------------------------------------------------------
MAX_WAITING: Final = 64
"""Maximum number of pictures under way, on a cluster of any size."""
NO_WORKER_S: Final = 60.0
"""Maximum time without any worker, s."""
_ASK_S: Final = 2.0


class Travelling(NamedTuple):
    """A `Content` on its way: the bytes of a picture's file, its pixels, or a fault."""

    data: bytes | NDArray[np.uint8] | NDArray[np.uint16]
    size_bytes: int
    sha256: str = ""
    fault: str = ""

    def digest(self) -> str:
        """See `Content.digest`."""
        return self.sha256

    def decode(self, max_width_px: int) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """See `Content.decode`. Pixels that travel have the right size already."""
        if self.fault:
            raise ImageError(self.fault)
        return decoded(self.data, max_width_px) if isinstance(self.data, bytes) else self.data


@dataclass(slots=True)
class Cluster:
    """A Dask cluster that examines pictures; a context manager.

    Raises `StudyError` if it cannot be reached or has no worker. It also does if a worker has
    another version of uavmap, or if the scheduler or the last worker stops.
    """

    address: str
    _client: Any = field(default=None, repr=False)
    _distributed: Any = field(default=None, repr=False)

    def __enter__(self) -> Self:
        self._client = dask_client(self.address)
        import distributed  # noqa: PLC0415 - an extra, which is there: a client was made

        self._distributed = distributed
        try:
            self._check_workers()
        except BaseException:
            self._client.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._client.close()

    def in_order(self, work: Callable[[Item], Answer], items: Iterable[Item]) -> Iterator[Answer]:
        """Yield the answer of `work` to every item, in order; both must be picklable."""
        packed = pickle.dumps(work)
        waiting: deque[Any] = deque()
        most = min(2 * self._threads() + 1, MAX_WAITING)
        import dask  # noqa: PLC0415 - an extra

        quiet = {"distributed.admin.large-graph-warning-threshold": "1GB"}
        try:
            with dask.config.set(quiet):
                for item in items:
                    waiting.append(self._client.submit(_worked, packed, item, pure=False))
                    if len(waiting) >= most:
                        yield self._answer(waiting.popleft())
                while waiting:
                    yield self._answer(waiting.popleft())
        finally:
            for future in waiting:
                future.release()

    def sent(self, picture: Picture, max_width_px: int) -> Picture:
        """See `Crew.sent`: files are sent as they are, frames of videos decoded."""
        content = picture.content
        try:
            data = (
                content.read() if isinstance(content, FileContent) else content.decode(max_width_px)
            )
            going = Travelling(data, content.size_bytes)
        except ImageError as error:
            going = Travelling(b"", content.size_bytes, fault=str(error))
        return replace(picture, content=going)

    def _answer(self, future: Any) -> Any:
        lonely_s: float | None = None
        while True:
            try:
                return future.result(timeout=_ASK_S)
            except UavmapError:
                raise
            except self._distributed.KilledWorker:
                raise self._fault(
                    "a picture has ended several workers; is their memory enough? Replay without "
                    "--scheduler shows which"
                ) from None
            except TimeoutError:
                if self._client.status == "closed":
                    raise self._fault("the scheduler has stopped") from None
                now_s = time.monotonic()
                lonely_s = None if self._threads() else (lonely_s or now_s)
                if lonely_s is not None and now_s - lonely_s > NO_WORKER_S:
                    raise self._fault(f"its last worker has stopped; {self._start}") from None
            except (self._distributed.CancelledError, OSError):
                raise self._fault("the scheduler has stopped") from None

    @property
    def _start(self) -> str:
        return f"start some: dask worker {self.address}"

    def _fault(self, text: str) -> StudyError:
        return StudyError(f"--scheduler {self.address}: {text}")

    def _threads(self) -> int:
        try:
            return int(sum(self._client.nthreads().values()))
        except (OSError, TimeoutError):
            raise self._fault("the scheduler has stopped") from None

    def _check_workers(self) -> None:
        if not self._threads():
            raise self._fault(f"it has no worker; {self._start}")
        try:
            versions = self._client.run(_version)
        except Exception as error:  # any error may come back from a worker
            raise self._fault(
                f"its workers cannot run uavmap ({type(error).__name__}: {error}); install uavmap "
                f"{__version__} there"
            ) from None
        for worker, version in sorted(versions.items()):
            if version != __version__:
                raise self._fault(
                    f"{worker} has uavmap {version}, this computer has {__version__}; install "
                    "one version everywhere"
                )


# --- on a worker ---------------------------------------------------------------------------------
def _version() -> str:
    return __version__


@lru_cache(maxsize=4)
def _unpacked(packed: bytes) -> Callable[[Any], Any]:
    """Return one object for all pictures of a replay: it keeps its computed values."""
    cv2.setNumThreads(1)
    work: Callable[[Any], Any] = pickle.loads(packed)
    return work


def _worked(packed: bytes, item: Any) -> Any:
    return _unpacked(packed)(item)
