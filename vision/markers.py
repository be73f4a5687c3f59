"""Markers in a picture: exact corners, and the position of the vehicle that carries one.

OpenCV's detector finds a marker and reads its number. Its corners are good to a third of a pixel,
too coarse where a marker has fifteen. So the known pattern, blurred like the picture, is shifted
over the marker until all pixels agree. The fit uses all edges of the pattern at once, and gives
the corners' covariance.

The position is relative to the camera, with covariance. A maximum a posteriori estimate weighs the
errors of the corners, of the camera's attitude and of the other vehicle's tilt.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.units import Quaternion
from vision.camera import Camera, rotation

Array = NDArray[np.float64]
Gray = NDArray[np.uint8]

MIN_EDGE_PX: Final = 8.0
"""Least edge of a marker in the picture, pixels."""
_ENLARGED_BELOW_PX = 2000
_ENLARGED = 2
_FINE_PX = 16  # pixels of the pattern for each of its modules
_MARGIN = 0.7  # modules around the black square that are compared
_INNER = (np.arange(3) + 0.5) / 3 - 0.5
_MAX_PX = 3.0  # most pixels for each module; a larger marker is shrunk
_BLURS_PX = (0.25, 0.45, 0.7, 1.0, 1.4, 1.9)
_STEP_PX = 0.01
_ITERATIONS = 12
_ENOUGH_PX = 0.005
_MIN_LIKENESS = 0.8  # correlation of picture and pattern
_MIN_NOISE = 2.0  # gray levels


@dataclass(frozen=True, slots=True)
class FoundTag:
    """A marker in a picture.

    Attributes:
        tag_id: Its number in the dictionary.
        corners_px: (4, 2), pixels as in `vision.camera`, of the black square: upper left, upper
            right, lower right, lower left of the upright marker.
        covariance_px2: (8, 8), of the corners' u and v one after the other.
    """

    tag_id: int
    corners_px: Array
    covariance_px2: Array

    @property
    def edge_px(self) -> float:
        """Mean length of its edges, pixels."""
        sides = self.corners_px - np.roll(self.corners_px, 1, axis=0)
        return float(np.hypot(sides[:, 0], sides[:, 1]).mean())


def find_tags(picture: NDArray[np.uint8], dictionary: str = "DICT_4X4_50") -> tuple[FoundTag, ...]:
    """Return the markers of a dictionary in a picture, by number; at most one of each.

    A number that occurs twice is left out. So is a marker unlike its pattern, or smaller than
    `MIN_EDGE_PX`.

    Args:
        picture: Gray, (rows, columns), or in colour (blue, green, red), (rows, columns, 3).
        dictionary: A dictionary's name in OpenCV.
    """
    detector = _detector(dictionary)
    gray = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) if picture.ndim == 3 else picture)
    times = _ENLARGED if max(gray.shape) < _ENLARGED_BELOW_PX else 1
    large = gray
    if times > 1:
        large = np.asarray(
            cv2.resize(gray, None, fx=times, fy=times, interpolation=cv2.INTER_CUBIC)
        )
    quads, numbers, _ = detector.detectMarkers(large)
    if numbers is None:
        return ()
    listed = [int(number) for number in np.ravel(numbers)]
    found = []
    for number, quad in sorted(zip(listed, quads, strict=True), key=lambda pair: pair[0]):
        if listed.count(number) > 1:
            continue
        corners = (np.asarray(quad, dtype=np.float64).reshape(4, 2) + 0.5) / times - 0.5
        tag = _refined(gray.astype(np.uint8), dictionary, number, corners)
        if tag is not None and tag.edge_px >= MIN_EDGE_PX:
            found.append(tag)
    return tuple(found)


@lru_cache(maxsize=8)
def _dictionary(name: str) -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


@lru_cache(maxsize=8)
def _detector(name: str) -> cv2.aruco.ArucoDetector:
    return cv2.aruco.ArucoDetector(_dictionary(name), cv2.aruco.DetectorParameters())


@lru_cache(maxsize=64)
def _pattern(dictionary: str, number: int) -> NDArray[np.float32]:
    """Return the marker, 0 to 1, in two modules of white, `_FINE_PX` pixels a module."""
    known = _dictionary(dictionary)
    modules = np.asarray(cv2.aruco.generateImageMarker(known, number, known.markerSize + 2))
    framed = np.pad(modules.astype(np.float32) / 255.0, 2, constant_values=1.0)
    large = np.kron(framed, np.ones((_FINE_PX, _FINE_PX), np.float32))
    return np.asarray(large, dtype=np.float32)


class _Overlay:
    """The part of a picture that shows a marker, and the pattern over it."""

    def __init__(self, gray: Gray, pattern: NDArray[np.float32], corners: Array) -> None:
        self._count = len(pattern) // _FINE_PX - 4  # modules along the black square
        edge = float(np.hypot(*(corners[0] - corners[2]))) / math.sqrt(2.0)
        self.shrunk = max(1, int(edge / self._count / _MAX_PX))
        reach = 2.0 * edge / self._count
        low = np.maximum(np.floor(corners.min(axis=0) - reach), 0.0).astype(int)
        high = np.ceil(corners.max(axis=0) + reach).astype(int) + 1
        columns, rows = np.minimum(high, gray.shape[::-1]) - low
        k = self.shrunk
        columns, rows = columns - columns % k, rows - rows % k
        part = gray[low[1] : low[1] + rows, low[0] : low[0] + columns].astype(np.float64)
        small = part.reshape(rows // k, k, columns // k, k).mean(axis=(1, 3))
        # in the shrunk picture's pixels, whose centres count as those of OpenCV do
        self._low = low
        self.corners = (corners - low + 0.5) / k - 0.5
        u, v = np.meshgrid(np.arange(small.shape[1]), np.arange(small.shape[0]))
        reach = self._count / 2.0
        right, down = self._modules(self.corners, u, v)
        inside = np.maximum(np.abs(right - reach), np.abs(down - reach)) <= reach + _MARGIN
        inner_u, inner_v = np.meshgrid(_INNER, _INNER)
        self._u = u[inside][:, None] + inner_u.ravel()
        self._v = v[inside][:, None] + inner_v.ravel()
        self.levels = small[inside]
        self._pattern = pattern
        self._per_module = edge / self._count / k
        self.blur(_BLURS_PX[1])

    def blur(self, sigma_px: float) -> None:
        sigma = sigma_px / self._per_module * _FINE_PX
        self._blurred = cv2.GaussianBlur(self._pattern, (0, 0), sigma)

    def whole(self, corners: Array) -> Array:
        """Return corners in pixels of the whole picture."""
        return np.asarray((corners + 0.5) * self.shrunk - 0.5 + self._low, dtype=np.float64)

    def _modules(self, corners: Array, u: Array, v: Array) -> tuple[Array, Array]:
        """Return pixels in modules right and down of the marker's upper left corner."""
        n = float(self._count)
        square = np.array([[0.0, 0.0], [n, 0.0], [n, n], [0.0, n]], np.float32)
        matrix = cv2.getPerspectiveTransform(corners.astype(np.float32), square)
        (a, b, c), (d, e, f), (g, h, i) = matrix
        scale = g * u + h * v + i
        return np.asarray((a * u + b * v + c) / scale), np.asarray((d * u + e * v + f) / scale)

    def seen(self, corners: Array) -> Array:
        """Return the blurred pattern in each pixel, 0 to 1, for corners in pixels of the part."""
        right, down = ((x + 2.0) * _FINE_PX - 0.5 for x in self._modules(corners, self._u, self._v))
        sampled = cv2.remap(
            self._blurred, right.astype(np.float32), down.astype(np.float32), cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )  # fmt: skip
        return np.asarray(np.asarray(sampled, np.float64).mean(axis=1))


