"""Memory of this process: free memory is returned, permanent objects are not collected.

Where it runs out, a line says so, whichever library notices first.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
from collections.abc import Iterator

import cv2
import shapely

from missions.errors import UavmapError


def give_back() -> None:
    """Have the C library return free memory to the system, where it can.

    Many threads take memory for a moment each, and glibc keeps it for them: after the maps of 1,000
    pictures a quarter of the process's memory was free.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:  # glibc; others give back by themselves
        trim(0)


@contextlib.contextmanager
def set_apart() -> Iterator[None]:
    """Exclude existing objects from garbage collection in the block.

    These are mostly modules and their classes: visiting them takes 40 ms, a tenth of what the
    results of a small replay take.

    >>> with set_apart():
    ...     gc.get_freeze_count() > 0
    True
    """
    if gc.get_freeze_count():  # somebody has done so already, and for longer
        yield
        return
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


@contextlib.contextmanager
def memory_told(what: str, remedy: str) -> Iterator[None]:
    """Report memory that runs out in the block in a line; other errors pass.

    >>> with memory_told("the map is not written", "map fewer pictures"):
    ...     raise MemoryError
    Traceback (most recent call last):
    missions.errors.UavmapError: memory ran out: the map is not written; map fewer pictures
    """
    try:
        yield
    except Exception as error:
        if not ran_out(error):
            raise
        raise UavmapError(f"memory ran out: {what}; {remedy}") from None


def ran_out(error: BaseException) -> bool:
    """Whether an error says that there was no memory left, in Python, NumPy, OpenCV or GEOS.

    >>> ran_out(MemoryError()), ran_out(RuntimeError("can't start new thread")), ran_out(KeyError())
    (True, True, False)
    """
    if isinstance(error, MemoryError):
        return True
    if isinstance(error, cv2.error):
        return error.code == cv2.Error.StsNoMem or "bad_alloc" in str(error)
    if isinstance(error, shapely.errors.GEOSException):
        return "bad_alloc" in str(error)
    # a stack is memory, too
    return isinstance(error, RuntimeError) and "can't start new thread" in str(error)
