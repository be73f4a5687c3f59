"""How far the camera moved between two pictures, by the ground that both show.

A picture becomes a patch: the level ground that it shows, north up, without light and shade.
Patches of the same ground differ by a shift, which their normalised cross-correlation finds to a
fraction of a pixel. Ground without texture, that repeats itself or runs along a line gets no
answer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.own_map.ground_patch import NOTHING, STEPS, Patch

LEAST_SCORE: Final = 0.3
"""Least correlation of the same ground, 0 to 1."""
LEAST_LEAD: Final = 0.12
"""Least lead of a place's correlation over any other's."""

_LEAST_TEXTURE: Final = 0.35  # root mean square of a patch; of noise alone it has 0.2
_LEAST_PX: Final = 400  # that two patches have in common
_AROUND_PX: Final = 4  # a peak's own surroundings, where nothing is another peak
_CORRELATED: Final = 9.0  # neighbouring pixels err alike: so many count as one
_FLOOR_PX: Final = 0.06  # what interpolation errs by, in one direction


@dataclass(frozen=True, slots=True)
class Match:
    """The movement of the camera over ground between two pictures.

    Attributes:
        moved_m: East and north along the patches' axes, of the place below the camera.
        sigma_m: Standard deviation of each, by the pictures alone, without errors of attitude and
            height.
    """

    moved_m: tuple[float, float]
    sigma_m: float


def match(
    earlier: Patch, later: Patch, expected_m: tuple[float, float], search_m: float
) -> Match | None:
    """Return how far the camera moved from one picture to another, by the ground.

    Args:
        later: Another one, with the same pixels and axes.
        expected_m: The believed movement, east and north.
        search_m: Its largest error in either direction, above 0.

    Returns:
        None if too little is in both, there is no texture, or other places agree nearly as well.

    Raises:
        ValueError: The patches have different pixels.
    """
    pitch_m = earlier.metres_per_pixel
    if not math.isclose(pitch_m, later.metres_per_pixel):
        raise ValueError(f"patches of {pitch_m:g} and {later.metres_per_pixel:g} m to a pixel")
    radius = math.ceil(search_m / pitch_m) + 1  # one more, so that a peak has all its neighbours
    shift = round(expected_m[0] / pitch_m), round(expected_m[1] / pitch_m)
    canvases = _canvases(earlier, later, shift, radius)
    if canvases is None:
        return None
    surface, common = _correlation(*canvases, radius)
    found = _peak(surface, common, radius)
    if found is None:
        return None
    right, up, sigma_px = found
    moved_m = (shift[0] + right) * pitch_m, (shift[1] + up) * pitch_m
    return Match(moved_m, sigma_px * pitch_m)


def _canvases(
    earlier: Patch, later: Patch, shift: tuple[int, int], radius: int
) -> tuple[NDArray[np.int8], NDArray[np.int8]] | None:
    """Lay both patches on canvases of one size, the later one where it is expected.

    What can have no partner is cut off; the rest is empty, so that no shift within the radius
    wraps.
    """
    spans = []
    for axis in (0, 1):
        count_a, count_b = earlier.values.shape[axis], later.values.shape[axis]
        first_a = earlier.west_px if axis == 1 else -earlier.north_px
        first_b = later.west_px + shift[0] if axis == 1 else -later.north_px - shift[1]
        low_a = max(first_a, first_b - radius)
        high_a = min(first_a + count_a, first_b + count_b + radius)
        low_b = max(first_b, first_a - radius)
        high_b = min(first_b + count_b, first_a + count_a + radius)
        if high_a - low_a < 2 * radius // 3 + 8 or high_b - low_b < 8:
            return None
        begin = min(low_a, low_b)
        size = cv2.getOptimalDFTSize(max(high_a, high_b) - begin + radius)
        spans.append(
            (slice(low_a - first_a, high_a - first_a), low_a - begin,
             slice(low_b - first_b, high_b - first_b), low_b - begin, size)
        )  # fmt: skip
    (rows_a, down_a, rows_b, down_b, height), (cols_a, right_a, cols_b, right_b, width) = spans
    made = []
    for values, down, right in (
        (earlier.values[rows_a, cols_a], down_a, right_a),
        (later.values[rows_b, cols_b], down_b, right_b),
    ):
        canvas = np.full((height, width), NOTHING, np.int8)
        canvas[down : down + values.shape[0], right : right + values.shape[1]] = values
        made.append(canvas)
    return made[0], made[1]


def _correlation(
    earlier: NDArray[np.int8], later: NDArray[np.int8], radius: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return for each shift the correlation, and its count of pixels; the middle is no shift.

    Rows are shifts to the south, columns to the east, from -radius to radius.
    """
    spectra = []
    for canvas in (earlier, later):
        seen = (canvas != NOTHING).astype(np.float32)
        values = canvas.astype(np.float32) * (seen / np.float32(STEPS))
        spectra.append([cv2.dft(layer) for layer in (values, values * values, seen)])
    (value_a, square_a, seen_a), (value_b, square_b, seen_b) = spectra
    pairs = ((value_a, value_b), (square_a, seen_b), (seen_a, square_b), (seen_a, seen_b))
    reach = np.arange(-radius, radius + 1)
    window = np.ix_(reach, reach)  # negative shifts are at the far end
    product, power_a, power_b, common = (
        cv2.idft(cv2.mulSpectrums(a, b, 0, conjB=True), flags=cv2.DFT_SCALE | cv2.DFT_REAL_OUTPUT)[
            window
        ]
        for a, b in pairs
    )
    least = np.float32(_LEAST_TEXTURE**2) * np.maximum(common, 1.0)
    told = (common >= _LEAST_PX) & (power_a >= least) & (power_b >= least)
    scale = np.sqrt(np.maximum(power_a, 1e-6) * np.maximum(power_b, 1e-6))
    return np.where(told, product / scale, np.float32(-1.0)), common


