"""Memory of this process: what is free is given back, what stays is not looked through."""

from __future__ import annotations

import contextlib
import ctypes
import gc
from collections.abc import Iterator


def give_back() -> bool:
    """Have the C library give back what nobody uses any more; whether it is one that can.

    Many threads take memory for a moment each, and glibc keeps it for them: after the maps of 1,000
    pictures a quarter of what the process held was free.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is None:  # no glibc: others give back by themselves
        return False
    trim(0)
    return True


@contextlib.contextmanager
def set_apart() -> Iterator[None]:
    """In the block the garbage collector leaves alone what there was before it.

    These are the modules and their classes, for the most part: looking through them once more takes
    40 ms, which is a tenth of what the results of a small replay take.

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
