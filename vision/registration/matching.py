"""From pictures to tie points: distinctive points (SIFT), pictures that may overlap, matches.

Points are spread evenly over a picture, whatever its exposure.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.registration.ground_plane import Cameras, to_ground, to_pixels
from vision.registration.views import Features, FeaturesLike, Floats, View

WIDTH_PX: Final = 700
"""Widest picture that is registered, pixels: finer detail costs time and adds nothing to a pose."""

MOST: Final = 1200
"""Maximum number of points of a picture."""

_COLUMNS, _ROWS = 10, 6  # of the lattice of buckets that points are spread over
_LOCAL_PX = (61, 61)  # window over which contrast is measured
_NOISE = 4.0  # gray levels; contrast below it is noise, and is not raised to the level of texture
_RIM_PX = 4.0
_MIN_PX = 32  # a smaller picture has no room for features


def extract(gray: NDArray[np.uint8]) -> Features:
    """Return the features of a gray picture of at most `WIDTH_PX` columns; there may be none.

    >>> extract(np.full((90, 160), 100, np.uint8)).points.shape
    (0, 2)
    """
    height, width = gray.shape
    nothing = Features(np.zeros((0, 2)), np.zeros((0, 128), np.uint8), width, height)
    if min(height, width) < _MIN_PX:
        return nothing
    sift = cv2.SIFT.create(nfeatures=0, contrastThreshold=0.02, edgeThreshold=12.0)
    even = _normalised(gray)
    found = [k for k in sift.detect(even, None) if _inside(k.pt, width, height)]
    if not found:
        return nothing
    points = np.array([k.pt for k in found])
    chosen = _strongest(points, np.array([k.response for k in found]), width, height)
    # descriptors cost most: they are computed for the chosen points alone
    kept, descriptors = sift.compute(even, [found[k] for k in chosen])
    middle = np.array([(width - 1) / 2.0, (height - 1) / 2.0])
    return Features(
        np.array([k.pt for k in kept]) - middle,
        _rooted(np.asarray(descriptors, dtype=np.float32)),
        width,
        height,
    )


def thumbnail(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture (rows, columns[, 3]) in gray, at most `WIDTH_PX` wide."""
    gray = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    height, width = gray.shape
    if width > WIDTH_PX:
        size = (WIDTH_PX, max(1, round(height * WIDTH_PX / width)))
        gray = cv2.resize(gray, size, interpolation=cv2.INTER_AREA)
    return np.asarray(gray, dtype=np.uint8)


def _inside(point: Sequence[float], width: int, height: int) -> bool:
    x, y = point
    return _RIM_PX < x < width - 1 - _RIM_PX and _RIM_PX < y < height - 1 - _RIM_PX


def _normalised(gray: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Even out mean and contrast, so that exposure and haze matter little."""
    values = gray.astype(np.float32)
    mean = cv2.blur(values, _LOCAL_PX)
    spread = np.sqrt(cv2.blur(np.square(values - mean), _LOCAL_PX))
    scaled = 128.0 + 45.0 * (values - mean) / np.maximum(spread, _NOISE)
    whole: NDArray[np.uint8] = np.clip(np.round(scaled), 0, 255).astype(np.uint8)
    return whole


def _strongest(
    points: NDArray[np.float64], strength: NDArray[np.float64], width: int, height: int
) -> NDArray[np.int64]:
    """Return the strongest of each bucket, in an order that depends on the points alone."""
    column = np.clip(points[:, 0] * _COLUMNS / width, 0, _COLUMNS - 1).astype(int)
    row = np.clip(points[:, 1] * _ROWS / height, 0, _ROWS - 1).astype(int)
    bucket = row * _COLUMNS + column
    order = np.lexsort((points[:, 1], points[:, 0], -strength, bucket))
    starts = np.searchsorted(bucket[order], np.arange(_COLUMNS * _ROWS))
    rank = np.arange(len(order)) - starts[bucket[order]]
    by_rank = np.lexsort((np.arange(len(order)), rank))
    chosen: NDArray[np.int64] = np.sort(order[by_rank[:MOST]])
    return chosen


def _rooted(descriptors: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return square roots of the histograms (RootSIFT), as whole numbers.

    Their products are exact in float32, in any order of addition.
    """
    total = np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-6)
    scaled = np.round(512.0 * np.sqrt(descriptors / total))
    rooted: NDArray[np.uint8] = np.clip(scaled, 0, 255).astype(np.uint8)
    return rooted


