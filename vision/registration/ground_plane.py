"""From pixels to the ground and back, for many points at once, with derivatives.

The ground is flat, or the `Relief` of the cameras. A camera is a position (east, north, up), three
axes, and a focal length. A small turn is a vector in camera axes (right, down, forward), positive
by the right-hand rule.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from missions.geo.terrain import Terrain
from missions.units import GridPoint
from vision.registration.views import Floats, Ints

_REACH_M: Final = 500.0
_ROUNDS: Final = 8  # of the search along a ray: each multiplies the error by slope * obliqueness


@dataclass(frozen=True, slots=True)
class Relief:
    """Heights of the ground above the level of the cameras' heights.

    Attributes:
        terrain: The heights, in metres of a grid.
        matrix: 2 x 2, from metres (true east, true north) to those of the grid.
        offset_m: The middle of the registration in the grid.
        level_m: The terrain's height at which cameras' heights are 0: at the start.
    """

    terrain: Terrain
    matrix: Floats
    offset_m: Floats
    level_m: float

    @classmethod
    def from_terrain(
        cls, terrain: Terrain, level_m: float, to_grid: Callable[[float, float], GridPoint]
    ) -> Self:
        """Return the relief of a terrain; `to_grid` converts metres of the registration.

        Within kilometres that map is linear, to millimetres.
        """
        middle = np.array(to_grid(0.0, 0.0))
        east = (np.array(to_grid(_REACH_M, 0.0)) - np.array(to_grid(-_REACH_M, 0.0))) / 2.0
        north = (np.array(to_grid(0.0, _REACH_M)) - np.array(to_grid(0.0, -_REACH_M))) / 2.0
        return cls(terrain, np.stack([east, north], axis=1) / _REACH_M, middle, level_m)

    def at(self, places: Floats) -> Floats:
        """Return the height at places (n, 2), metres (east, north); any value for NaN."""
        east, north = (np.nan_to_num(places) @ self.matrix.T + self.offset_m).T
        heights: Floats = self.terrain.at(east, north) - self.level_m
        return heights

    def rise(self, places: Floats) -> Floats:
        """Return the ground's slopes at places towards east and north, (n, 2), tangents."""
        step_m = self.terrain.step_m / 2.0
        both = []
        for axis in (0, 1):
            away = np.zeros(2)
            away[axis] = step_m
            both.append((self.at(places + away) - self.at(places - away)) / (2.0 * step_m))
        return np.stack(both, axis=1)

    def height_along(self, centre_m: Floats, along: Floats) -> Floats:
        """Return the ground's height at which rays from `centre_m` (n, 3) meet it.

        `along` (n, 2) is each ray's distance over the ground for a metre down.
        """
        height = self.at(centre_m[:, :2])
        for _ in range(_ROUNDS):
            place = centre_m[:, :2] + (centre_m[:, 2] - height)[:, None] * along
            height = self.at(place)
        return height


UNKNOWNS = 6
"""Unknowns of a view: east, north, up in metres; a turn about right, down, forward in radians."""

_MIN_DOWN = 0.2  # of a ray's unit length; rays nearer to the horizon are no evidence


@dataclass
class Cameras:
    """Many cameras with focal lengths by group; without `relief` the ground is flat, at 0."""

    centre_m: Floats
    axes: Floats
    focal_px: Floats
    groups: Ints
    relief: Relief | None = None

    def above_m(self) -> Floats:
        """Return the height of each camera above the ground below it."""
        high: Floats = self.centre_m[:, 2]
        return high if self.relief is None else high - self.relief.at(self.centre_m[:, :2])

    def focal(self, views: Ints) -> Floats:
        """Return the focal length of each of `views`."""
        lengths: Floats = self.focal_px[self.groups[views]]
        return lengths


def level_axes(yaw_rad: Floats) -> Floats:
    """Return the axes (n, 3, 3) of cameras that look straight down, upper edge to `yaw_rad`.

    >>> (level_axes(np.array([0.0]))[0].round(9) + 0.0).tolist()
    [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]
    """
    sin, cos, zero = np.sin(yaw_rad), np.cos(yaw_rad), np.zeros_like(yaw_rad)
    return np.stack(
        [
            np.stack([cos, -sin, zero], axis=-1),
            np.stack([-sin, -cos, zero], axis=-1),
            np.stack([zero, zero, zero - 1.0], axis=-1),
        ],
        axis=-1,
    )


