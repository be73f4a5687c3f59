"""Search for recorded pictures that are stored upside down.

Picture viewers turn a photograph by 180 degrees without changing its gimbal angles, so no tag shows
it. Overlapping pictures agree only if both are upright. Each is compared with the one before it and
the nearest of the earlier ones, so the cost is linear in the number of pictures.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.geo.grid import Grid
from vision.camera import project
from vision.projection import OBLIQUE_LIMIT, Frame
from vision.registration.net import components

Floats = NDArray[np.float64]
Scores = Mapping[tuple[int, int], Floats]
"""The agreement of pictures i < j for (i turned, j turned): 2 x 2, 0 to 1."""

_Neighbours = Mapping[int, Mapping[int, Floats]]

MARGIN = 0.05
"""Minimum mean gain per pair for which pictures are turned."""


def best_labels(count: int, scores: Scores) -> tuple[bool, ...]:
    """Return for each picture whether it is turned, so that the sum over the pairs is largest.

    The search visits every pair a few times. Pictures that pairs connect are labelled together;
    they stay as stored if turning gains less than `MARGIN` per pair.

    >>> best_labels(3, {(0, 1): np.array([[0.1, 0.9], [0.8, 0.1]])})
    (False, True, False)
    """
    near: dict[int, dict[int, Floats]] = {k: {} for k in range(count)}
    for (i, j), table in scores.items():
        near[i][j], near[j][i] = table, table.T
    turned = [False] * count
    for component in components(count, scores):
        grown = [_grown(component[0], way, near) for way in (False, True)]
        labels = max(grown, key=lambda found: _sum(found, near))
        as_stored = dict.fromkeys(component, False)
        pairs = sum(len(near[k]) for k in component) // 2
        if _sum(labels, near) > _sum(as_stored, near) + MARGIN * pairs:
            for k, way in labels.items():
                turned[k] = way
    return tuple(turned)


def _gain(k: int, labels: Mapping[int, bool], near: _Neighbours) -> float:
    total = 0.0
    for other, table in near[k].items():
        if other in labels:
            column = int(labels[other])
            total += float(table[1, column] - table[0, column])
    return total


def _grown(first: int, way: bool, near: _Neighbours) -> dict[int, bool]:
    """Label outwards from a picture, the clearest neighbour next; then correct the labels."""
    labels: dict[int, bool] = {}
    heap: list[tuple[float, int]] = [(0.0, first)]
    clearest = {first: 0.0}
    while heap:
        sureness, k = heapq.heappop(heap)
        if k in labels or -sureness != clearest[k]:
            continue
        labels[k] = _gain(k, labels, near) > 0.0 if labels else way
        for other in near[k]:
            if other not in labels:
                clearest[other] = abs(_gain(other, labels, near))
                heapq.heappush(heap, (-clearest[other], other))
    _mend(labels, near)
    return labels


def _mend(labels: dict[int, bool], near: _Neighbours) -> None:
    """Turn the picture that disagrees most with its neighbours until none does."""
    gains = {k: _gain(k, labels, near) for k in labels}
    for _ in range(len(labels)):
        wrong = [k for k, gain in gains.items() if (gain > 0.0) != labels[k]]
        if not wrong:
            return
        worst = max(wrong, key=lambda k: (abs(gains[k]), -k))
        labels[worst] = not labels[worst]
        for other in near[worst]:
            gains[other] = _gain(other, labels, near)


def _sum(labels: Mapping[int, bool], near: _Neighbours) -> float:
    return sum(
        float(table[int(labels[i]), int(labels[j])])
        for i in sorted(labels)
        for j, table in near[i].items()
        if i < j
    )


_PIXELS_A_HEIGHT = 40  # resolution of the comparison: a metre from 40 m
_SEARCH = 0.12  # maximum error of positions, as a share of the height: some 5 m from 40 m
_MIN_COMMON = 100  # pixels that two pictures must share to be compared
_MIN_VARIANCE = 1e-2  # levels squared; less is the arithmetic's own
_PARTNERS = 2  # number of pictures compared with one, besides the one before it
_MIN_BLUR_PX = 3  # of enlarged pixels: it is then as round as a blur of the picture's own
_KEPT = 600  # maximum distance between compared pictures, in pictures


@dataclass(frozen=True, slots=True)
class Patch:
    """A frame projected onto the ground, north up: as stored, and turned by 180 degrees."""

    west_px: int
    north_px: int
    ways: tuple[NDArray[np.uint8], NDArray[np.uint8]]
    seen: NDArray[np.uint8]

    @property
    def middle(self) -> tuple[float, float]:
        """Column and row of its middle on the ground's raster."""
        rows, columns = self.seen.shape
        return self.west_px + columns / 2.0, self.north_px - rows / 2.0