# --- pairs ---------------------------------------------------------------------------------------
NEAREST: Final = 6
SECTORS: Final = 8
NEAREST_IN_SECTOR: Final = 2

MIN_INLIERS: Final = 16
"""Minimum number of tie points of a pair that overlaps."""

MAX_TIES: Final = 60
"""Maximum number of tie points of a pair in the adjustment."""

_LENGTH_2 = 512.0**2  # squared length of a descriptor: `features` makes all alike, but for rounding
_RATIO = 0.85  # maximum distance of a match, as a share of that of the second best
_TOLERANCE_PX = 4.0  # of the homography: trees and roofs are not on the plane
_MIN_SHARE = 0.2  # of the matches, which agree on one homography
_SCALES = (0.3, 3.3)  # of two pictures of one flight
_MOVED_M = 1.0  # minimum distance of geotags of a moving camera
_STAYED_PX = 1.0
_BUCKETS = 8  # a side, over which tie points are spread


@dataclass(frozen=True, slots=True)
class Pair:
    """Two views that overlap, with points of the same ground.

    Attributes:
        first: Index of a view.
        second: Index of another, above `first`.
        in_first: (n, 2) pixels from the middle of the first picture.
        in_second: (n, 2) the same points in the second.
        held: (k, 4) tie points that no fit uses: pixels in first, in second.
        inliers: Number of tie points found.
    """

    first: int
    second: int
    in_first: Floats
    in_second: Floats
    held: Floats
    inliers: int