def tilted_axes(yaw_rad: float, tilt: tuple[float, float]) -> Floats:
    """Return axes whose ray (right, down) over forward = `tilt` points straight down.

    >>> tilted = tilted_axes(1.0, (0.1, -0.2))
    >>> down = tilted.T @ np.array([0.0, 0.0, -1.0])
    >>> (down[:2] / down[2]).round(9).tolist()
    [0.1, -0.2]
    """
    ray = np.array([tilt[0], tilt[1], 1.0])
    ray /= np.linalg.norm(ray)
    # the smallest turn that takes the ray to the forward axis, then the level camera
    axis = np.cross(ray, [0.0, 0.0, 1.0])
    size = np.linalg.norm(axis)
    angle = math.atan2(size, ray[2])
    turn = turned(axis / size * angle if size > 1e-12 else np.zeros(3))
    level = level_axes(np.array([yaw_rad]))[0] @ turn
    off = yaw_rad - bearing(level[None])[0]
    cos, sin = math.cos(off), math.sin(off)
    about_up = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    matrix: Floats = about_up @ level
    return matrix


def bearing(axes: Floats) -> Floats:
    """Return true bearings of the upper edges, radians."""
    angles: Floats = np.arctan2(-axes[:, 0, 1], -axes[:, 1, 1])
    return angles


def turned(turns: Floats) -> Floats:
    """Return rotation matrices (..., 3, 3) of turns (..., 3), by Rodrigues' formula."""
    angle = np.linalg.norm(turns, axis=-1)[..., None, None]
    cross = skew(turns)
    small = angle < 1e-8
    safe = np.where(small, 1.0, angle)
    one = np.where(small, 1.0, np.sin(safe) / safe)
    two = np.where(small, 0.5, (1.0 - np.cos(safe)) / safe**2)
    matrices: Floats = np.eye(3) + one * cross + two * np.einsum("...ij,...jk->...ik", cross, cross)
    return matrices


def skew(v: Floats) -> Floats:
    """Return the matrices (..., 3, 3) of the cross product with `v`."""
    zero = np.zeros(v.shape[:-1])
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    return np.stack(
        [
            np.stack([zero, -z, y], axis=-1),
            np.stack([z, zero, -x], axis=-1),
            np.stack([-y, x, zero], axis=-1),
        ],
        axis=-2,
    )


def to_ground(cameras: Cameras, views: Ints, pixels: Floats) -> Floats:
    """Return the points where rays meet the ground, metres (east, north); NaN if there are none."""
    rays = _rays(cameras, views, pixels)[1]
    return _ground_points(cameras, cameras.centre_m[views], rays)[0]


def _rays(cameras: Cameras, views: Ints, pixels: Floats) -> tuple[Floats, Floats]:
    inner = np.concatenate(
        [pixels / cameras.focal(views)[:, None], np.ones((len(pixels), 1))], axis=1
    )
    return inner, np.einsum("nij,nj->ni", cameras.axes[views], inner)


def _ground_points(cameras: Cameras, centre: Floats, rays: Floats) -> tuple[Floats, Floats]:
    """Return the points where rays meet the ground, (n, 2), and their depths below the camera."""
    down = np.where(-rays[:, 2] > _MIN_DOWN, -rays[:, 2], np.nan)
    along = rays[:, :2] / down[:, None]
    below = centre[:, 2]
    if cameras.relief is not None:
        below = below - cameras.relief.height_along(centre, along)
    place: Floats = centre[:, :2] + below[:, None] * along
    return place, below


def to_pixels(cameras: Cameras, views: Ints, ground: Floats) -> Floats:
    """Return pixels from the middle of the picture, of ground points; NaN behind the camera."""
    centre = cameras.centre_m[views]
    offset = _offset(cameras, ground, centre)
    p = np.einsum("nji,nj->ni", cameras.axes[views], offset)
    depth = np.where(p[:, 2] > 0.0, p[:, 2], np.nan)
    pixels: Floats = cameras.focal(views)[:, None] * p[:, :2] / depth[:, None]
    return pixels