@dataclass(slots=True)
class UprightSearch:
    """Compares pictures as they come; then reports those that are upside down.

    `pitch_m` is the raster on the ground for the comparison: `pitch_for` the heights.
    """

    grid: Grid
    pitch_m: float
    _count: int = 0
    _kept: deque[tuple[int, Patch]] = field(default_factory=lambda: deque(maxlen=_KEPT))
    _scores: dict[tuple[int, int], Floats] = field(default_factory=dict)

    @staticmethod
    def pitch_for(heights_m: Sequence[float]) -> float:
        """Return the edge of the raster's pixels, metres, for pictures from such heights, metres.

        >>> UprightSearch.pitch_for([40.0, 40.0, 4000.0])
        1.0
        """
        usual_m = float(np.median([max(height_m, 1.0) for height_m in heights_m]))
        return usual_m / _PIXELS_A_HEIGHT

    def patch(self, frame: Frame) -> Patch | None:
        """Project a frame onto the ground; None if it looks too far sideways. Thread-safe."""
        grid, pitch_m = self.grid, self.pitch_m
        if frame.pose.height_m <= 0.0:
            return None
        width, height = frame.camera.width_px, frame.camera.height_px
        matrix = frame.camera.homography(frame.pose, grid, frame.t_s)
        corners = np.array(
            [[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], float
        )
        to_ground: Floats = np.linalg.inv(matrix).astype(np.float64)
        ground, _ = project(_positive_at_centre(to_ground, width, height), corners)
        here = grid.to_moving(grid.fixed(frame.pose.position), frame.t_s)
        reach_m = np.hypot(*(ground - np.array(here)).T).max()
        if not reach_m <= OBLIQUE_LIMIT * frame.pose.height_m:  # NaN: a corner at the sky
            return None
        low = np.floor(ground.min(axis=0) / pitch_m).astype(int)
        high = np.ceil(ground.max(axis=0) / pitch_m).astype(int)
        columns, rows = (int(n) for n in high - low)
        ground_of_sample = np.array(
            [
                [pitch_m, 0.0, (low[0] + 0.5) * pitch_m],
                [0.0, -pitch_m, (high[1] - 0.5) * pitch_m],
                [0.0, 0.0, 1.0],
            ]
        )
        to_pixels = matrix @ ground_of_sample
        half_turn = np.array([[-1.0, 0.0, width - 1.0], [0.0, -1.0, height - 1.0], [0.0, 0.0, 1.0]])
        # blurred to the raster's resolution: single pixels of leaves and gravel would be noise
        blur_px = frame.camera.focal_px * pitch_m / frame.pose.height_m
        gray, times = _halved(cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY), blur_px)
        blur = max(1, round(blur_px / times))
        gray = cv2.blur(gray, (blur, blur))
        middle = (1.0 - times) / (2.0 * times)
        smaller = np.array(
            [[1.0 / times, 0.0, middle], [0.0, 1.0 / times, middle], [0.0, 0.0, 1.0]]
        )
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        ways = tuple(
            cv2.warpPerspective(gray, smaller @ m, (columns, rows), flags=flags).astype(
                np.uint8, copy=False
            )
            for m in (to_pixels, half_turn @ to_pixels)
        )
        rim = (ground / pitch_m - (low[0] + 0.5, high[1] - 0.5)) * (1.0, -1.0)
        seen = np.zeros((rows, columns), np.uint8)
        cv2.fillConvexPoly(seen, np.round(rim).astype(np.int32), (255,))
        inner = cv2.erode(
            seen, np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0
        )
        return Patch(
            int(low[0]), int(high[1]), (ways[0], ways[1]), inner.astype(np.uint8, copy=False)
        )

    def add(self, patch: Patch | None) -> None:
        """Add the patch of the next picture, in the order of exposure."""
        number = self._count
        self._count += 1
        if patch is None:
            return
        for other, kept in self._partners(patch):
            score = _correlations(kept, patch)
            if score is not None:
                self._scores[other, number] = score
        self._kept.append((number, patch))

    def turned(self) -> tuple[bool, ...]:
        """Return for each picture whether it must be turned to agree with the others.

        These labels correlate overlapping pairs best, summed over the pairs. Pictures without
        overlap stay as they are, as do all if the gain is below a small margin.
        """
        return best_labels(self._count, self._scores)

    def _partners(self, patch: Patch) -> list[tuple[int, Patch]]:
        """Return the picture before, and the nearest of the others that may overlap."""
        if not self._kept:
            return []
        *others, before = self._kept
        x, y = patch.middle
        far = max(patch.seen.shape)
        near = []
        for number, kept in others:
            kept_x, kept_y = kept.middle
            away = max(abs(kept_x - x), abs(kept_y - y))
            if away < (far + max(kept.seen.shape)) / 2.0:
                near.append((away, number, kept))
        near.sort(key=lambda entry: entry[:2])
        return [before, *((number, kept) for _, number, kept in near[:_PARTNERS])]


