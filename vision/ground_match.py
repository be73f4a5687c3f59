"""How far the camera has moved between two pictures, as the ground that both show says.

A picture becomes a patch: the level ground that it shows, north up, in gray levels from which
light and shade are taken out. Two patches of the same ground differ by a shift, which their
normalised cross-correlation finds to a fraction of a pixel. What two pictures cannot tell, because
the ground has no texture, repeats itself, or runs along a line, gets no answer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.ground.footprint import Optics
from missions.units import Pose
from vision.look import Frame

LEAST_SCORE: Final = 0.3
"""The least correlation that is taken for the same ground, 0 to 1."""
LEAST_LEAD: Final = 0.12
"""By so much a place must correlate better than any other one."""

NOTHING: Final = -128
"""The value of what a picture does not show."""

_RESOLUTIONS_M: Final = (0.05, 0.1, 0.2, 0.4)
_WANTED_PX: Final = 75.0  # along the shorter side of a footprint
_REACH_HEIGHTS: Final = 2.0  # what is farther from below the camera is seen too flatly
_WINDOW_M_PER_PX: Final = 15  # light is what changes over more pixels of the raster than these
_LEAST_CONTRAST: Final = 2.0  # gray levels; what differs by less counts as noise
_FEW: Final = 4  # of the pixels in a row one in so many tells the shading
_STEPS: Final = 40.0  # of the stored values in a unit of contrast
_LEAST_TEXTURE: Final = 0.35  # root mean square of a patch; of noise alone it has 0.2
_LEAST_PX: Final = 400  # that two patches have in common
_AROUND_PX: Final = 4  # a peak's own surroundings, where nothing is another peak
_CORRELATED: Final = 9.0  # neighbouring pixels err alike: so many count as one
_FLOOR_PX: Final = 0.06  # what interpolation errs by, in one direction


@dataclass(frozen=True, slots=True)
class Patch:
    """Level ground as one picture shows it, as a raster around the place below the camera.

    `values` are int8, row by row from the north: contrast to the surroundings in 1/40 of the local
    deviation, `NOTHING` where nothing is seen. The centre of the pixel in row 0 and column 0 lies
    `west_px` pixels east (so negative) and `north_px` pixels north of the place below the camera.
    """

    values: NDArray[np.int8]
    west_px: int
    north_px: int
    metres_per_pixel: float

    @property
    def centre_m(self) -> tuple[float, float]:
        """The middle of what is shown, metres east and north of the place below the camera."""
        rows, columns = self.values.shape
        east = self.west_px + (columns - 1) / 2.0
        north = self.north_px - (rows - 1) / 2.0
        return east * self.metres_per_pixel, north * self.metres_per_pixel

    @property
    def size_m(self) -> tuple[float, float]:
        """How far it reaches from west to east, and from south to north."""
        rows, columns = self.values.shape
        return columns * self.metres_per_pixel, rows * self.metres_per_pixel

    @property
    def pixels(self) -> int:
        """How many pixels show ground."""
        return int(np.count_nonzero(self.values != NOTHING))

    @property
    def texture(self) -> float:
        """How much there is to be seen, 0 (nothing but noise: 0.2) to about 1."""
        seen = self.values[self.values != NOTHING].astype(np.float32)
        return float(np.sqrt(np.mean(np.square(seen)))) / _STEPS if seen.size else 0.0


@dataclass(frozen=True, slots=True)
class Match:
    """How far the camera moved over ground between two pictures.

    Attributes:
        moved_m: East and north along the patches' axes, of the place below the camera.
        sigma_m: Standard deviation of each of them, by the pictures alone: what the told attitude
            and height are off by is not in it.
        score: How well the pictures agree, `LEAST_SCORE` to 1.
        lead: By how much better than at any other place.
    """

    moved_m: tuple[float, float]
    sigma_m: float
    score: float
    lead: float


def resolution_m(camera: Optics, height_m: float) -> float:
    """Metres to a pixel of a patch from this height: fine enough, and not finer.

    >>> resolution_m(Optics(math.radians(80.0), 640, 480), 12.0)
    0.2
    """
    wanted = camera.footprint(max(height_m, 0.1)).short_m / _WANTED_PX
    return min(_RESOLUTIONS_M, key=lambda m: abs(math.log(m / wanted)))


def patch(
    frame: Frame, *, metres_per_pixel: float | None = None, up_rad: float = 0.0
) -> Patch | None:
    """The ground that a picture shows, as its pose has it.

    Args:
        frame: The picture and its pose.
        metres_per_pixel: Of the raster, above 0; by default `resolution_m` of the height. Only
            patches of the same one can be matched.
        up_rad: The true bearing of the raster's upper edge: 0, or `Grid.convergence_rad` to have
            the axes of a grid.

    Returns:
        The patch; None where the pose shows no ground: on the ground, or near the horizon.
    """
    pose, camera = frame.pose, frame.camera
    if pose.height_m <= 0.0:
        return None
    pitch_m = metres_per_pixel or resolution_m(camera, pose.height_m)
    matrix = camera.pixels_of_ned(pose) @ _ned_of_ground(pose, up_rad)
    box = _box(camera, matrix, pose.height_m, pitch_m)
    if box is None:
        return None
    west, south, east, north = box
    small, pixels_of_raster = _shrunk(frame, pitch_m)
    to_ground = np.array(
        [[pitch_m, 0.0, west * pitch_m], [0.0, -pitch_m, north * pitch_m], [0.0, 0.0, 1.0]]
    )
    size = (east - west + 1, north - south + 1)
    to_pixel = pixels_of_raster @ matrix @ to_ground
    inverse = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    gray = cv2.warpPerspective(small, to_pixel, size, flags=inverse).astype(np.float32)
    whole = np.full(small.shape, 255, np.uint8)
    seen = cv2.warpPerspective(whole, to_pixel, size, flags=inverse) == 255
    return Patch(_without_light(gray, seen), west, north, pitch_m)


def match(
    earlier: Patch, later: Patch, expected_m: tuple[float, float], search_m: float
) -> Match | None:
    """How far the camera moved from one picture to another, as the ground shows it.

    Args:
        earlier: A patch.
        later: Another one, with the same pixels and axes.
        expected_m: How far the camera is believed to have moved, east and north.
        search_m: How far off that may be, in either direction, above 0.

    Returns:
        The movement; None where the ground does not say: too little is in both pictures, there is
        no texture, or other places agree nearly as well.

    Raises:
        ValueError: the patches have different pixels.
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
    right, up, score, lead, sigma_px = found
    moved_m = (shift[0] + right) * pitch_m, (shift[1] + up) * pitch_m
    return Match(moved_m, sigma_px * pitch_m, score, lead)


