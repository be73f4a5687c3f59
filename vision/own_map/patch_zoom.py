"""The scale and rotation between two patches of the same ground.

Patches are laid out by reported heights and headings. When those change while the ground does not,
the same ground is larger in one patch, or turned: so far the height or heading has drifted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.own_map.ground_patch import NOTHING, STEPS, Patch

_ROUNDS: Final = 3
_SMOOTH_PX: Final = 3  # so that a start that is off by a pixel leads to the same place
_LEAST_PX: Final = 600
_FARTHEST_PX: Final = 2.5  # what is found farther from where it began is not believed
_LEAST_SCORE: Final = 0.3
_CORRELATED: Final = 9.0  # neighbouring pixels err alike: so many count as one
_FLOOR_PX: Final = 0.06
_FLOOR: Final = 0.002  # of a zoom: attitudes are a little off, too

Values = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Zoom:
    """How two patches of the same ground differ.

    Attributes:
        moved_px: East + i north: of the camera over ground, in pixels of mean size and direction.
        sigma_px: Standard deviation in one direction.
        zoom: How much larger the later patch shows it, as a share, + i radians counter-clockwise.
        sigma: Standard deviation of both.
    """

    moved_px: complex
    sigma_px: float
    zoom: complex
    sigma: float


def resized(patch: Patch, zoom: complex) -> Patch:
    """Shrink a patch's ground by `zoom` and turn it back, around the place below the camera.

    >>> small = resized(Patch(np.ones((21, 21), np.int8), -10, 10, 0.2), 0.25 + 0j)
    >>> small.west_px, small.north_px, int((small.values != NOTHING).sum())
    (-8, 8, 289)
    """
    larger = 1.0 + zoom
    rows, columns = patch.values.shape
    west, south = patch.west_px, patch.north_px - rows + 1
    corners = np.array([complex(e, n) for e in (west, west + columns - 1)
                        for n in (south, patch.north_px)]) / larger  # fmt: skip
    low_e, high_e = math.floor(corners.real.min()), math.ceil(corners.real.max())
    low_n, high_n = math.floor(corners.imag.min()), math.ceil(corners.imag.max())
    size = high_e - low_e + 1, high_n - low_n + 1
    matrix = _matrix(larger, 0j, (low_e, high_n), (patch.west_px, patch.north_px))
    values, seen = _warped(patch.values.astype(np.float32), patch.values != NOTHING, matrix, size)
    whole = np.clip(np.rint(values), NOTHING + 1, 127).astype(np.int8)
    whole[~seen] = NOTHING
    return Patch(whole, low_e, high_n, patch.metres_per_pixel)


def compare(earlier: Patch, later: Patch, moved_px: complex, zoom: complex = 0j) -> Zoom | None:
    """Return scale, rotation and place of what both patches show, from what is nearly right.

    Least squares by gradients; both patches are smoothed first, so that up to about two pixels of
    error are corrected everywhere.

    Args:
        later: Another one, with the same pixels and axes.
        moved_px: How far the camera moved, in pixels of the earlier patch.
        zoom: How much larger the later one is believed to show the ground.

    Returns:
        None if too little is in both, or it leads elsewhere.
    """
    size = later.values.shape[1], later.values.shape[0]
    below = _smooth(later.values.astype(np.float32))
    inside = _inner(later.values != NOTHING)
    larger, moved = 1.0 / (1.0 + zoom), moved_px
    origin, other_origin = (later.west_px, later.north_px), (earlier.west_px, earlier.north_px)
    slopes = _slopes(below)
    east = (np.arange(size[0], dtype=np.float32) + later.west_px)[None, :]
    north = (later.north_px - np.arange(size[1], dtype=np.float32))[:, None]
    above = _smooth(earlier.values.astype(np.float32))
    known = _inner(earlier.values != NOTHING)
    for _ in range(_ROUNDS):
        matrix = _matrix(larger, moved, origin, other_origin)
        there, whole = _warped(above, known, matrix, size)
        both = inside & whole
        count = int(np.count_nonzero(both))
        if count < _LEAST_PX:
            return None
        more = _slopes(there)
        gx, gy = ((a[both] + b[both]) / 2.0 for a, b in zip(slopes, more, strict=True))
        x, y = (np.broadcast_to(c, both.shape)[both] for c in (east, north))
        middle = complex(float(x.mean()), float(y.mean()))
        x, y = x - np.float32(middle.real), y - np.float32(middle.imag)
        rows = np.stack([gx, gy, gx * x + gy * y, gy * x - gx * y])
        here, other = below[both], there[both]
        off = here - other
        normal = (rows @ rows.T).astype(np.float64)
        try:
            right, up, scale, turn = np.linalg.solve(normal, (rows @ off).astype(np.float64))
        except np.linalg.LinAlgError:
            return None
        change = complex(scale, turn)
        moved += complex(right, up) - change * middle
        larger += change
        if abs(complex(right, up)) > _FARTHEST_PX or abs(change) > 0.1:
            return None
    score = float(here @ other) / math.sqrt(float(here @ here) * float(other @ other) + 1e-6)
    at_middle = abs(moved + larger * middle - moved_px - middle / (1.0 + zoom))
    if score < _LEAST_SCORE or at_middle > _FARTHEST_PX:
        return None
    covariance = np.linalg.inv(normal) * float(off @ off) / count * _CORRELATED
    found = 1.0 / larger - 1.0
    # of the middle of all that both show, but for where that is not between both cameras
    aside = abs(middle + moved / 2.0)
    spread = float(max(covariance[2, 2], covariance[3, 3])) + _FLOOR**2
    sigma = math.sqrt(float(max(covariance[0, 0], covariance[1, 1])) + spread * aside**2)
    return Zoom(moved * (1.0 + found / 2.0), math.hypot(sigma, _FLOOR_PX), found, math.sqrt(spread))


def _matrix(
    larger: complex, moved: complex, origin: tuple[int, int], other: tuple[int, int]
) -> NDArray[np.float64]:
    """From columns and rows of one raster to those of another, where p becomes larger p + moved.

    Origins are the first pixel's place, east and north.
    """
    a, b = larger.real, larger.imag
    first = larger * complex(*origin) + moved - complex(*other)
    return np.array([[a, b, first.real], [-b, a, -first.imag]])


def _warped(
    values: Values, known: NDArray[np.bool_], matrix: NDArray[np.float64], size: tuple[int, int]
) -> tuple[Values, NDArray[np.bool_]]:
    """Return the values on another raster, and where all that they are made of is known."""
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    found = cv2.warpAffine(values, matrix, size, flags=flags)
    whole = cv2.warpAffine(known.astype(np.uint8) * 255, matrix, size, flags=flags) == 255
    return np.asarray(found, np.float32), whole


def _smooth(values: Values) -> Values:
    values = np.where(values == NOTHING, np.float32(0.0), values / np.float32(STEPS))
    return np.asarray(cv2.GaussianBlur(values, (_SMOOTH_PX, _SMOOTH_PX), 0), np.float32)


def _inner(seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """What is not near the rim, where slopes are of nothing."""
    kernel = np.ones((5, 5), np.uint8)
    return cv2.erode(seen.astype(np.uint8), kernel, borderValue=0) > 0


def _slopes(values: Values) -> tuple[Values, Values]:
    """To the east and to the north."""
    east = cv2.Sobel(values, cv2.CV_32F, 1, 0, ksize=1, scale=0.5)
    south = cv2.Sobel(values, cv2.CV_32F, 0, 1, ksize=1, scale=0.5)
    return np.asarray(east, np.float32), np.asarray(-south, np.float32)
