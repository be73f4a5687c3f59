"""Which recorded pictures are stored upside down.

Picture viewers turn a photograph by 180 degrees without touching its gimbal angles, and then no tag
tells. The ground does: where two pictures overlap, they agree only if both are the right way up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.ground.grid import Grid
from vision.camera import project
from vision.look import OBLIQUE_LIMIT, Frame

_PIXELS_A_HEIGHT = 80  # resolution of the comparison: half a metre from 40 m
_SEARCH = 0.12  # how far positions may be off, in heights: some 5 m from 40 m
_LEAST_COMMON = 400  # pixels that two pictures must share to be compared
_MARGIN = 0.05  # mean gain in correlation below which nothing is called turned

# the correlation of frames i < j for (i turned, j turned)
_Scores = dict[tuple[int, int], NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class _Patch:
    """A frame laid on the ground, north up: as stored, and turned by 180 degrees."""

    west_px: int
    north_px: int
    ways: tuple[NDArray[np.float32], NDArray[np.float32]]
    seen: NDArray[np.uint8]


def upside_down(frames: Sequence[Frame], grid: Grid) -> tuple[bool, ...]:
    """For each frame, whether its picture has to be turned by 180 degrees to agree with the others.

    The labels are those under which the overlapping pairs correlate best, summed over the pairs.
    Frames that see past `OBLIQUE_LIMIT` heights, or overlap no other, are taken as they are; so is
    everything where the best labels gain less than a small margin.
    """
    if not frames:
        return ()
    pitch_m = float(np.median([max(f.pose.height_m, 1.0) for f in frames])) / _PIXELS_A_HEIGHT
    patches = [_patch(frame, grid, pitch_m) for frame in frames]
    scores: _Scores = {}
    for i, j in combinations(range(len(frames)), 2):
        first, second = patches[i], patches[j]
        if first is not None and second is not None:
            score = _correlations(first, second)
            if score is not None:
                scores[i, j] = score
    turned = [False] * len(frames)
    for component in _components(len(frames), scores):
        for k, way in _best_labels(component, scores).items():
            turned[k] = way
    return tuple(turned)


# --- the pictures on the ground ----------------------------------------------------------------
def _patch(frame: Frame, grid: Grid, pitch_m: float) -> _Patch | None:
    """The frame on a raster of `pitch_m`; None if it looks too far sideways."""
    if frame.pose.height_m <= 0.0:
        return None
    width, height = frame.camera.width_px, frame.camera.height_px
    matrix = frame.camera.homography(frame.pose, grid, frame.t_s)
    corners = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], float)
    to_ground: NDArray[np.float64] = np.linalg.inv(matrix).astype(np.float64)
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
    # blurred to the raster, or the raster would pick single pixels out of leaves and gravel
    blur = max(1, round(frame.camera.focal_px * pitch_m / frame.pose.height_m))
    gray = cv2.blur(cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY), (blur, blur)).astype(np.float32)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    ways = tuple(
        cv2.warpPerspective(gray, m, (columns, rows), flags=flags).astype(np.float32, copy=False)
        for m in (to_pixels, half_turn @ to_pixels)
    )
    full = np.full(gray.shape, 255, np.uint8)
    nearest = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    seen = cv2.warpPerspective(full, to_pixels, (columns, rows), flags=nearest)
    seen = cv2.erode(seen, np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return _Patch(int(low[0]), int(high[1]), (ways[0], ways[1]), seen.astype(np.uint8, copy=False))


def _positive_at_centre(
    matrix: NDArray[np.float64], width: int, height: int
) -> NDArray[np.float64]:
    """The matrix with its sign such that the middle of the picture is in front."""
    middle = matrix[2] @ np.array([(width - 1) / 2, (height - 1) / 2, 1.0])
    return matrix if middle > 0.0 else -matrix


def _correlations(first: _Patch, second: _Patch) -> NDArray[np.float64] | None:
    """Best correlation for each (first turned, second turned); None without enough in common."""
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
    if cv2.countNonZero(common) < _LEAST_COMMON:
        return None
    x, y, w, h = cv2.boundingRect(common)
    weight = (common[y : y + h, x : x + w] > 0).astype(np.float32)
    around = (slice(y - search, y + h + search), slice(x - search, x + w + search))
    score = np.zeros((2, 2))
    for i, one in enumerate(first.ways):
        template = one[windows[0]][y : y + h, x : x + w]
        for j, other in enumerate(second.ways):
            found = cv2.matchTemplate(
                other[windows[1]][around], template, cv2.TM_CCOEFF_NORMED, mask=weight
            )
            # without contrast the correlation is 0 / 0: it says nothing
            score[i, j] = np.clip(np.nan_to_num(found, nan=0.0, posinf=0.0, neginf=0.0), 0, 1).max()
    return score


# --- the labels ---------------------------------------------------------------------------------
def _components(count: int, scores: _Scores) -> list[list[int]]:
    """The groups of frames that hang together by overlaps, each sorted."""
    group = list(range(count))
    for i, j in scores:
        old, new = max(group[i], group[j]), min(group[i], group[j])
        group = [new if g == old else g for g in group]
    return [[k for k in range(count) if group[k] == g] for g in sorted(set(group))]


def _best_labels(component: list[int], scores: _Scores) -> dict[int, bool]:
    """The labels of a component with the largest sum of correlations that the search finds."""
    pairs = {p: s for p, s in scores.items() if p[0] in component}
    neighbours: dict[int, list[int]] = {k: [] for k in component}
    for i, j in pairs:
        neighbours[i].append(j)
        neighbours[j].append(i)

    def gain(k: int, labels: dict[int, bool]) -> float:
        """What frame k adds when turned, over when not, given the labels of its neighbours."""
        total = 0.0
        for other in neighbours[k]:
            if other in labels:
                table = pairs[k, other] if k < other else pairs[other, k].T
                column = table[:, int(labels[other])]
                total += float(column[1] - column[0])
        return total

    def grown(way: bool) -> dict[int, bool]:
        """Label outwards from the first frame, the clearest next; then mend until none changes."""
        labels = {component[0]: way}
        while len(labels) < len(component):
            rest = [k for k in component if k not in labels]
            k = max(rest, key=lambda k: (abs(gain(k, labels)), -k))
            labels[k] = gain(k, labels) > 0.0
        for _ in range(len(component)):
            wrong = [k for k in component if (gain(k, labels) > 0.0) != labels[k]]
            if not wrong:
                break
            worst = max(wrong, key=lambda k: (abs(gain(k, labels)), -k))
            labels[worst] = not labels[worst]
        return labels

    def total(labels: dict[int, bool]) -> float:
        return sum(float(s[int(labels[i]), int(labels[j])]) for (i, j), s in pairs.items())

    as_stored = dict.fromkeys(component, False)
    best = max((grown(False), grown(True)), key=total)
    return best if total(best) > total(as_stored) + _MARGIN * len(pairs) else as_stored
