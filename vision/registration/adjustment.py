"""Bundle adjustment of views over known ground: all poses at once, by Levenberg-Marquardt.

It projects tie points of one picture over the ground into the other. It minimises their distances
there from the points' places (pixels), and the differences from the tags. Ground points are no
unknowns: the normal equations have 6 unknowns a view, and a block for each overlapping pair.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vision.registration.ground_plane import UNKNOWNS, Cameras, bearing, moved, skew, transfer
from vision.registration.matching import Pair
from vision.registration.net import HEIGHT_BIAS, YAW_BIAS_RAD
from vision.registration.normal_equations import Normal
from vision.registration.views import Floats, Ints

TIE_SIGMA_PX: Final = 1.0

INDEPENDENT: Final = 12.0
"""Maximum number of independent tie points of a pair: all share the errors of relief and lens."""

HEIGHT, YAW, SLOPE = 0, 1, slice(2, 4)
"""The shared unknowns after the focal lengths."""

SHARED: Final = 4
"""Number of these unknowns."""


@dataclass
class Tags:
    """Tags of the views of a net; NaN for a missing one."""

    place_m: Floats
    place_sigma_m: Floats
    height_m: Floats
    height_sigma_m: Floats
    yaw_rad: Floats
    yaw_sigma_rad: Floats
    tilt: Floats
    tilt_sigma: Floats
    focal_px: Floats
    focal_sigma: Floats


@dataclass
class Ties:
    """Tie points of all pairs: half of them from first to second, half back."""

    source: Ints
    target: Ints
    in_source: Floats
    in_target: Floats
    pair: Ints
    weight: Floats
    pairs: Ints

    @classmethod
    def from_pairs(cls, pairs: Sequence[Pair]) -> Ties:
        """Return the tie points of pairs, without those that are held back."""
        ends = np.array([[p.first, p.second] for p in pairs])
        counts = [len(p.in_first) for p in pairs]
        number = np.repeat(np.arange(len(pairs)), counts)
        forth = np.concatenate([np.arange(count) % 2 == 0 for count in counts])[:, None]
        source, target = np.where(forth, ends[number], ends[number, ::-1]).T
        one = np.concatenate([p.in_first for p in pairs])
        other = np.concatenate([p.in_second for p in pairs])
        each = [min(1.0, INDEPENDENT / max(count, 1)) / TIE_SIGMA_PX**2 for count in counts]
        return cls(
            source,
            target,
            np.where(forth, one, other),
            np.where(forth, other, one),
            number,
            np.repeat(each, counts),
            ends,
        )


@dataclass
class Solution:
    """The adjusted cameras, and the unknowns that a net has in common.

    Attributes:
        cameras: Over ground that is level in their frame.
        shared: The bias of height tags (a share), of headings (radians), and the slopes of the
            ground, falling towards east and north (tangents). Sloping ground leans the whole net: a
            camera above `(x, y)` at height `h` has its geotag at `(x, y) + h slope`.
        middle_m: (east, north) around which the net leans.
        cost: The minimised sum, without unit.
        normal: The normal equations at the end.
    """

    cameras: Cameras
    shared: Floats
    middle_m: Floats
    cost: float
    normal: Normal | None = None

    @property
    def slope(self) -> Floats:
        """Slope of the ground towards east and north, tangents; positive where it falls."""
        return self.shared[SLOPE]


def huber(size: Floats, limit: float) -> tuple[Floats, Floats]:
    """Return weights and costs of residuals by their sizes."""
    inside = size <= limit
    safe = np.maximum(size, 1e-12)
    weight = np.where(inside, 1.0, limit / safe)
    cost = np.where(inside, 0.5 * size**2, limit * (size - 0.5 * limit))
    return weight, cost


SLOPE_SIGMA: Final = 0.05
"""Standard deviation of the slope of the ground in one direction, a tangent."""

KNOWN_SLOPE_SIGMA: Final = 1e-4
"""Standard deviation of that slope if an elevation model gives it, a tangent."""

_PRIOR_HUBER = 2.0  # residual of a tag, in standard deviations, from which its force is constant
_UNKNOWN_HEIGHT = 0.5  # an untagged height equals the others within this share


class _Rows:
    """Residuals of tags, `count` a view, in standard deviations, with their derivatives."""

    def __init__(self, views: int, count: int) -> None:
        self.off: Floats = np.zeros((views, count))
        self.by_view: Floats = np.zeros((views, count, UNKNOWNS))
        self.by_shared: Floats = np.zeros((views, count, SHARED))

    def add(self, normal: Normal, chosen: NDArray[np.bool_] | None = None) -> float:
        """Add to the normal equations by Huber's weights, for `chosen` views; return the cost."""
        weight, cost = huber(np.sqrt(np.square(self.off).sum(axis=1)), _PRIOR_HUBER)
        if chosen is not None:
            weight, cost = np.where(chosen, weight, 0.0), np.where(chosen, cost, 0.0)
        groups = normal.corner.shape[0] - SHARED
        view, shared = self.by_view * weight[:, None, None], self.by_shared * weight[:, None, None]
        normal.diagonal += np.einsum("nki,nkj->nij", view, self.by_view)
        normal.border[:, :, groups:] += np.einsum("nki,nkj->nij", view, self.by_shared)
        normal.corner[groups:, groups:] += np.einsum("nki,nkj->ij", shared, self.by_shared)
        normal.right -= np.einsum("nki,nk->ni", view, self.off)
        normal.right_shared[groups:] -= np.einsum("nki,nk->i", shared, self.off)
        return float(cost.sum())


