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
_IN_FRAME: Final = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])

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
        matrix: 3 x 3, from the ground to the places of the marks.
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
    at = (north - cells[:, 1], cells[:, 0] - west)
    place_of_sample = matrix @ ground_of_sample
    if marks.dtype != np.uint8:
        shares, seen = _means(
            np.asarray(marks, np.float32), place_of_sample, (across, along), samples
        )
        return shares[at], seen[at]
    block = cv2.warpPerspective(
        marks,
        place_of_sample,
        (across * samples, along * samples),
        flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=(OUTSIDE,),  # no mask has this value
    )
    roi, outside = _counted(block, samples)
    inside = samples * samples - outside
    return roi[at] / np.maximum(inside[at], 1), inside[at] / (samples * samples)


def _means(
    marks: NDArray[np.float32], place_of_sample: Floats, cells: tuple[int, int], samples: int
) -> tuple[Floats, Floats]:
    """Return the mean probability in each cell, and the part of it that is in the picture.

    Args:
        cells: Columns and rows of cells.
    """
    size = (cells[0] * samples, cells[1] * samples)
    inside = cv2.warpPerspective(
        np.ones(marks.shape, np.uint8), place_of_sample, size,
        flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP,
    )  # fmt: skip
    # up to its edge a picture has the probability of its outermost places
    framed = cv2.copyMakeBorder(marks, 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    values = cv2.warpPerspective(
        framed, _IN_FRAME @ place_of_sample, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    )
    total, seen = (
        cv2.resize(block, cells, interpolation=cv2.INTER_AREA).astype(np.float64)
        for block in (cv2.multiply(values, inside, dtype=cv2.CV_32F), inside.astype(np.float32))
    )
    return total / np.maximum(seen, 0.5 / samples**2), seen


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
