"""Many pictures' probabilities on one raster.

The fused probability is the weighted mean over the pictures that show a place. Pictures of the same
ground are no independent evidence (all have the same shadow), so log-odds are not added.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.detectors.interface import Marks
from vision.raster import Window

UNSEEN: Final = 255
MOST: Final = 254
"""Levels of a probability: 0 to `MOST`; `UNSEEN` where no picture shows the place."""

SMOOTH_PX: Final = 1.0
"""Standard deviation of the smoothing of the sums, pixels of the raster."""
HALO_PX: Final = 4
"""Reach of the smoothing around a window, pixels."""
_ROWS: Final = 256  # smoothed at once: all would take as much memory once more

Levels = NDArray[np.uint8]


class Fusion:
    """The sums over a window of a raster; a place counts as seen in at least `least` pictures."""

    def __init__(self, window: Window, least: int = 1) -> None:
        self.window, self._least = window.grown(HALO_PX), least
        self._count = np.zeros(self.window.shape, np.uint8)
        self._sum = np.zeros(self.window.shape, np.float32)
        self._weight = np.zeros(self.window.shape, np.float32)

    def add(self, part: Window, levels: NDArray[np.uint8], weight: NDArray[np.float32]) -> None:
        """Add a picture on a part of the window: levels 0 to 255, and its weight."""
        at = part.within(self.window)
        product = cv2.multiply(levels, weight, dtype=cv2.CV_32F)
        for total, more in ((self._sum, product), (self._weight, weight)):
            cv2.add(total[at], more, dst=total[at])
        count = self._count[at]  # it stops at 255
        cv2.add(count, (weight > 0.0).view(np.uint8), dst=count)

    def levels(self) -> Levels:
        """Return the fused probability of the window, 0 to `MOST`, or `UNSEEN`."""
        rows, columns = self.window.shape
        found = np.full((rows - 2 * HALO_PX, columns - 2 * HALO_PX), UNSEEN, np.uint8)
        for top in range(HALO_PX, rows - HALO_PX, _ROWS):
            bottom = min(top + _ROWS, rows - HALO_PX)
            seen = self._count[top:bottom, HALO_PX:-HALO_PX] >= self._least
            if seen.any():
                into = found[top - HALO_PX : bottom - HALO_PX]
                np.copyto(into, self._smoothed(top, bottom), where=seen)
        return found

    def _smoothed(self, top: int, bottom: int) -> Levels:
        """Return the levels of some rows, without the halo at their ends."""
        total, weight = (
            np.asarray(
                cv2.GaussianBlur(
                    sums[top - HALO_PX : bottom + HALO_PX],
                    (5, 5),
                    SMOOTH_PX,
                    borderType=cv2.BORDER_REPLICATE,
                )[HALO_PX:-HALO_PX, HALO_PX:-HALO_PX],
                np.float32,
            )
            for sums in (self._sum, self._weight)
        )
        weight[weight <= 0.0] = 1.0
        np.multiply(total, np.float32(MOST / 255.0), out=total)
        np.divide(total, weight, out=total)
        return np.rint(total, out=total).astype(np.uint8)


def as_levels(marks: Marks, shrinks_px: int = 0) -> NDArray[np.uint8]:
    """Return a detector's marks as 0 to 255, a mask grown by `shrinks_px`.

    >>> as_levels(np.array([[0, 255, 0, 0]], np.uint8), 1).tolist()
    [[255, 255, 255, 0]]
    >>> as_levels(np.array([[0.0, 0.2, 1.0]], np.float32)).tolist()
    [[0, 51, 255]]
    """
    if marks.dtype != np.uint8:
        return np.round(marks * np.float32(255.0)).astype(np.uint8)
    if not shrinks_px:
        return np.asarray(marks, dtype=np.uint8)
    kernel = np.ones((3, 3), np.uint8)
    return np.asarray(cv2.dilate(marks, kernel, iterations=shrinks_px), dtype=np.uint8)
