"""A mosaic: pictures projected side by side on a raster; the steepest view of a place shows.

Each picture fades into the next. One that grows while pictures come is in `vision.growing_mosaic`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.raster import Overlay, Raster, Window

SHARPNESS: Final = 2
"""Number of times that weights are squared: the best picture shows, the others hardly."""
_ROWS: Final = 256

Colours = NDArray[np.uint8]


class Part(NamedTuple):
    """A picture on a part of a raster: colours (rows, columns, 3), and the weight of each pixel."""

    window: Window
    colours: Colours
    weight: NDArray[np.float32]


def project_picture(
    overlay: Overlay,
    raster: Raster,
    window: Window,
    picture: Callable[[], Colours | None],
    times: float = 1.0,
) -> list[Part]:
    """Project a picture onto a window of a raster.

    `picture` returns blue-green-red, of any size, `framed`, or None. It is called if the picture
    shows a part of the window. `times` is the picture's weight relative to others.
    """
    found, image = [], None
    for at, projected in () if window.is_empty else overlay.on_window(raster, window, times):
        image = picture() if image is None else image
        if image is None:
            break
        weight = projected.weight
        for _ in range(SHARPNESS):
            weight = weight * weight
        found.append(Part(at, projected.sampled(image), weight))
    return found


class Mosaic:
    """The sums of all pictures over a window of a raster."""

    def __init__(self, window: Window) -> None:
        self.window = window
        self._colours = np.zeros((*window.shape, 3), np.float32)
        self._total = np.zeros(window.shape, np.float32)

    def add(self, part: Part) -> None:
        """Add a picture on a part of the window."""
        at = part.window.within(self.window)
        shades = cv2.multiply(part.colours, cv2.merge([part.weight] * 3), dtype=cv2.CV_32F)
        for summed, more in ((self._colours, shades), (self._total, part.weight)):
            cv2.add(summed[at], more, dst=summed[at])

    def image(self) -> Colours | None:
        """Return the mosaic so far; None where no picture shows anything of the window.

        Shape (rows, columns, 4): red, green, blue, and 255 where there is a picture, else 0.
        """
        if not cv2.hasNonZero(self._total):
            return None
        found = np.empty((*self._total.shape, 4), np.uint8)
        for top in range(0, len(self._total), _ROWS):  # some rows at a time, to save memory
            rows = slice(top, top + _ROWS)
            weight = self._total[rows]
            mean = cv2.divide(self._colours[rows], cv2.merge([weight] * 3))  # 0 where none is
            blue, green, red = cv2.split(cv2.convertScaleAbs(mean))
            there = (weight > 0.0).view(np.uint8) * np.uint8(255)
            cv2.merge([red, green, blue, there], dst=found[rows])
        return found


def shrunk(image: NDArray[np.uint8], times: float) -> NDArray[np.uint8]:
    """Return an image of `times` fewer pixels along an edge, by means over squares.

    >>> shrunk(np.full((6, 9), 7, np.uint8), 3.4).shape
    (2, 3)
    """
    factor = int(times)
    if factor < 2:
        return image
    rows, columns = (max(1, side // factor) for side in image.shape[:2])
    return np.asarray(cv2.resize(image, (columns, rows), interpolation=cv2.INTER_AREA), np.uint8)