def _add_places(normal: Normal, solution: Solution, tags: Tags) -> float:
    centre = solution.cameras.centre_m
    rows = _Rows(len(centre), 2)
    each = 1.0 / tags.place_sigma_m
    rows.off = (centre[:, :2] + centre[:, 2:] * solution.slope - tags.place_m) * each[:, None]
    rows.by_view[:, 0, 0] = rows.by_view[:, 1, 1] = each
    rows.by_view[:, :, 2] = each[:, None] * solution.slope
    rows.by_shared[:, 0, 2] = rows.by_shared[:, 1, 3] = each * centre[:, 2]
    return rows.add(normal)


def _add_heights(normal: Normal, solution: Solution, tags: Tags) -> float:
    centre = solution.cameras.centre_m
    tagged = np.isfinite(tags.height_m)
    rows = _Rows(len(centre), 1)
    tag, each = np.where(tagged, tags.height_m, 0.0), 1.0 / tags.height_sigma_m
    away = centre[:, :2] - solution.middle_m
    above = centre[:, 2] - np.einsum("ni,i->n", away, solution.slope)
    rows.off[:, 0] = (above - tag * (1.0 + solution.shared[HEIGHT])) * each
    rows.by_view[:, 0, 2] = each
    rows.by_view[:, 0, :2] = -each[:, None] * solution.slope
    rows.by_shared[:, 0, HEIGHT] = -tag * each
    rows.by_shared[:, 0, SLOPE] = -away * each[:, None]
    cost = rows.add(normal, tagged)
    unknown = _Rows(len(centre), 1)
    above_m = solution.cameras.above_m()
    middle = float(np.median(above_m))
    unknown.off[:, 0] = (above_m / middle - 1.0) / _UNKNOWN_HEIGHT
    unknown.by_view[:, 0, 2] = 1.0 / middle / _UNKNOWN_HEIGHT
    return cost + unknown.add(normal, ~tagged)


def _add_yaws(normal: Normal, solution: Solution, tags: Tags) -> float:
    axes = solution.cameras.axes
    tagged = np.isfinite(tags.yaw_rad)
    rows = _Rows(len(axes), 1)
    away = bearing(axes) - np.where(tagged, tags.yaw_rad, 0.0) - solution.shared[YAW]
    each = 1.0 / tags.yaw_sigma_rad
    rows.off[:, 0] = np.arctan2(np.sin(away), np.cos(away)) * each
    east, north = axes[:, 0, 1], axes[:, 1, 1]
    # the picture's down axis turns by (turn x down) in camera axes
    by_turn = -np.einsum("nij,jk->nik", axes, skew(np.array([0.0, 1.0, 0.0])))
    row = north[:, None] * by_turn[:, 0] - east[:, None] * by_turn[:, 1]
    rows.by_view[:, 0, 3:] = row * (each / (east**2 + north**2))[:, None]
    rows.by_shared[:, 0, YAW] = -each
    return rows.add(normal, tagged)


def _add_tilts(normal: Normal, solution: Solution, tags: Tags) -> float:
    axes = solution.cameras.axes
    rows = _Rows(len(axes), 2)
    down = np.einsum("nji,j->ni", axes, np.array([*solution.slope, -1.0]))
    ratio = down[:, :2] / down[:, 2:]
    each = 1.0 / tags.tilt_sigma[:, None]
    rows.off = (ratio - tags.tilt) * each
    scale = each[:, :, None] / down[:, 2, None, None]
    by_turn = skew(down)
    rows.by_view[:, :, 3:] = (by_turn[:, :2] - ratio[:, :, None] * by_turn[:, 2:]) * scale
    by_slope = axes[:, :2].transpose(0, 2, 1)  # of down, by east and by north
    rows.by_shared[:, :, SLOPE] = (by_slope[:, :2] - ratio[:, :, None] * by_slope[:, 2:]) * scale
    return rows.add(normal)


def _add_shared(normal: Normal, solution: Solution, tags: Tags) -> float:
    values = np.concatenate([np.log(solution.cameras.focal_px / tags.focal_px), solution.shared])
    slope = SLOPE_SIGMA if solution.cameras.relief is None else KNOWN_SLOPE_SIGMA
    common = [HEIGHT_BIAS, YAW_BIAS_RAD, slope, slope]
    sigmas = np.concatenate([tags.focal_sigma, common])
    index = np.arange(len(values))
    normal.corner[index, index] += 1.0 / sigmas**2
    normal.right_shared -= values / sigmas**2
    return float(0.5 * np.square(values / sigmas).sum())