def _peak(
    surface: NDArray[np.float32], common: NDArray[np.float32], radius: int
) -> tuple[float, float, float] | None:
    """Return east, north and sigma (pixels) of the one place that fits."""
    inner = surface[1:-1, 1:-1]
    row, column = (int(i) + 1 for i in np.unravel_index(int(inner.argmax()), inner.shape))
    score = float(surface[row, column])
    around = surface[row - 1 : row + 2, column - 1 : column + 2]
    if score < LEAST_SCORE or float(around.max()) > score or float(around.min()) <= -1.0:
        return None
    others = surface.copy()
    others[
        max(0, row - _AROUND_PX) : row + _AROUND_PX + 1,
        max(0, column - _AROUND_PX) : column + _AROUND_PX + 1,
    ] = -1.0
    if score - max(float(others.max()), 0.0) < LEAST_LEAD:
        return None
    # a paraboloid through the nine values around the peak
    a = around.astype(np.float64)
    slope_x = (a[:, 2] - a[:, 0]).sum() / 6.0
    slope_y = (a[2] - a[0]).sum() / 6.0
    bend_x = (a[:, 0] - 2 * a[:, 1] + a[:, 2]).sum() / 3.0
    bend_y = (a[0] - 2 * a[1] + a[2]).sum() / 3.0
    bend_xy = (a[0, 0] - a[0, 2] - a[2, 0] + a[2, 2]) / 4.0
    hessian = np.array([[bend_x, bend_xy], [bend_xy, bend_y]])
    flattest = float(np.linalg.eigvalsh(hessian)[-1])
    if flattest >= 0.0:
        return None
    right, down = -np.linalg.solve(hessian, np.array([slope_x, slope_y]))
    if max(abs(right), abs(down)) > 1.0:
        return None
    pixels = max(float(common[row, column]), 1.0) / _CORRELATED
    variance = (1.0 - min(score, 0.999)) / (-flattest * pixels) + _FLOOR_PX**2
    east, south = column - radius + right, row - radius + down
    return east, -south, math.sqrt(variance)