def _offset(cameras: Cameras, ground: Floats, centre: Floats) -> Floats:
    up = -centre[:, 2]
    if cameras.relief is not None:
        up = up + cameras.relief.at(ground)
    return np.column_stack([ground - centre[:, :2], up])


@dataclass
class Transfer:
    """Pixels of one view in another, through the ground, with derivatives.

    `by_source` and `by_target` are (n, 2, 6), pixels per unknown of the view (`UNKNOWNS`).
    `by_source_focal` (n, 2) is per unit of the logarithm of its focal length; for that of the
    target the derivative is `pixels`.
    """

    pixels: Floats
    by_source: Floats
    by_target: Floats
    by_source_focal: Floats


def transfer(cameras: Cameras, source: Ints, target: Ints, pixels: Floats) -> Transfer:
    """Project pixels of `source` views onto the ground, and into the `target` views."""
    inner, rays = _rays(cameras, source, pixels)
    down = np.where(-rays[:, 2] > _MIN_DOWN, -rays[:, 2], np.nan)
    place, height = _ground_points(cameras, cameras.centre_m[source], rays)
    # the ground point by a change of the ray: (n, 2, 3)
    count = len(pixels)
    by_ray = np.zeros((count, 2, 3))
    by_ray[:, 0, 0] = by_ray[:, 1, 1] = height / down
    by_ray[:, :, 2] = (height / down**2)[:, None] * rays[:, :2]
    by_turn = -np.einsum("nij,njk->nik", cameras.axes[source], skew(inner))
    by_log_focal = -np.einsum("nij,nj->ni", cameras.axes[source, :, :2], inner[:, :2])
    ground = np.zeros((count, 2, UNKNOWNS))
    ground[:, 0, 0] = ground[:, 1, 1] = 1.0
    ground[:, :, 2] = rays[:, :2] / down[:, None]
    ground[:, :, 3:] = np.einsum("nij,njk->nik", by_ray, by_turn)
    ground_focal = np.einsum("nij,nj->ni", by_ray, by_log_focal)
    rise = None if cameras.relief is None else cameras.relief.rise(place)
    if rise is not None:  # on rising ground, a longer ray meets it sooner
        along = rays[:, :2] / down[:, None]
        sooner = np.linalg.inv(np.eye(2) + np.einsum("ni,nj->nij", _known(along), rise))
        ground = np.einsum("nij,njk->nik", sooner, ground)
        ground_focal = np.einsum("nij,nj->ni", sooner, ground_focal)

    centre, axes = cameras.centre_m[target], cameras.axes[target]
    p = np.einsum("nji,nj->ni", axes, _offset(cameras, place, centre))
    depth = np.where(p[:, 2] > 0.0, p[:, 2], np.nan)
    focal = cameras.focal(target)
    found = focal[:, None] * p[:, :2] / depth[:, None]
    by_p = np.zeros((count, 2, 3))
    by_p[:, 0, 0] = by_p[:, 1, 1] = focal / depth
    by_p[:, :, 2] = -found / depth[:, None]
    by_offset = np.einsum("nij,nkj->nik", by_p, axes)  # by_p @ axes.T
    by_place = by_offset[:, :, :2]
    if rise is not None:
        by_place = by_place + by_offset[:, :, 2:] * rise[:, None, :]
    by_target = np.empty((count, 2, UNKNOWNS))
    by_target[:, :, :3] = -by_offset
    by_target[:, :, 3:] = np.einsum("nij,njk->nik", by_p, skew(p))
    return Transfer(
        found,
        np.einsum("nij,njk->nik", by_place, ground),
        by_target,
        np.einsum("nij,nj->ni", by_place, ground_focal),
    )


def _known(values: Floats) -> Floats:
    """Return zero for unknown values: results that depend on them are unknown anyway."""
    return np.where(np.isfinite(values), values, 0.0)


def moved(cameras: Cameras, steps: Floats, log_focal: Floats) -> Cameras:
    """Return the cameras after a step (n, 6) of the unknowns and one (groups,) of focal lengths."""
    return Cameras(
        cameras.centre_m + steps[:, :3],
        np.einsum("nij,njk->nik", cameras.axes, turned(steps[:, 3:])),
        cameras.focal_px * np.exp(log_focal),
        cameras.groups,
        cameras.relief,
    )