HUBER_PX: Final = (40.0, 8.0, 2.5)
"""Residuals from which the force of a tie point is constant, pixels.

The first is wide, because first poses may be far off.
"""

_ROUNDS = 25
_ENOUGH = 1e-5  # a step that gains less than this share ends the search
_LOST_PX = 500.0  # residual of a tie point that misses the other picture's ground altogether
_KEPT = 1e-6  # against singular equations: far below the weight of any tag or tie point
_CHUNK = 40_000  # tie points whose derivatives are in memory at once


def adjust(start: Cameras, ties: Ties, tags: Tags, limits_px: Sequence[float]) -> Solution:
    """Return the poses under which tie points and tags agree best."""
    solution = Solution(start, np.zeros(SHARED), np.median(tags.place_m, axis=0), math.inf)
    for limit_px in limits_px:
        solution = _descend(solution, ties, tags, limit_px)
    return solution


def _descend(solution: Solution, ties: Ties, tags: Tags, limit_px: float) -> Solution:
    best, normal = linearised(solution, ties, tags, limit_px)
    damping = 1e-3
    for _ in range(_ROUNDS):
        steps, shared = normal.damped(damping).solve()
        tried, tried_normal = linearised(_stepped(best, steps, shared), ties, tags, limit_px)
        if tried.cost < best.cost:
            gained = (best.cost - tried.cost) / max(best.cost, 1e-12)
            best, normal = tried, tried_normal
            damping = max(damping / 8.0, 1e-7)
            if gained < _ENOUGH:
                break
        else:
            damping *= 10.0
            if damping > 1e4:
                break
    best.normal = normal
    return best


def _stepped(solution: Solution, steps: Floats, shared: Floats) -> Solution:
    groups = len(shared) - SHARED
    cameras = moved(solution.cameras, steps, shared[:groups])
    # no camera is below the ground
    least_m = 0.2 * solution.cameras.above_m()
    cameras.centre_m[:, 2] += np.maximum(least_m - cameras.above_m(), 0.0)
    return Solution(cameras, solution.shared + shared[groups:], solution.middle_m, math.inf)


def linearised(
    solution: Solution, ties: Ties, tags: Tags, limit_px: float
) -> tuple[Solution, Normal]:
    """Return the solution with its cost, and the normal equations around it."""
    cameras = solution.cameras
    normal = Normal.zeros(len(cameras.centre_m), ties.pairs, len(cameras.focal_px) + SHARED)
    cost = 0.0
    for begin in range(0, len(ties.source), _CHUNK):
        cost += _add_ties(normal, cameras, ties, slice(begin, begin + _CHUNK), limit_px)
    of_tags = (_add_places, _add_heights, _add_yaws, _add_tilts, _add_shared)
    cost += sum(add(normal, solution, tags) for add in of_tags)
    index = np.arange(UNKNOWNS)
    normal.diagonal[:, index, index] += _KEPT  # for a view that all its tie points have lost
    return Solution(cameras, solution.shared, solution.middle_m, cost), normal


def _add_ties(normal: Normal, cameras: Cameras, ties: Ties, part: slice, limit_px: float) -> float:
    s, t, pair = ties.source[part], ties.target[part], ties.pair[part]
    moved_there = transfer(cameras, s, t, ties.in_source[part])
    off = moved_there.pixels - ties.in_target[part]
    size = np.sqrt(np.square(off).sum(axis=1))
    lost = ~np.isfinite(size)
    weight, cost = huber(np.where(lost, _LOST_PX, size), limit_px)
    scale = np.where(lost, 0.0, weight * ties.weight[part])
    r = np.where(lost[:, None], 0.0, off)

    def clean(j: Floats) -> Floats:
        return np.where(lost.reshape(-1, *(1,) * (j.ndim - 1)), 0.0, j)

    js, jt = clean(moved_there.by_source), clean(moved_there.by_target)
    ws, wt = js * scale[:, None, None], jt * scale[:, None, None]
    focal = np.zeros((len(s), 2, normal.corner.shape[0]))
    rows = np.arange(len(s))
    focal[rows, :, cameras.groups[s]] += clean(moved_there.by_source_focal)
    focal[rows, :, cameras.groups[t]] += clean(moved_there.pixels)
    for view, w, j in ((s, ws, js), (t, wt, jt)):
        np.add.at(normal.diagonal, view, np.einsum("nki,nkj->nij", w, j))
        np.add.at(normal.border, view, np.einsum("nki,nkj->nij", w, focal))
        np.add.at(normal.right, view, -np.einsum("nki,nk->ni", w, r))
    across = np.einsum("nki,nkj->nij", ws, jt)
    back = s != ties.pairs[pair, 0]
    across[back] = across[back].transpose(0, 2, 1)
    np.add.at(normal.across, pair, across)
    weighted = focal * scale[:, None, None]
    normal.corner += np.einsum("nki,nkj->ij", weighted, focal)
    normal.right_shared -= np.einsum("nki,nk->i", weighted, r)
    return float((cost * ties.weight[part]).sum())
