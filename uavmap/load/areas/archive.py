"""Zip archives that hold an area; the unpacked size is limited."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from typing import Final

from missions.errors import AreaError
from uavmap.load.areas.drawing import MAX_BYTES

_END: Final = b"PK\x05\x06"
_END_SIZE: Final = 22
_LONGEST_COMMENT: Final = 65_535
_LARGEST_DIRECTORY: Final = 1_000_000


def check_archive(data: bytes, source: str) -> None:
    """Raise `AreaError` for bytes that are no zip archive, or whose directory is too large."""
    damaged = AreaError(f"{source}: a damaged zip archive; pack it anew")
    at = data.rfind(_END, max(0, len(data) - _LONGEST_COMMENT - _END_SIZE))
    if at < 0 or len(data) - at < _END_SIZE:
        raise damaged
    (directory_bytes,) = struct.unpack_from("<I", data, at + 12)
    if directory_bytes > _LARGEST_DIRECTORY:
        raise AreaError(f"{source}: an archive of too many files; pack the area alone")
    try:
        zipfile.ZipFile(io.BytesIO(data)).close()
    except (zipfile.BadZipFile, NotImplementedError, OSError, ValueError, struct.error):
        raise damaged from None


def read_member(archive: zipfile.ZipFile, name: str, source: str) -> bytes:
    """Return the content of one file of an archive.

    Raises `AreaError`, before it unpacks more than `MAX_BYTES`.
    """
    try:
        with archive.open(name) as file:
            data = file.read(MAX_BYTES + 1)
    except RuntimeError:
        raise AreaError(
            f"{source}: {name[:40]!r} in it needs a password; pack it without"
        ) from None
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, EOFError, OSError, ValueError):
        raise AreaError(f"{source}: {name[:40]!r} in it cannot be unpacked; pack it anew") from None
    if len(data) > MAX_BYTES:
        raise AreaError(
            f"{source}: {name[:40]!r} in it unpacks to more than {MAX_BYTES // 1_000_000} MB"
        )
    return data
