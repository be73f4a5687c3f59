"""A lock of a folder for one program, which the system ends with the program."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

LOCK: Final = ".lock"
"""File that is locked on systems without locks of folders (Windows)."""


def locked(folder: Path) -> int:
    """Lock a folder for this process; return a file to close.

    Raises `BlockingIOError` if another process has it, `OSError` if it cannot be opened.
    """
    file = os.open(*((folder, os.O_RDONLY) if fcntl else (folder / LOCK, os.O_RDWR | os.O_CREAT)))
    try:
        if fcntl:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        else:
            import msvcrt  # noqa: PLC0415 - on Windows alone

            try:
                msvcrt.locking(file, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
            except OSError as error:
                raise BlockingIOError(*error.args) from None
    except OSError:
        os.close(file)
        raise
    return file