def _refined(gray: Gray, dictionary: str, number: int, corners: Array) -> FoundTag | None:
    """Return the marker with exact corners; None if the picture does not look like its pattern."""
    overlay = _Overlay(gray, _pattern(dictionary, number), corners)
    now = _fitted(overlay, overlay.corners)
    misfits = []
    for sigma_px in _BLURS_PX:
        overlay.blur(sigma_px)
        misfits.append(float((_residuals(overlay, now)[0] ** 2).mean()))
    overlay.blur(_BLURS_PX[int(np.argmin(misfits))])
    now = _fitted(overlay, now)
    residuals, gain, likeness = _residuals(overlay, now)
    moved = overlay.whole(now) - corners
    if gain <= 0.0 or likeness < _MIN_LIKENESS or not np.isfinite(now).all():
        return None
    if np.abs(moved).max() > 0.15 * float(np.hypot(*(corners[0] - corners[2]))) + 1.0:
        return None
    slopes = _slopes(overlay, now, gain)
    freedom = max(1, len(residuals) - slopes.shape[1])
    noise = max(_MIN_NOISE / overlay.shrunk, math.sqrt(float(residuals @ residuals) / freedom))
    inverse = np.linalg.pinv(slopes.T @ slopes)[:8, :8]
    covariance = noise**2 * inverse * overlay.shrunk**2
    return FoundTag(number, overlay.whole(now), np.asarray(covariance))