# --- patches ------------------------------------------------------------------------------------
def _ned_of_ground(pose: Pose, up_rad: float) -> NDArray[np.float64]:
    """From metres east and north of below the camera, along the raster's axes, to NED of it."""
    cos, sin = math.cos(up_rad), math.sin(up_rad)
    return np.array([[-sin, cos, 0.0], [cos, sin, 0.0], [0.0, 0.0, pose.height_m]])


def _box(
    camera: Optics, matrix: NDArray[np.float64], height_m: float, pitch_m: float
) -> tuple[int, int, int, int] | None:
    """West, south, east and north of what is shown, in pixels of the raster."""
    right, low = camera.width_px - 1.0, camera.height_px - 1.0
    corners = np.array([[0.0, right, right, 0.0], [0.0, 0.0, low, low], [1.0] * 4])
    ground = np.linalg.solve(matrix, corners)
    if not bool((ground[2] > 0.0).all()):
        return None  # a corner shows the sky
    places = np.clip(ground[:2] / ground[2], -_REACH_HEIGHTS * height_m, _REACH_HEIGHTS * height_m)
    west, south = (math.ceil(c) for c in places.min(axis=1) / pitch_m)
    east, north = (math.floor(c) for c in places.max(axis=1) / pitch_m)
    return (west, south, east, north) if east > west and north > south else None


