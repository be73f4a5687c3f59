"""Distinctive points of a picture: SIFT, spread evenly, whatever the exposure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.registration.views import Features

WIDTH_PX: Final = 700
"""Widest picture that is registered, pixels: finer detail costs time and adds nothing to a pose."""

MOST: Final = 1200
"""Most points of a picture."""

_COLUMNS, _ROWS = 10, 6  # of the lattice of buckets that points are spread over
_LOCAL_PX = (61, 61)  # contrast is measured over so much
_NOISE = 4.0  # gray levels; contrast below it is noise, and is not raised to the level of texture
_RIM_PX = 4.0
_LEAST_PX = 32  # a smaller picture has no room for features


def extract(gray: NDArray[np.uint8]) -> Features:
    """Return the features of a gray picture of at most `WIDTH_PX` columns; maybe none.

    >>> extract(np.full((90, 160), 100, np.uint8)).points.shape
    (0, 2)
    """
    height, width = gray.shape
    nothing = Features(np.zeros((0, 2)), np.zeros((0, 128), np.uint8), width, height)
    if min(height, width) < _LEAST_PX:
        return nothing
    sift = cv2.SIFT.create(nfeatures=0, contrastThreshold=0.02, edgeThreshold=12.0)
    even = _normalised(gray)
    found = [k for k in sift.detect(even, None) if _inside(k.pt, width, height)]
    if not found:
        return nothing
    points = np.array([k.pt for k in found])
    chosen = _spread(points, np.array([k.response for k in found]), width, height)
    # descriptors cost most: only of those that are kept
    kept, descriptors = sift.compute(even, [found[k] for k in chosen])
    middle = np.array([(width - 1) / 2.0, (height - 1) / 2.0])
    return Features(
        np.array([k.pt for k in kept]) - middle,
        _rooted(np.asarray(descriptors, dtype=np.float32)),
        width,
        height,
    )


def thumbnail(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture (rows, columns[, 3]) in gray, at most `WIDTH_PX` wide."""
    gray = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    height, width = gray.shape
    if width > WIDTH_PX:
        size = (WIDTH_PX, max(1, round(height * WIDTH_PX / width)))
        gray = cv2.resize(gray, size, interpolation=cv2.INTER_AREA)
    return np.asarray(gray, dtype=np.uint8)


def _inside(point: Sequence[float], width: int, height: int) -> bool:
    x, y = point
    return _RIM_PX < x < width - 1 - _RIM_PX and _RIM_PX < y < height - 1 - _RIM_PX


def _normalised(gray: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Even out mean and contrast, so that exposure and haze matter little."""
    values = gray.astype(np.float32)
    mean = cv2.blur(values, _LOCAL_PX)
    spread = np.sqrt(cv2.blur(np.square(values - mean), _LOCAL_PX))
    scaled = 128.0 + 45.0 * (values - mean) / np.maximum(spread, _NOISE)
    whole: NDArray[np.uint8] = np.clip(np.round(scaled), 0, 255).astype(np.uint8)
    return whole


def _spread(
    points: NDArray[np.float64], strength: NDArray[np.float64], width: int, height: int
) -> NDArray[np.int64]:
    """Return the strongest of each bucket, in an order that depends on the points alone."""
    column = np.clip(points[:, 0] * _COLUMNS / width, 0, _COLUMNS - 1).astype(int)
    row = np.clip(points[:, 1] * _ROWS / height, 0, _ROWS - 1).astype(int)
    bucket = row * _COLUMNS + column
    order = np.lexsort((points[:, 1], points[:, 0], -strength, bucket))
    starts = np.searchsorted(bucket[order], np.arange(_COLUMNS * _ROWS))
    rank = np.arange(len(order)) - starts[bucket[order]]
    by_rank = np.lexsort((np.arange(len(order)), rank))
    chosen: NDArray[np.int64] = np.sort(order[by_rank[:MOST]])
    return chosen


def _rooted(descriptors: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return square roots of the histograms (RootSIFT), as whole numbers.

    Their products are exact in float32, in whatever order they are added.
    """
    total = np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-6)
    scaled = np.round(512.0 * np.sqrt(descriptors / total))
    rooted: NDArray[np.uint8] = np.clip(scaled, 0, 255).astype(np.uint8)
    return rooted
