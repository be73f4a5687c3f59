"""What tags add to the normal equations: places, heights, headings, tilts, what all share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vision.registration.ground_plane import UNKNOWNS, bearing, skew
from vision.registration.net import HEIGHT_BIAS, YAW_BIAS_RAD
from vision.registration.normal_equations import Normal
from vision.registration.problem import HEIGHT, SHARED, SLOPE, YAW, Solution, Tags, huber
from vision.registration.views import Floats

SLOPE_SIGMA: Final = 0.05
"""Standard deviation of the slope of the ground, in one direction, a tangent."""

KNOWN_SLOPE_SIGMA: Final = 1e-4
"""The same where an elevation model tells how the ground falls."""

_PRIOR_HUBER = 2.0  # standard deviations of a tag, beyond which it pulls no stronger
_UNKNOWN_HEIGHT = 0.5  # a height that no tag tells is that of the others, within this share


def add_tags(normal: Normal, solution: Solution, tags: Tags) -> float:
    """Add all that tags say; returns the cost."""
    terms = (_add_places, _add_heights, _add_yaws, _add_tilts, _add_shared)
    return sum(term(normal, solution, tags) for term in terms)


@dataclass
class _Rows:
    """Residuals of tags, `count` a view, in standard deviations, with their derivatives."""

    off: Floats  # (views, count)
    by_view: Floats  # (views, count, 6)
    by_shared: Floats  # (views, count, SHARED)

    def add(self, normal: Normal, told: NDArray[np.bool_] | None = None) -> float:
        """Into the normal equations, by Huber's weights; returns the cost."""
        weight, cost = huber(np.sqrt(np.square(self.off).sum(axis=1)), _PRIOR_HUBER)
        if told is not None:
            weight, cost = np.where(told, weight, 0.0), np.where(told, cost, 0.0)
        groups = normal.corner.shape[0] - SHARED
        view, shared = self.by_view * weight[:, None, None], self.by_shared * weight[:, None, None]
        normal.diagonal += np.einsum("nki,nkj->nij", view, self.by_view)
        normal.border[:, :, groups:] += np.einsum("nki,nkj->nij", view, self.by_shared)
        normal.corner[groups:, groups:] += np.einsum("nki,nkj->ij", shared, self.by_shared)
        normal.right -= np.einsum("nki,nk->ni", view, self.off)
        normal.right_shared[groups:] -= np.einsum("nki,nk->i", shared, self.off)
        return float(cost.sum())


def _rows(views: int, count: int) -> _Rows:
    return _Rows(
        np.zeros((views, count)),
        np.zeros((views, count, UNKNOWNS)),
        np.zeros((views, count, SHARED)),
    )


def _add_places(normal: Normal, solution: Solution, tags: Tags) -> float:
    centre = solution.cameras.centre_m
    rows = _rows(len(centre), 2)
    each = 1.0 / tags.place_sigma_m
    rows.off = (centre[:, :2] + centre[:, 2:] * solution.slope - tags.place_m) * each[:, None]
    rows.by_view[:, 0, 0] = rows.by_view[:, 1, 1] = each
    rows.by_view[:, :, 2] = each[:, None] * solution.slope
    rows.by_shared[:, 0, 2] = rows.by_shared[:, 1, 3] = each * centre[:, 2]
    return rows.add(normal)


def _add_heights(normal: Normal, solution: Solution, tags: Tags) -> float:
    centre = solution.cameras.centre_m
    told = np.isfinite(tags.height_m)
    rows = _rows(len(centre), 1)
    tag, each = np.where(told, tags.height_m, 0.0), 1.0 / tags.height_sigma_m
    away = centre[:, :2] - solution.middle_m
    above = centre[:, 2] - np.einsum("ni,i->n", away, solution.slope)
    rows.off[:, 0] = (above - tag * (1.0 + solution.shared[HEIGHT])) * each
    rows.by_view[:, 0, 2] = each
    rows.by_view[:, 0, :2] = -each[:, None] * solution.slope
    rows.by_shared[:, 0, HEIGHT] = -tag * each
    rows.by_shared[:, 0, SLOPE] = -away * each[:, None]
    cost = rows.add(normal, told)
    unknown = _rows(len(centre), 1)
    above_m = solution.cameras.above_m()
    middle = float(np.median(above_m))
    unknown.off[:, 0] = (above_m / middle - 1.0) / _UNKNOWN_HEIGHT
    unknown.by_view[:, 0, 2] = 1.0 / middle / _UNKNOWN_HEIGHT
    return cost + unknown.add(normal, ~told)


def _add_yaws(normal: Normal, solution: Solution, tags: Tags) -> float:
    axes = solution.cameras.axes
    told = np.isfinite(tags.yaw_rad)
    rows = _rows(len(axes), 1)
    away = bearing(axes) - np.where(told, tags.yaw_rad, 0.0) - solution.shared[YAW]
    each = 1.0 / tags.yaw_sigma_rad
    rows.off[:, 0] = np.arctan2(np.sin(away), np.cos(away)) * each
    east, north = axes[:, 0, 1], axes[:, 1, 1]
    # the picture's down axis turns by (turn x down) in camera axes
    by_turn = -np.einsum("nij,jk->nik", axes, skew(np.array([0.0, 1.0, 0.0])))
    row = north[:, None] * by_turn[:, 0] - east[:, None] * by_turn[:, 1]
    rows.by_view[:, 0, 3:] = row * (each / (east**2 + north**2))[:, None]
    rows.by_shared[:, 0, YAW] = -each
    return rows.add(normal, told)


def _add_tilts(normal: Normal, solution: Solution, tags: Tags) -> float:
    axes = solution.cameras.axes
    rows = _rows(len(axes), 2)
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