def candidates(views: Sequence[View]) -> list[tuple[int, int]]:
    """Return pairs that may overlap by their geotags, sorted; linear in the views.

    The partners of a view are the nearest ones, and the nearest in each sector around it. The
    sectors keep the neighbouring pass among them, although pictures of one pass are closer.
    """
    places = np.array([[v.east_m, v.north_m] for v in views]).reshape(-1, 2)
    found: set[tuple[int, int]] = set()
    for i, place in enumerate(places):
        away = places - place
        distance = np.hypot(away[:, 0], away[:, 1])
        order = np.lexsort((np.arange(len(views)), distance))
        order = order[order != i]
        sector = np.floor(np.arctan2(away[:, 1], away[:, 0]) / math.tau * SECTORS).astype(int)
        chosen = list(order[:NEAREST])
        for s in range(-SECTORS // 2, SECTORS // 2 + 1):
            chosen += list(order[sector[order] % SECTORS == s % SECTORS][:NEAREST_IN_SECTOR])
        found |= {(min(i, int(j)), max(i, int(j))) for j in chosen}
    return sorted(found)


def tie_points(one: View, other: View, pair: tuple[int, int]) -> Pair | None:
    """Return the tie points of two pictures; None if they have too few in common."""
    first, second = one.features, other.features
    a, b = mutual_matches(first, second)
    p, q = first.points[a], second.points[b]
    if math.hypot(one.east_m - other.east_m, one.north_m - other.north_m) > _MOVED_M:
        # the camera has moved, so a point at the same pixel is a stamp, dust or the sensor's
        # pattern
        went = np.square(p - q).sum(axis=1) > _STAYED_PX**2
        p, q = p[went], q[went]
    if len(p) < MIN_INLIERS:
        return None
    matrix, mask = cv2.findHomography(
        p, q, cv2.RANSAC, _TOLERANCE_PX, maxIters=3000, confidence=0.999
    )
    if matrix is None:
        return None
    inlier = mask.ravel().astype(bool)
    count = int(inlier.sum())
    if count < MIN_INLIERS or count < _MIN_SHARE * len(p):
        return None
    p, q = p[inlier], q[inlier]
    if not _plausible(np.asarray(matrix, dtype=np.float64), p):
        return None
    keep = _spread(p)
    p, q = p[keep], q[keep]
    held = np.arange(len(p)) % 5 == 4
    return Pair(*pair, p[~held], q[~held], np.hstack([p[held], q[held]]), count)


def mutual_matches(
    first: FeaturesLike, second: FeaturesLike
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return indices of points that are each other's nearest by a clear margin."""
    none = np.zeros(0, np.int64)
    if len(first.points) < 2 or len(second.points) < 2:
        return none, none
    alike = first.descriptors.astype(np.float32) @ second.descriptors.astype(np.float32).T
    rows = np.arange(len(alike))
    best, back = alike.argmax(axis=1), alike.argmax(axis=0)
    nearest = _LENGTH_2 - alike[rows, best]
    alike[rows, best] = -np.inf
    next_best = _LENGTH_2 - alike.max(axis=1)
    good = (nearest < _RATIO**2 * next_best) & (back[best] == rows)
    return rows[good], best[good].astype(np.int64)


def _plausible(matrix: Floats, points: Floats) -> bool:
    """Return whether two pictures of flat ground from above can be related in this way."""
    x, y = points.mean(axis=0)
    w = matrix[2] @ (x, y, 1.0)
    u, v = (matrix[:2] @ (x, y, 1.0)) / w
    jacobian = (matrix[:2, :2] - np.outer((u, v), matrix[2, :2])) / w
    determinant = float(np.linalg.det(jacobian))
    if not _SCALES[0] ** 2 < determinant < _SCALES[1] ** 2:
        return False  # mirrored, which ground never is
    stretch = np.linalg.svd(jacobian, compute_uv=False)
    return bool(stretch[0] < 2.0 * stretch[1])


def _spread(points: Floats) -> NDArray[np.int64]:
    """Return at most `MAX_TIES` of the points, spread over the overlap."""
    low, high = points.min(axis=0), points.max(axis=0)
    place = ((points - low) / np.maximum(high - low, 1.0) * (_BUCKETS - 1e-6)).astype(int)
    bucket = place[:, 1] * _BUCKETS + place[:, 0]
    order = np.lexsort((np.arange(len(points)), bucket))
    starts = np.searchsorted(bucket[order], np.arange(_BUCKETS**2))
    rank = np.arange(len(order)) - starts[bucket[order]]
    chosen: NDArray[np.int64] = order[np.lexsort((bucket[order], rank))[:MAX_TIES]]
    return chosen


def apart_m(cameras: Cameras, pair: Pair) -> Floats:
    """Return the distance on the ground between both views of the held tie points, metres."""
    return _lengths(
        to_ground(cameras, np.full(len(pair.held), pair.first), pair.held[:, :2])
        - to_ground(cameras, np.full(len(pair.held), pair.second), pair.held[:, 2:])
    )


def transfer_px(cameras: Cameras, pair: Pair) -> Floats:
    """Return the distance in the second picture of the first's held points from theirs, pixels."""
    return _misses_px(cameras, pair, pair.held[:, :2], pair.held[:, 2:])


def pair_medians_px(cameras: Cameras, pairs: Sequence[Pair]) -> Floats:
    """Return each pair's median transfer error over its tie points, pixels."""
    misses = (_misses_px(cameras, p, p.in_first, p.in_second) for p in pairs)
    return np.array([float(np.median(joined([missed]))) for missed in misses])


def _misses_px(cameras: Cameras, pair: Pair, here: Floats, there: Floats) -> Floats:
    ground = to_ground(cameras, np.full(len(here), pair.first), here)
    return _lengths(to_pixels(cameras, np.full(len(here), pair.second), ground) - there)


def joined(parts: Sequence[Floats]) -> Floats:
    """Join the parts; points beyond the horizon are infinitely far."""
    values = np.concatenate([np.zeros(0), *parts])
    return np.where(np.isfinite(values), values, np.inf)


def _lengths(offsets: Floats) -> Floats:
    lengths: Floats = np.sqrt(np.square(offsets).sum(axis=1))
    return lengths
