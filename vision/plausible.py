"""Check of pictures: a dark, over-exposed, uniform or repeated one is no evidence.

A lens cap, a dead sensor, a failed exposure and a stalled camera give pictures that decode without
a fault. A detector takes a black one for ROI. This module rejects pictures that no working camera
gives over any ground.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

DARK = 16
"""Brightest level, 0 to 255, of a picture that shows no ground: sensors have some noise with the
lens cap on.
"""

BRIGHT = 250
"""Darkest level of an over-exposed picture."""

MIN_SPREAD = 2
"""Minimum difference of the darkest and brightest levels: a sensor's own noise gives more in
fog and over open water.
"""

_OUTLIERS = 0.005  # the share of pixels at either end that may be defects of the sensor

Image = NDArray[np.uint8]


def implausible(image: Image, last: Image | None = None, *, noiseless: bool = False) -> str | None:
    """Return the reason for which a picture is no evidence; None if it may be evidence.

    Args:
        image: Shape (rows, columns, 3), blue-green-red.
        last: The camera's picture before it. Two pictures of a working camera differ by noise
            alone.
        noiseless: Allow uniform and repeated pictures, as a simulated camera without noise gives.

    >>> implausible(np.zeros((8, 8, 3), np.uint8))
    'the picture is dark all over (nothing above level 0 of 255): lens cap, or a dead sensor'
    """
    ends = []
    for channel in range(image.shape[2]):  # nearly always the first one decides
        low, high = end = _ends(image, channel)
        ends.append(end)
        if high >= DARK and low <= BRIGHT and high - low >= MIN_SPREAD:
            break
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
    if all(high - low < MIN_SPREAD for low, high in ends):
        levels = ", ".join(str(low) for low, _ in ends)
        return (
            f"the picture is uniform (blue, green, red: {levels}), without even the noise of a "
            "sensor: a dead camera"
        )
    if last is not None and _same(image, last):
        return "the picture repeats the last one in every pixel: the camera has stalled"
    return None


def _ends(image: Image, channel: int) -> tuple[int, int]:
    """Return the levels of a channel between which all but the outliers lie."""
    counts = cv2.calcHist([image], [channel], None, [256], [0.0, 256.0]).ravel()
    below = np.cumsum(counts)
    few = _OUTLIERS * float(below[-1])
    low = int(np.searchsorted(below, few, side="right"))
    high = int(np.searchsorted(below, float(below[-1]) - few, side="left"))
    return low, high


def _same(one: Image, other: Image) -> bool:
    if one.shape != other.shape:
        return False
    middle = one.shape[0] // 2  # nearly always this row differs: the others need not be read
    return np.array_equal(one[middle], other[middle]) and np.array_equal(one, other)