def _residuals(overlay: _Overlay, corners: Array) -> tuple[Array, float, float]:
    """Return the residuals at the best gain and offset, the gain, and the correlation."""
    seen = overlay.seen(corners)
    varied, levels = seen - seen.mean(), overlay.levels - overlay.levels.mean()
    power = float(varied @ varied)
    if power <= 0.0:
        return levels, 0.0, 0.0
    gain = float(varied @ levels) / power
    likeness = float(varied @ levels) / math.sqrt(power * max(float(levels @ levels), 1e-9))
    return levels - gain * varied, gain, likeness


def _slopes(overlay: _Overlay, corners: Array, gain: float) -> Array:
    """Return the derivatives of each pixel by each corner, the gain and an offset."""
    found = np.empty((len(overlay.levels), 10))
    now = overlay.seen(corners)
    for i in range(8):
        step = np.zeros(8)
        step[i] = _STEP_PX
        found[:, i] = gain * (overlay.seen(corners + step.reshape(4, 2)) - now) / _STEP_PX
    found[:, 8], found[:, 9] = now, 1.0
    return found


def _fitted(overlay: _Overlay, corners: Array) -> Array:
    """Fit the corners to the picture (Gauss-Newton)."""
    now = corners
    for _ in range(_ITERATIONS):
        residuals, gain, _ = _residuals(overlay, now)
        if gain <= 0.0:
            return now
        step = np.linalg.lstsq(_slopes(overlay, now, gain), residuals, rcond=None)[0][:8]
        limit = max(1.0, float(np.abs(step).max()))
        now = now + step.reshape(4, 2) / limit
        if np.abs(step).max() < _ENOUGH_PX:
            break
    return now


# --- the position --------------------------------------------------------------------------------
_PLACE, _YAW, _CAMERA = slice(0, 3), 3, slice(6, 9)
_UNKNOWNS: Final = 9
_STEPS = np.array([1e-4] * 3 + [1e-5] * 6)
_SIGHT_ITERATIONS = 25
_ENOUGH: Final = 1e-7
_LIKELY: Final = 40.0
"""Maximum chi square of the residuals; a larger one means a wrong attitude."""


@dataclass(frozen=True, slots=True)
class SightingErrors:
    """Standard deviations of a sighting's inputs.

    Attributes:
        corner_px: Error of the lens's distortion after calibration, besides the picture's noise.
        tilt_rad: Error of the camera's attitude about each level axis, at the exposure.
        heading_rad: Error of the camera's heading.
    """

    corner_px: float = 0.1
    tilt_rad: float = math.radians(0.5)
    heading_rad: float = math.radians(2.0)


@dataclass(frozen=True, slots=True)
class Carrier:
    """Attitude of the vehicle that carries the marker.

    Attributes:
        roll_rad: Roll by telemetry, right side down.
        pitch_rad: Pitch by telemetry, nose up.
        tilt_rad: Standard deviation of each; the default, that of hovering in wind, applies without
            telemetry.
    """

    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    tilt_rad: float = math.radians(4.0)


@dataclass(frozen=True, slots=True)
class Sighting:
    """A marker's middle, in metres true east, north and up of the camera; its (3, 3) covariance."""

    east_m: float
    north_m: float
    up_m: float
    covariance_m2: Array


