"""One judged picture of a flight or a replay, with the region that the detector marks."""

from __future__ import annotations

from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

FILE: Final = "judged.jpg"
"""Name in the results: the first picture with region in it, or else the first one at all."""
MAX_WIDE_PX: Final = 1000
RED: Final = (0, 0, 255)  # blue, green, red
_QUALITY: Final = 85


def outlined(image: NDArray[np.uint8], region: NDArray[Any]) -> bytes:
    """Draw the outline of `region` (not 0) into a BGR picture; return a small JPEG."""
    columns = min(image.shape[1], MAX_WIDE_PX)
    rows = max(1, round(image.shape[0] * columns / image.shape[1]))
    small = cv2.resize(image, (columns, rows), interpolation=cv2.INTER_AREA)
    whole = (np.asarray(region) > 0).astype(np.uint8)
    marked = cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_NEAREST)
    outline(small, marked, RED, max(2, columns // 400))
    _, data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return bytes(data)


def outline(
    drawn: NDArray[Any], marked: NDArray[Any], colour: tuple[int, ...], wide_px: int = 2
) -> None:
    """Draw the outline of the marked pixels, (rows, columns), into a picture of that size."""
    lines, _ = cv2.findContours(marked.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(drawn, lines, -1, colour, wide_px)
