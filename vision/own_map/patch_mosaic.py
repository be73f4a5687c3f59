"""Patches of many pictures laid side by side: the map that a lost vehicle is searched on."""

from __future__ import annotations

import math
from collections.abc import Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.own_map.ground_patch import NOTHING, Patch


def mosaic(
    patches: Iterable[tuple[Patch, tuple[float, float]]], reach_m: float, metres_per_pixel: float
) -> Patch:
    """One patch of many; where several show the same ground, the first of them counts.

    Args:
        patches: Each with the place that its picture was taken above, metres east and north of the
            mosaic's middle.
        reach_m: How far the mosaic reaches from its middle in each direction, above 0.
        metres_per_pixel: Of all the patches.
    """
    reach = math.ceil(reach_m / metres_per_pixel)
    size = 2 * reach + 1
    values = np.full((size, size), NOTHING, np.int8)
    for patch, (east_m, north_m) in patches:
        left = reach + patch.west_px + round(east_m / metres_per_pixel)
        top = reach - patch.north_px - round(north_m / metres_per_pixel)
        rows, columns = patch.values.shape
        inside = (
            slice(max(0, top), max(0, top + rows)),
            slice(max(0, left), max(0, left + columns)),
        )
        under = values[inside]
        if under.size == 0:
            continue
        first = max(0, -top), max(0, -left)
        upper = patch.values[
            first[0] : first[0] + under.shape[0], first[1] : first[1] + under.shape[1]
        ]
        values[inside] = np.where(under == NOTHING, upper, under)
    return Patch(values, -reach, reach, metres_per_pixel)


def coarser(patch: Patch) -> Patch:
    """The same ground with pixels twice as large.

    >>> fine = Patch(np.ones((7, 9), np.int8), -3, 2, 0.2)
    >>> half = coarser(fine)
    >>> half.values.shape, half.west_px, half.north_px, half.metres_per_pixel
    ((4, 4), -1, 1, 0.4)
    """
    seen = (patch.values != NOTHING).astype(np.float32)
    around = cv2.boxFilter(seen, cv2.CV_32F, (3, 3), borderType=cv2.BORDER_CONSTANT)
    told = cv2.boxFilter(
        patch.values * seen, cv2.CV_32F, (3, 3), borderType=cv2.BORDER_CONSTANT
    ) / np.maximum(around, np.float32(1e-3))
    # what is averaged has less contrast: it is stretched to what it was
    told = told * np.float32(_spread(patch.values[seen > 0]) / max(_spread(told[seen > 0]), 1.0))
    values = np.clip(np.rint(told), NOTHING + 1, 127).astype(np.int8)
    values[seen == 0.0] = NOTHING
    # the place below the camera stays the centre of a pixel
    top, left = patch.north_px % 2, patch.west_px % 2
    return Patch(
        np.ascontiguousarray(values[top::2, left::2]),
        (patch.west_px + left) // 2,
        (patch.north_px - top) // 2,
        2.0 * patch.metres_per_pixel,
    )


def _spread(values: NDArray[np.generic]) -> float:
    return float(np.std(values.astype(np.float32))) if values.size else 0.0
