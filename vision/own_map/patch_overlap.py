"""How much of the same ground patches show, by where they were taken."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from vision.own_map.ground_patch import Patch


def side_m(patch: Patch) -> float:
    """Of a square as large as what a patch shows.

    >>> side_m(Patch(np.ones((30, 30), np.int8), 0, 0, 0.5))
    15.0
    """
    return math.sqrt(patch.pixels) * patch.metres_per_pixel


def overlaps(
    patch: Patch,
    others: Iterable[Patch],
    sides_m: Iterable[float],
    away_m: NDArray[np.float64],
) -> NDArray[np.float64]:
    """The part of a patch that each of some others covers, as squares, 0 to 1.

    Args:
        patch: One.
        others: The others; those with other pixels cover nothing.
        sides_m: Their `side_m`.
        away_m: Where they were taken from there, east and north, shape (n, 2).
    """
    side = np.minimum(np.array(list(sides_m)), side_m(patch))
    alike = np.array([other.metres_per_pixel == patch.metres_per_pixel for other in others])
    free = np.maximum(0.0, 1.0 - np.abs(away_m) / side[:, None])
    return np.asarray(free[:, 0] * free[:, 1] * alike, dtype=np.float64)