def _halved(gray: NDArray[Any], blur_px: float) -> tuple[NDArray[Any], int]:
    """Halve a picture while the blur allows it; return it, and the old pixels along a new one.

    >>> _halved(np.ones((9, 12), np.uint8), 20.0)[0].shape
    (2, 3)
    >>> _halved(np.ones((9, 12), np.uint8), 3.0)[1]
    1
    """
    times = 1
    while blur_px / times >= 2 * _MIN_BLUR_PX and min(gray.shape) > 1:
        rows, columns = (side // 2 for side in gray.shape)  # an odd one has no partner
        gray = cv2.resize(
            gray[: 2 * rows, : 2 * columns], (columns, rows), interpolation=cv2.INTER_AREA
        )
        times *= 2
    return gray, times


def _positive_at_centre(matrix: Floats, width: int, height: int) -> Floats:
    """Sign the matrix such that the middle of the picture is in front."""
    middle = matrix[2] @ np.array([(width - 1) / 2, (height - 1) / 2, 1.0])
    return matrix if middle > 0.0 else -matrix


def _correlations(first: Patch, second: Patch) -> Floats | None:
    """Return the best correlations by (first turned, second turned); None if little is common."""
    west = max(first.west_px, second.west_px)
    north = min(first.north_px, second.north_px)
    shapes = [p.seen.shape for p in (first, second)]
    east = min(p.west_px + s[1] for p, s in zip((first, second), shapes, strict=True))
    south = max(p.north_px - s[0] for p, s in zip((first, second), shapes, strict=True))
    if east <= west or north <= south:
        return None
    windows = [
        (
            slice(p.north_px - north, p.north_px - south),
            slice(west - p.west_px, east - p.west_px),
        )
        for p in (first, second)
    ]
    search = round(_SEARCH * _PIXELS_A_HEIGHT)
    common = cv2.erode(
        first.seen[windows[0]] & second.seen[windows[1]],
        np.ones((2 * search + 1, 2 * search + 1), np.uint8),
        borderType=cv2.BORDER_CONSTANT,
        borderValue=0,
    )
    if cv2.countNonZero(common) < _MIN_COMMON:
        return None
    x, y, w, h = cv2.boundingRect(common)
    weight = (common[y : y + h, x : x + w] > 0).astype(np.float32)
    around = (slice(y - search, y + h + search), slice(x - search, x + w + search))
    templates = [way[windows[0]][y : y + h, x : x + w] for way in first.ways]
    return _best_scores(templates, [way[windows[1]][around] for way in second.ways], weight)


def _best_scores(
    templates: Sequence[NDArray[np.uint8]],
    images: Sequence[NDArray[np.uint8]],
    weight: NDArray[np.float32],
) -> Floats:
    """Return the best correlation of each weighted template over all places in each image.

    The result is that of `cv2.matchTemplate` with a mask, at a third of its cost. Terms that depend
    on one of the two alone are computed once.
    """
    count = float(weight.sum())
    centred = []
    for template in templates:
        values = template.astype(np.float32)
        values = (values - float((values * weight).sum()) / count) * weight
        centred.append((values, float(np.square(values).sum())))
    score = np.zeros((len(templates), len(images)))
    for j, image in enumerate(images):
        there = image.astype(np.float32)
        there -= there.mean()  # of small numbers the squares are exact enough
        total = cv2.matchTemplate(there, weight, cv2.TM_CCORR)
        squares = cv2.matchTemplate(there * there, weight, cv2.TM_CCORR)
        spread = squares - total * total / count
        for i, (values, own) in enumerate(centred):
            product = cv2.matchTemplate(there, values, cv2.TM_CCORR)
            # without contrast there is no evidence
            known = (spread > _MIN_VARIANCE * count) & (own > _MIN_VARIANCE * count)
            scale = np.sqrt(np.maximum(spread * own, 1e-12))
            score[i, j] = np.clip(np.where(known, product / scale, 0.0), 0.0, 1.0).max()
    return score
