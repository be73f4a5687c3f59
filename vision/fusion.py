"""Many pictures' probabilities on one raster.

At each place the fused probability is the mean over the pictures that show it, each with its
weight. Pictures of the same ground are no independent evidence (the same shadow is in all of
them), so their log-odds are not added up; where they disagree, as at an edge that errors of the
poses shift, the mean lies in between, and tells so.
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
"""Standard deviation of the smoothing of the sums, in pixels of the raster."""
HALO_PX: Final = 4
"""So far around a window its smoothing reaches."""
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
        """Take in a picture on a part of the window: 0 to 255, and its weight."""
        at = part.within(self.window)
        product = cv2.multiply(levels, weight, dtype=cv2.CV_32F)
        for total, more in ((self._sum, product), (self._weight, weight)):
            cv2.add(total[at], more, dst=total[at])
        count = self._count[at]  # it stops at 255
        cv2.add(count, (weight > 0.0).view(np.uint8), dst=count)

    def levels(self) -> Levels:
        """The fused probability of the window, in levels from 0 to `MOST`, or `UNSEEN`."""
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
        """The levels of some rows, without the halo at their ends."""
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
    """Marks of a detector as 0 to 255, its mask grown by what the detector takes off at edges.

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
