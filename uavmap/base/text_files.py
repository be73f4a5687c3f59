"""Text from files that a user names: ordinary files of a limited size."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path


def read_text(path: Path, most_bytes: int) -> str:
    """Return a text in UTF-8, without a byte order mark. Raises `OSError`, `UnicodeDecodeError`."""
    return read_bytes(path, most_bytes).decode("utf-8-sig")


def read_bytes(path: Path, most_bytes: int) -> bytes:
    """Return the bytes of an ordinary file; a device or a pipe may be endless, and is not opened.

    Raises `OSError` with a readable `strerror` for another kind of file, or one too large.
    """
    try:
        found = path.stat()
    except ValueError as error:  # a mission file can name one with a null byte
        raise OSError(errno.EINVAL, f"no name of a file: {error}") from None
    if stat.S_ISDIR(found.st_mode):
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, "not an ordinary file")
    with path.open("rb") as file:
        data = file.read(most_bytes + 1)  # files in /proc have no size
    if len(data) > most_bytes:
        raise OSError(errno.EFBIG, f"larger than {most_bytes // 1_000_000} MB")
    return data
