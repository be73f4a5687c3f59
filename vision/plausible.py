"""Whether a picture can be evidence at all, before anybody asks what it shows.

A lens cap, a dead sensor, an exposure that failed and a camera that has stalled all give pictures
that decode without a fault, and a detector takes a black one for ROI from edge to edge. What no
working camera over any ground gives is refused here; whether the rest is ROI or not is for the
detector.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

DARK = 16
"""A picture with nothing brighter (0 to 255) shows no ground: sensors give some levels of noise
with the lens cap on."""

BRIGHT = 250
"""A picture with nothing darker is over-exposed."""

LEAST_SPREAD = 2
"""Levels between the darkest and the brightest pixels: a working sensor's own noise gives more, in
fog and over open water too."""

_OUTLIERS = 0.005  # the share of pixels at either end that may be defects of the sensor

Image = NDArray[np.uint8]


def implausible(image: Image, last: Image | None = None, *, noiseless: bool = False) -> str | None:
    """Why a picture is no evidence; None where it may be.

    Args:
        image: The picture, (rows, columns, 3), blue-green-red.
        last: The picture that this camera took before it. Two pictures of a working camera differ
            in every few pixels, by noise alone.
        noiseless: A simulated camera without noise gives uniform pictures of ground without
            texture, and the same picture twice when nothing moves; let it.

    >>> implausible(np.zeros((8, 8, 3), np.uint8))
    'the picture is dark all over (nothing above level 0 of 255): lens cap, or a dead sensor'
    """
    ends = [_ends(image, channel) for channel in range(image.shape[2])]
    highest = max(high for _, high in ends)
    if highest < DARK:
        return (
            f"the picture is dark all over (nothing above level {highest} of 255): lens cap, or a "
            "dead sensor"
        )
    lowest = min(low for low, _ in ends)
    if lowest > BRIGHT:
        return f"the picture is over-exposed all over (nothing below level {lowest} of 255)"
    if noiseless:
        return None
    if all(high - low < LEAST_SPREAD for low, high in ends):
        levels = ", ".join(str(low) for low, _ in ends)
        return (
            f"the picture is uniform (blue, green, red: {levels}), without even the noise of a "
            "sensor: a dead camera"
        )
    if last is not None and _same(image, last):
        return "the picture repeats the last one in every pixel: the camera has stalled"
    return None


def _ends(image: Image, channel: int) -> tuple[int, int]:
    """The levels of a channel between which all but the outliers lie."""
    counts = cv2.calcHist([image], [channel], None, [256], [0.0, 256.0]).ravel()
    below = np.cumsum(counts)
    few = _OUTLIERS * float(below[-1])
    low = int(np.searchsorted(below, few, side="right"))
    high = int(np.searchsorted(below, float(below[-1]) - few, side="left"))
    return low, high


def _same(one: Image, other: Image) -> bool:
    if one.shape != other.shape:
        return False
    middle = one.shape[0] // 2  # nearly always this row tells, and the others need not be read
    return np.array_equal(one[middle], other[middle]) and np.array_equal(one, other)
