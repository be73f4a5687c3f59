"""Pictures laid side by side on the ground: a mosaic, block by block.

Where pictures overlap the one that looks down most steeply shows, and each fades into the next.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavmap.offline.surface import Shown
from uavmap.offline.workers import in_order
from vision.raster import Raster, Window

SHARPNESS: Final = 2
"""So often are the weights of the fused probability squared: the best picture shows, the others
hardly."""

Colours = NDArray[np.uint8]


class Tile(NamedTuple):
    """A picture of a mosaic, and how to come by its pixels.

    Attributes:
        shown: Where it lies; its window, which is of another raster, is not asked.
        image: Blue-green-red, of any size; None where it cannot be read. Called from any thread.
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

    def laid(tile: Tile) -> tuple[Window, Colours, NDArray[np.float32]] | None:
        part = raster.around(*tile.shown.bounds).common(window)
        laying = None if part.is_empty else tile.shown.overlay.laid(raster, part)
        image = None if laying is None else tile.image()
        if laying is None or image is None:
            return None
        weight = laying.weight
        for _ in range(SHARPNESS):
            weight = weight * weight
        return part, laying.sampled(image), weight

    for answer in in_order(laid, tiles, workers):
        if answer is None:
            continue
        part, image, weight = answer
        at = part.within(window)
        colours[at] += image * weight[..., None]
        total[at] += weight
    there = total > 0.0
    if not there.any():
        return None
    found = np.zeros((*window.shape, 4), np.uint8)
    np.divide(colours, total[..., None], out=colours, where=there[..., None])
    found[..., :3] = np.clip(np.round(colours[..., ::-1]), 0.0, 255.0)
    found[..., 3] = np.where(there, 255, 0)
    found[~there] = 0
    return found
