"""Markers in a picture, with exact corners.

OpenCV's detector finds a marker and reads its number. Its corners are good to a third of a pixel,
too coarse where a marker has fifteen. So the known pattern, blurred as the picture is, is shifted
over the marker until all pixels agree: that uses all edges of the pattern at once, and gives the
corners' covariance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Gray = NDArray[np.uint8]

LEAST_EDGE_PX: Final = 8.0
"""Least edge of a marker in the picture, pixels."""
_ENLARGED_BELOW_PX = 2000
_ENLARGED = 2
_FINE_PX = 16  # pixels of the pattern for each of its modules
_MARGIN = 0.7  # modules around the black square that are looked at
_INNER = (np.arange(3) + 0.5) / 3 - 0.5
_MOST_PX = 3.0  # pixels for each module that are looked at; a larger marker is shrunk
_BLURS_PX = (0.25, 0.45, 0.7, 1.0, 1.4, 1.9)
_STEP_PX = 0.01
_ITERATIONS = 12
_ENOUGH_PX = 0.005
_LEAST_LIKENESS = 0.8  # correlation of picture and pattern
_LEAST_NOISE = 2.0  # gray levels


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
        """The mean length of its edges."""
        sides = self.corners_px - np.roll(self.corners_px, 1, axis=0)
        return float(np.hypot(sides[:, 0], sides[:, 1]).mean())


def find_tags(picture: NDArray[np.uint8], dictionary: str = "DICT_4X4_50") -> tuple[FoundTag, ...]:
    """Return the markers of a dictionary in a picture, by number; at most one of each.

    A number that is seen twice is left out, as is what does not look like its pattern, or is
    smaller than `LEAST_EDGE_PX`.

    Args:
        picture: Gray, (rows, columns), or in colour (blue, green, red), (rows, columns, 3).
        dictionary: A name of OpenCV's.
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
        if tag is not None and tag.edge_px >= LEAST_EDGE_PX:
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
        self.shrunk = max(1, int(edge / self._count / _MOST_PX))
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
    if gain <= 0.0 or likeness < _LEAST_LIKENESS or not np.isfinite(now).all():
        return None
    if np.abs(moved).max() > 0.15 * float(np.hypot(*(corners[0] - corners[2]))) + 1.0:
        return None
    slopes = _slopes(overlay, now, gain)
    freedom = max(1, len(residuals) - slopes.shape[1])
    noise = max(_LEAST_NOISE / overlay.shrunk, math.sqrt(float(residuals @ residuals) / freedom))
    inverse = np.linalg.pinv(slopes.T @ slopes)[:8, :8]
    covariance = noise**2 * inverse * overlay.shrunk**2
    return FoundTag(number, overlay.whole(now), np.asarray(covariance))


def _residuals(overlay: _Overlay, corners: Array) -> tuple[Array, float, float]:
    """Return the residuals beside the best gain and offset; the gain; the correlation."""
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
