"""What to do where memory runs out: a line, whichever library was the first to find out."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import cv2
import shapely

from missions.errors import UavmapError


@contextlib.contextmanager
def memory_told(what: str, remedy: str) -> Iterator[None]:
    """Say in a line that memory ran out in the block; other errors pass.

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
