"""Movement of the camera between two pictures, by the ground that both show.

A picture becomes a patch: the level ground that it shows, north up, without light and shade.
Patches of the same ground differ by a shift, which their normalised cross-correlation finds to a
fraction of a pixel. Ground without texture, that repeats itself or runs along a line gets no
answer.

Patches are scaled and turned by reported heights and headings. If those change while the ground
does not, the same ground is larger in one patch, or turned. The difference is the drift of the
height or heading.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.own_map.ground_patch import NOTHING, STEPS, Patch

MIN_SCORE: Final = 0.3
"""Minimum correlation of the same ground, 0 to 1."""
MIN_LEAD: Final = 0.12
"""Minimum lead of a place's correlation over that of any other place."""

_MIN_TEXTURE: Final = 0.35  # root mean square of a patch; of noise alone it has 0.2
_MIN_PX: Final = 400  # pixels that two patches have in common
_AROUND_PX: Final = 4  # radius around a peak within which no value is another peak
_CORRELATED: Final = 9.0  # number of neighbouring pixels with one error, which count as one
_FLOOR_PX: Final = 0.06  # error of the interpolation in one direction


@dataclass(frozen=True, slots=True)
class Match:
    """The movement of the camera over ground between two pictures.

    Attributes:
        moved_m: Movement of the place below the camera, east and north along the patches' axes.
        sigma_m: Standard deviation of each, by the pictures alone, without errors of attitude and
            height.
    """

    moved_m: tuple[float, float]
    sigma_m: float


def match(
    earlier: Patch, later: Patch, expected_m: tuple[float, float], search_m: float
) -> Match | None:
    """Return the movement of the camera from one picture to another, by the ground.

    Args:
        later: Patch of the other picture, with the same pixels and axes.
        expected_m: The expected movement, east and north.
        search_m: Maximum error of that in either direction, above 0.

    Returns:
        None if the common ground is too small or has no texture, or if other places agree nearly as
        well.

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
    """Place both patches on canvases of one size, the later one where it is expected.

    Pixels without a possible partner are cut off. The rest is empty, so that no shift within the
    radius wraps.
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
    least = np.float32(_MIN_TEXTURE**2) * np.maximum(common, 1.0)
    textured = (common >= _MIN_PX) & (power_a >= least) & (power_b >= least)
    scale = np.sqrt(np.maximum(power_a, 1e-6) * np.maximum(power_b, 1e-6))
    return np.where(textured, product / scale, np.float32(-1.0)), common


def _peak(
    surface: NDArray[np.float32], common: NDArray[np.float32], radius: int
) -> tuple[float, float, float] | None:
    """Return east, north and sigma (pixels) of the one place that fits."""
    inner = surface[1:-1, 1:-1]
    row, column = (int(i) + 1 for i in np.unravel_index(int(inner.argmax()), inner.shape))
    score = float(surface[row, column])
    around = surface[row - 1 : row + 2, column - 1 : column + 2]
    if score < MIN_SCORE or float(around.max()) > score or float(around.min()) <= -1.0:
        return None
    others = surface.copy()
    others[
        max(0, row - _AROUND_PX) : row + _AROUND_PX + 1,
        max(0, column - _AROUND_PX) : column + _AROUND_PX + 1,
    ] = -1.0
    if score - max(float(others.max()), 0.0) < MIN_LEAD:
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


# --- scale and rotation --------------------------------------------------------------------------
_ROUNDS: Final = 3
_SMOOTH_PX: Final = 3  # so that a start with an error of a pixel leads to the same place
_MIN_ZOOMED_PX: Final = 600
_FARTHEST_PX: Final = 2.5  # maximum distance of a result from its start
_MIN_LIKENESS: Final = 0.3
_FLOOR: Final = 0.002  # error of a zoom by the errors of attitudes

Values = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Zoom:
    """The difference of two patches of the same ground.

    Attributes:
        moved_px: East + i north: movement of the camera, in pixels of mean size and direction.
        sigma_px: Standard deviation in one direction.
        zoom: Enlargement of the later patch, as a share, + i radians counter-clockwise.
        sigma: Standard deviation of both parts of `zoom`.
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
    """Return scale, rotation and place of the ground that both patches show, from a near start.

    Gradients give a least-squares fit. Both patches are smoothed first, so that errors up to about
    two pixels are corrected everywhere.

    Args:
        later: Another one, with the same pixels and axes.
        moved_px: Expected movement of the camera, in pixels of the earlier patch.
        zoom: Expected enlargement of the later one.

    Returns:
        None if the common ground is too small, or the fit leads elsewhere.
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
        if count < _MIN_ZOOMED_PX:
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
    if score < _MIN_LIKENESS or at_middle > _FARTHEST_PX:
        return None
    covariance = np.linalg.inv(normal) * float(off @ off) / count * _CORRELATED
    found = 1.0 / larger - 1.0
    # at the middle of the ground that both show, except where it is not between both cameras
    aside = abs(middle + moved / 2.0)
    spread = float(max(covariance[2, 2], covariance[3, 3])) + _FLOOR**2
    sigma = math.sqrt(float(max(covariance[0, 0], covariance[1, 1])) + spread * aside**2)
    return Zoom(moved * (1.0 + found / 2.0), math.hypot(sigma, _FLOOR_PX), found, math.sqrt(spread))


def _matrix(
    larger: complex, moved: complex, origin: tuple[int, int], other: tuple[int, int]
) -> NDArray[np.float64]:
    """Return the map from columns and rows of one raster to another: p becomes larger p + moved.

    Origins are the first pixel's place, east and north.
    """
    a, b = larger.real, larger.imag
    first = larger * complex(*origin) + moved - complex(*other)
    return np.array([[a, b, first.real], [-b, a, -first.imag]])


def _warped(
    values: Values, known: NDArray[np.bool_], matrix: NDArray[np.float64], size: tuple[int, int]
) -> tuple[Values, NDArray[np.bool_]]:
    """Return the values on another raster, and True where all their sources are known."""
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    found = cv2.warpAffine(values, matrix, size, flags=flags)
    whole = cv2.warpAffine(known.astype(np.uint8) * 255, matrix, size, flags=flags) == 255
    return np.asarray(found, np.float32), whole


def _smooth(values: Values) -> Values:
    values = np.where(values == NOTHING, np.float32(0.0), values / np.float32(STEPS))
    return np.asarray(cv2.GaussianBlur(values, (_SMOOTH_PX, _SMOOTH_PX), 0), np.float32)


def _inner(seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the pixels away from the rim, where slopes are wrong."""
    kernel = np.ones((5, 5), np.uint8)
    return cv2.erode(seen.astype(np.uint8), kernel, borderValue=0) > 0


def _slopes(values: Values) -> tuple[Values, Values]:
    """Return the slopes to the east and to the north."""
    east = cv2.Sobel(values, cv2.CV_32F, 1, 0, ksize=1, scale=0.5)
    south = cv2.Sobel(values, cv2.CV_32F, 0, 1, ksize=1, scale=0.5)
    return np.asarray(east, np.float32), np.asarray(-south, np.float32)
