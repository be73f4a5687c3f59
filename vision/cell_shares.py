"""Marked share of each cell of a grid in a picture: marks are resampled onto the cells."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from missions.geo.grid import Grid
from vision.detectors.interface import Marks

MAX_SAMPLES: Final = 48  # a cell's side in samples: a share is good to about a hundredth
_BLOCK_SAMPLES: Final = 3072  # the most samples along a side of what is resampled at once
OUTSIDE: Final = 127  # marks samples past the picture's edge; a mask holds only 0 and 255
_PACKED: Final = 64  # more than the samples along a cell's side
_MARKS: Final = np.zeros(256, np.uint8)
_MARKS[255], _MARKS[OUTSIDE] = 1, _PACKED

Floats = NDArray[np.float64]
Cells = NDArray[np.intp]
"""Columns and rows of cells, shape (n, 2)."""


def seen_shares(
    marks: Marks, matrix: Floats, grid: Grid, cells: Cells, most_samples: int
) -> tuple[Floats, Floats]:
    """Return for each cell the ROI's share of its visible part, and the visible share.

    Args:
        marks: Shape (rows, columns): uint8, 255 for ROI, else 0; or float32, a probability from 0
            to 1, whose mean is the share.
        matrix: 3 x 3, from `Camera.homography`.
        most_samples: Samples along a cell's side. More than its pixels add nothing.
    """
    west, south = (int(n) for n in cells.min(axis=0))
    east, north = (int(n) for n in cells.max(axis=0))
    across, along = east - west + 1, north - south + 1
    samples = max(1, min(most_samples, MAX_SAMPLES, _BLOCK_SAMPLES // max(across, along)))
    step_m = grid.cell_m / samples
    ground_of_sample = np.array(
        [
            [step_m, 0.0, (west - 0.5) * grid.cell_m + step_m / 2],
            [0.0, -step_m, (north + 0.5) * grid.cell_m - step_m / 2],
            [0.0, 0.0, 1.0],
        ]
    )
    block = cv2.warpPerspective(
        marks,
        matrix @ ground_of_sample,
        (across * samples, along * samples),
        flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=(OUTSIDE,),  # no mask and no probability has this value
    )
    roi, outside = _counted(block, samples) if marks.dtype == np.uint8 else _summed(block, samples)
    seen = samples * samples - outside
    at = (north - cells[:, 1], cells[:, 0] - west)
    return roi[at] / np.maximum(seen[at], 1), seen[at] / (samples * samples)


def _counted(block: MatLike, samples: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Count each cell's samples that are ROI, and those past the picture's edge.

    Both in one sum over the rows, which lie side by side in memory: a column of a cell has fewer
    samples than `_PACKED`.
    """
    rows, columns = block.shape[0] // samples, block.shape[1] // samples
    marks = np.asarray(cv2.LUT(block, _MARKS), dtype=np.uint8).reshape(rows, samples, -1)
    tall = np.add.reduce(marks, axis=1, dtype=np.uint16).reshape(rows, columns, samples)
    roi: NDArray[np.intp] = (tall % _PACKED).sum(axis=2, dtype=np.intp)
    outside: NDArray[np.intp] = (tall // _PACKED).sum(axis=2, dtype=np.intp)
    return roi, outside


def _summed(block: MatLike, samples: int) -> tuple[Floats, NDArray[np.intp]]:
    """Sum the probabilities in each cell, and count its samples past the edge."""
    rows, columns = block.shape[0] // samples, block.shape[1] // samples
    by_cell = np.asarray(block, dtype=np.float32).reshape(rows, samples, columns, samples)
    inside = by_cell != OUTSIDE
    roi: Floats = by_cell.sum(axis=(1, 3), where=inside, dtype=np.float64)
    return roi, np.count_nonzero(~inside, axis=(1, 3))
