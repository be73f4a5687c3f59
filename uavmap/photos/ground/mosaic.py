"""Pictures laid side by side on the ground: a mosaic, block by block.

Where pictures overlap the one that looks down most steeply shows, and each fades into the next.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from uavmap.photos.ground.surface import Shown
from uavmap.photos.workers import in_order
from vision.raster import Raster, Window

SHARPNESS: Final = 2
"""So often are the weights of the fused probability squared: the best picture shows, the others
hardly."""

_ROWS: Final = 256

Colours = NDArray[np.uint8]


class Tile(NamedTuple):
    """A picture of a mosaic, and how to come by its pixels.

    Attributes:
        shown: Where it lies; its window, which is of another raster, is not asked.
        image: Blue-green-red, of any size, `framed`; None where it cannot be read. Called from any
            thread.
    """

    shown: Shown
    image: Callable[[], Colours | None]


def mosaic(raster: Raster, window: Window, tiles: Iterable[Tile], workers: int) -> Colours | None:
    """A window of a mosaic; None where no picture shows anything of it.

    Args:
        raster: In the grid's moving frame.
        window: Of it.
        tiles: The pictures that may show something of the window.
        workers: How many threads; the result is the same.

    Returns:
        Shape (rows, columns, 4), uint8: red, green, blue, and 255 where there is a picture, else 0.
    """
    colours = np.zeros((*window.shape, 3), np.float32)
    total = np.zeros(window.shape, np.float32)

    def laid(tile: Tile) -> list[tuple[Window, Colours, NDArray[np.float32]]]:
        part = raster.around(*tile.shown.bounds).common(window)
        found, image = [], None
        for at, laying in () if part.is_empty else tile.shown.overlay.laid(raster, part):
            image = tile.image() if image is None else image
            if image is None:
                break
            weight = laying.weight
            for _ in range(SHARPNESS):
                weight = weight * weight
            found.append((at, laying.sampled(image), weight))
        return found

    for answer in in_order(laid, tiles, workers):
        for part, image, weight in answer:
            at = part.within(window)
            shades = cv2.multiply(image, cv2.merge([weight] * 3), dtype=cv2.CV_32F)
            for summed, more in ((colours, shades), (total, weight)):
                cv2.add(summed[at], more, dst=summed[at])
    return _means(colours, total)


def _means(colours: NDArray[np.float32], total: NDArray[np.float32]) -> Colours | None:
    """Sums of colours by their weights, as `mosaic` returns them; some rows at a time, or it would
    take as much memory once more."""
    if not cv2.hasNonZero(total):
        return None
    found = np.empty((*total.shape, 4), np.uint8)
    for top in range(0, len(total), _ROWS):
        weight, into = total[top : top + _ROWS], found[top : top + _ROWS]
        mean = cv2.divide(colours[top : top + _ROWS], cv2.merge([weight] * 3))  # 0 where none is
        blue, green, red = cv2.split(cv2.convertScaleAbs(mean))
        there = (weight > 0.0).view(np.uint8) * np.uint8(255)
        cv2.merge([red, green, blue, there], dst=into)
    return found