def _shrunk(frame: Frame, pitch_m: float) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """The gray picture, as small as the raster allows, and its pixels from those of the frame."""
    camera = frame.camera
    factor = max(1, math.floor(pitch_m / camera.gsd_m(frame.pose.height_m)))
    rows, columns = camera.height_px // factor, camera.width_px // factor
    image = frame.image[: rows * factor, : columns * factor]
    gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    small = cv2.resize(gray, (columns, rows), interpolation=cv2.INTER_AREA)
    offset = (1.0 / factor - 1.0) / 2.0  # pixel 0 is a centre in both
    scaled = np.array([[1 / factor, 0.0, offset], [0.0, 1 / factor, offset], [0.0, 0.0, 1.0]])
    return np.asarray(small, dtype=np.uint8), scaled


def _without_light(gray: NDArray[np.float32], seen: NDArray[np.bool_]) -> NDArray[np.int8]:
    """Contrast to the surroundings, over how much it differs there."""
    window = (_WINDOW_M_PER_PX, _WINDOW_M_PER_PX)

    def around(values: NDArray[np.floating]) -> NDArray[np.float32]:
        mean = cv2.boxFilter(values, cv2.CV_32F, window, borderType=cv2.BORDER_CONSTANT)
        return np.asarray(mean, dtype=np.float32)

    gray = gray - _shading(gray, seen)
    there = seen.astype(np.float32)
    share = np.maximum(around(there), np.float32(1e-3))
    contrast = (gray - around(gray * there) / share) * there
    spread = np.sqrt(np.maximum(around(contrast * contrast) / share, np.float32(0.0)))
    steps = contrast * (np.float32(_STEPS) / (spread + np.float32(_LEAST_CONTRAST)))
    values = np.clip(np.rint(steps), NOTHING + 1, 127).astype(np.int8)
    values[~seen] = NOTHING
    return values


def _shading(gray: NDArray[np.float32], seen: NDArray[np.bool_]) -> NDArray[np.float32]:
    """The paraboloid that fits best: at the rim of what is seen, local means leave a lens's."""
    rows, columns = gray.shape
    y = np.linspace(-1.0, 1.0, rows, dtype=np.float32)[:, None]
    x = np.linspace(-1.0, 1.0, columns, dtype=np.float32)[None, :]
    few = (slice(None, None, _FEW), slice(None, None, _FEW))
    there = seen[few]
    terms = [np.broadcast_to(t, gray.shape)[few][there] for t in (x, y, x * x, x * y, y * y)]
    terms.append(np.ones_like(terms[0]))
    if len(terms[0]) < 2 * len(terms):
        return np.zeros_like(gray)
    basis = np.stack(terms, axis=1)
    a, b, c, d, e, f = np.linalg.lstsq(basis, gray[few][there], rcond=None)[0]
    return np.asarray((a + c * x + d * y) * x + (b + e * y) * y + f, dtype=np.float32)


# --- matching -----------------------------------------------------------------------------------
def _canvases(
    earlier: Patch, later: Patch, shift: tuple[int, int], radius: int
) -> tuple[NDArray[np.int8], NDArray[np.int8]] | None:
    """Both patches on canvases of one size, the later one where it is expected.

    What can have no partner is cut off; the rest of a canvas is empty, so that no shift within the
    radius wraps around.
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
    """For each shift the correlation, and how many pixels it is of; the middle is no shift.

    Rows are shifts to the south, columns to the east, from -radius to radius.
    """
    spectra = []
    for canvas in (earlier, later):
        seen = (canvas != NOTHING).astype(np.float32)
        values = canvas.astype(np.float32) * (seen / np.float32(_STEPS))
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
) -> tuple[float, float, float, float, float] | None:
    """East, north (pixels), score, lead and sigma (pixels) of the one place that fits."""
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
    lead = score - max(float(others.max()), 0.0)
    if lead < LEAST_LEAD:
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
    return east, -south, score, lead, math.sqrt(variance)