def sight(
    found: FoundTag,
    camera: Camera,
    attitude: Quaternion,
    tag_m: float,
    carrier: Carrier = Carrier(),
    errors: SightingErrors = SightingErrors(),
) -> Sighting | None:
    """Return the position of a marker; None if nothing fits, as with a wrong attitude.

    Args:
        found: From `vision.markers.find_tags`.
        camera: Camera without distortion.
        attitude: Camera axes to NED at the exposure, as in `missions.units.Pose`.
        tag_m: Side of the marker's black square, above 0.
    """
    view = _View(found, camera, rotation(attitude), tag_m, carrier, errors)
    now = view.guess()
    if now is None:
        return None
    for _ in range(_SIGHT_ITERATIONS):
        left, slopes = view.misfits(now), view.slopes(now)
        step = np.linalg.lstsq(slopes, -left, rcond=None)[0]
        now = now + step
        if np.abs(step).max() < _ENOUGH:
            break
    left, slopes = view.misfits(now), view.slopes(now)
    chi2 = float(left @ left)
    if not math.isfinite(chi2) or chi2 > _LIKELY:
        return None
    covariance = np.asarray(np.linalg.inv(slopes.T @ slopes), dtype=np.float64)
    east, north, up = (float(x) for x in now[_PLACE])
    return Sighting(east, north, up, np.asarray(covariance[_PLACE, _PLACE]))


class _View:
    """The measurement equations of one sighting.

    Its unknowns are the position (3), the yaw, the marker's roll and pitch, and the error of the
    camera's attitude. The error is a small rotation about north, east and down.
    """

    def __init__(
        self,
        found: FoundTag,
        camera: Camera,
        to_ned: Array,
        tag_m: float,
        carrier: Carrier,
        errors: SightingErrors,
    ) -> None:
        self._pixels = found.corners_px
        self._camera, self._to_ned, self._tag_m = camera, to_ned, tag_m
        half = tag_m / 2.0  # forward, right, down of the carrier
        self._corners = half * np.array([[1, -1, 0], [1, 1, 0], [-1, 1, 0], [-1, -1, 0]]).T
        covariance = found.covariance_px2 + errors.corner_px**2 * np.eye(8)
        self._whiten = np.linalg.inv(np.linalg.cholesky(covariance))
        self._told = np.array([carrier.roll_rad, carrier.pitch_rad, 0.0, 0.0, 0.0])
        self._sigmas = np.array(
            [carrier.tilt_rad] * 2 + [errors.tilt_rad] * 2 + [errors.heading_rad]
        )

    def _focus(self) -> tuple[float, float, float]:
        camera = self._camera
        return camera.focal_px, (camera.width_px - 1) / 2.0, (camera.height_px - 1) / 2.0

    def guess(self) -> Array | None:
        """Guess the state from size and direction without tilt; None if that gives no position."""
        focal, centre_u, centre_v = self._focus()
        quad = self._pixels
        one, other = quad[2] - quad[0], quad[3] - quad[1]
        area = 0.5 * abs(float(one[0] * other[1] - one[1] * other[0]))
        if not area > 0.0:
            return None
        middle = quad.mean(axis=0)
        ray = np.array([1.0, (middle[0] - centre_u) / focal, (middle[1] - centre_v) / focal])
        ned = self._to_ned @ ray
        if ned[2] <= 0.1:
            return None
        # a level square's area shrinks with the cube of depth over its height below
        depth = focal * self._tag_m * math.sqrt(ned[2] / area)
        north, east, down = depth * ned
        ahead = (quad[0] + quad[1] - quad[2] - quad[3]) / 2.0
        towards = self._to_ned @ np.array([0.0, ahead[0], ahead[1]])
        found = np.zeros(_UNKNOWNS)
        found[:4] = east, north, -down, math.atan2(towards[1], towards[0])
        found[4:] = self._told
        return found

    def misfits(self, x: Array) -> Array:
        """Return the measurements less those that follow from `x`, in standard deviations."""
        focal, centre_u, centre_v = self._focus()
        body = rotation(Quaternion.from_euler(float(x[4]), float(x[5]), float(x[_YAW])))
        corners = body @ self._corners + np.array([[x[1]], [x[0]], [-x[2]]])
        camera_axes = cv2.Rodrigues(x[_CAMERA])[0] @ self._to_ned
        forward, right, down = camera_axes.T @ corners
        pixels = np.stack(
            [centre_u + focal * right / forward, centre_v + focal * down / forward], axis=1
        )
        off = self._whiten @ (pixels - self._pixels).ravel()
        return np.concatenate([off, (x[4:] - self._told) / self._sigmas])

    def slopes(self, x: Array) -> Array:
        columns = []
        for i in range(_UNKNOWNS):
            step = np.zeros(_UNKNOWNS)
            step[i] = _STEPS[i]
            ahead, behind = self.misfits(x + step), self.misfits(x - step)
            columns.append((ahead - behind) / (2.0 * _STEPS[i]))
        return np.stack(columns, axis=1)
