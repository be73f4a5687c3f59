"""Pictures of a camera that fails: black ones, and files that are no whole JPEG."""

from __future__ import annotations

from collections import OrderedDict
from typing import Literal

import cv2
import numpy as np

_KEPT = 400
_JPEG_QUALITY = 90


class Spoiler:
    """Remembers which pictures were taken while the camera failed."""

    def __init__(self) -> None:
        self._how: OrderedDict[str, Literal["black", "corrupt"]] = OrderedDict()

    def note(self, url: str, how: Literal["black", "corrupt"]) -> None:
        """The picture announced under `url` is spoilt."""
        self._how[url] = how
        if len(self._how) > _KEPT:
            self._how.popitem(last=False)

    def spoil(self, url: str, jpeg: bytes) -> bytes:
        """What the camera gives for a picture; itself when it was taken well."""
        how = self._how.get(url)
        if how is None:
            return jpeg
        return black(jpeg) if how == "black" else broken(jpeg)


def black(jpeg: bytes) -> bytes:
    """A black picture of the same size with the same metadata."""
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    if picture is None:
        raise ValueError("not a JPEG")
    night = np.zeros_like(picture)
    done, data = cv2.imencode(".jpg", night, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    if not done:
        raise RuntimeError("OpenCV could not encode a black frame")
    encoded = bytes(data)
    return encoded[:2] + _metadata(jpeg) + encoded[2:]


def broken(jpeg: bytes) -> bytes:
    """As a write that was cut short leaves it: the first half.

    >>> broken(bytes(8))
    b'\\x00\\x00\\x00\\x00'
    """
    return jpeg[: len(jpeg) // 2]


def _metadata(jpeg: bytes) -> bytes:
    """The segments APP1 (EXIF, XMP) of a JPEG."""
    found, at = b"", 2
    while at + 4 <= len(jpeg) and jpeg[at] == 0xFF and jpeg[at + 1] in range(0xE0, 0xF0):
        size = 2 + int.from_bytes(jpeg[at + 2 : at + 4], "big")
        if jpeg[at + 1] == 0xE1:
            found += jpeg[at : at + size]
        at += size
    return found
