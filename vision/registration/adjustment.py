"""Bundle adjustment of views over known ground: all poses at once, by Levenberg-Marquardt.

What is made small: tie points of one picture, taken through the ground into the other, against
where they are there (pixels), beside what the tags say. Ground points are no unknowns, so the
normal equations have 6 unknowns a view, and a block for each pair that overlaps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from vision.registration.ground_plane import UNKNOWNS, Cameras, moved, transfer
from vision.registration.normal_equations import Normal
from vision.registration.problem import SHARED, Solution, Tags, Ties, huber
from vision.registration.tag_terms import add_tags
from vision.registration.views import Floats

HUBER_PX: Final = (40.0, 8.0, 2.5)
"""Beyond this a tie point pulls no stronger: wide at first, where poses may be far off."""

_ROUNDS = 25
_ENOUGH = 1e-5  # a step that gains less than this share ends the search
_LOST_PX = 500.0  # of a tie point that misses the other picture's ground altogether
_KEPT = 1e-6  # against singular equations: far below what any tag or tie point says
_CHUNK = 40_000  # tie points whose derivatives are in memory at once


def adjust(
    start: Cameras, ties: Ties, tags: Tags, limits_px: Sequence[float] = HUBER_PX
) -> Solution:
    """The poses under which tie points and tags agree best."""
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
    # nobody takes a picture from below the ground
    least_m = 0.2 * solution.cameras.above_m()
    cameras.centre_m[:, 2] += np.maximum(least_m - cameras.above_m(), 0.0)
    return Solution(cameras, solution.shared + shared[groups:], solution.middle_m, math.inf)


def linearised(
    solution: Solution, ties: Ties, tags: Tags, limit_px: float
) -> tuple[Solution, Normal]:
    """The solution with its cost, and the normal equations around it."""
    cameras = solution.cameras
    normal = Normal.zeros(len(cameras.centre_m), ties.pairs, len(cameras.focal_px) + SHARED)
    cost = 0.0
    for begin in range(0, len(ties.source), _CHUNK):
        cost += _add_ties(normal, cameras, ties, slice(begin, begin + _CHUNK), limit_px)
    cost += add_tags(normal, solution, tags)
    index = np.arange(UNKNOWNS)
    normal.diagonal[:, index, index] += _KEPT  # of a view that all its tie points have lost
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
    focal[rows, :, cameras.groups[t]] += clean(moved_there.by_target_focal)
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
