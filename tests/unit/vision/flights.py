"""Pictures of a rendered meadow from poses that are known exactly, and views with wrong tags."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from missions.geo.grid import Grid
from missions.units import GridPoint, LatLon
from sitl.world.ground import METRES_PER_PIXEL, TILE_PX, ground_tile
from tests.unit.vision.scene import camera_axes, nadir_pose, photograph
from vision.camera import Camera
from vision.registration.ground_plane import Relief, bearing
from vision.registration.matching import extract
from vision.registration.views import Features, Measured, View

GRID = Grid.at(LatLon(46.84, -91.99), 4.0)
CAMERA = Camera(math.radians(75.0), 320, 240)
HEIGHT_M = 11.0


def meadow(seed: int) -> np.ndarray:
    """A tile of the simulator's ground, 51 m wide, that nowhere repeats."""
    return ground_tile(np.random.default_rng(seed), 120.0, 30.0)[:TILE_PX, :TILE_PX]


@dataclass(frozen=True)
class Shot:
    """Where a picture was truly taken, metres true east and north of the grid's origin.

    `tilt_deg`: as in `nadir_pose`; the second leans the camera towards its bearing, the first then
    turns it about its axis.
    """

    east_m: float
    north_m: float
    height_m: float = HEIGHT_M
    yaw_deg: float = 0.0
    tilt_deg: tuple[float, float] = (0.0, 0.0)
    exposure: float = 1.0
    upside_down: bool = False

    def axes(self) -> np.ndarray:
        """Columns right, down, forward of the picture as stored, in (east, north, up)."""
        roll, pitch = math.radians(self.tilt_deg[0]), math.radians(-90.0 + self.tilt_deg[1])
        forward, right, down = camera_axes(roll, pitch, math.radians(self.yaw_deg))
        if self.upside_down:
            right, down = -right, -down
        return np.array([[v[1], v[0], -v[2]] for v in (right, down, forward)]).T

    def picture(self, texture: np.ndarray, seed: int) -> np.ndarray:
        turn = GRID.convergence_rad
        over = GridPoint(
            self.east_m * math.cos(turn) - self.north_m * math.sin(turn),
            self.east_m * math.sin(turn) + self.north_m * math.cos(turn),
        )
        pose, axes = nadir_pose(GRID, over, self.height_m, self.yaw_deg, self.tilt_deg)
        gray = photograph(texture, METRES_PER_PIXEL, GRID, CAMERA, pose, axes)[..., 0]
        noise = np.random.default_rng(seed).normal(0.0, 2.0, gray.shape)
        image = np.clip(gray * self.exposure + noise, 0, 255).astype(np.uint8)
        return np.ascontiguousarray(image[::-1, ::-1]) if self.upside_down else image


def passes(columns: int, rows: int, step_m: float, seed: int) -> list[Shot]:
    """There and back, the camera never quite level, the height never quite kept."""
    rng = np.random.default_rng(seed)
    shots = []
    for column in range(columns):
        for k in range(rows):
            row = k if column % 2 == 0 else rows - 1 - k
            shots.append(
                Shot(
                    (column - (columns - 1) / 2) * step_m * 1.2 + rng.normal(0.0, 0.3),
                    (row - (rows - 1) / 2) * step_m + rng.normal(0.0, 0.3),
                    HEIGHT_M + rng.normal(0.0, 0.4),
                    30.0 + 180.0 * (column % 2) + rng.normal(0.0, 4.0),
                    (rng.normal(0.0, 1.5), rng.normal(0.0, 1.5)),
                    float(2.0 ** rng.uniform(-1.0, 1.0)),
                )
            )
    return shots


def view(name: str, shot: Shot, features: Features, rng: np.random.Generator) -> View:
    """With a geotag 0.6 m off (standard deviation in one direction), and no other tag."""
    focal_px = CAMERA.focal_px * features.width_px / CAMERA.width_px
    east_m, north_m = shot.east_m + rng.normal(0.0, 0.6), shot.north_m + rng.normal(0.0, 0.6)
    return View(name, features, Measured(focal_px, 0.03 * focal_px), "one", east_m, north_m, 3.0)


def tagged(bare: View, shot: Shot, *, height: float = 1.0) -> View:
    """The same with heading, height and tilt, as wrong as told."""
    down = shot.axes().T @ np.array([0.0, 0.0, -1.0])
    upper = bearing(shot.axes()[None])[0]
    if shot.upside_down:  # the tags are those of the picture as it was taken
        down[:2] = -down[:2]
        upper += math.pi
    return replace(
        bare,
        yaw_rad=Measured(upper, math.radians(5.0)),
        height_m=Measured(shot.height_m * height, 0.05 * shot.height_m),
        tilt=(down[0] / down[2], down[1] / down[2]),
        tilt_sigma=0.03,
    )


def features_of(shots: list[Shot], texture: np.ndarray) -> list[Features]:
    return [extract(s.picture(texture, seed)) for seed, s in enumerate(shots)]


def made_up(
    shots: list[Shot],
    seed: int,
    again: tuple[tuple[float, float], tuple[float, float], float] | None = None,
    relief: Relief | None = None,
) -> list[View]:
    """Views of points strewn on the ground, each with a word of its own: no picture is rendered.

    `again` = (from, to, half width): a square of ground whose points come a second time.
    """
    rng = np.random.default_rng(seed)
    ground, words = _strewn(shots, rng, again)
    level = np.zeros(len(ground)) if relief is None else relief.at(ground)
    views = []
    for k, shot in enumerate(shots):
        offset = np.column_stack([ground - (shot.east_m, shot.north_m), level - shot.height_m])
        p = offset @ shot.axes()
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = CAMERA.focal_px * p[:, :2] / p[:, 2:]
        shown = (p[:, 2] > 0) & (np.abs(pixels) < (CAMERA.width_px / 2, CAMERA.height_px / 2)).all(
            1
        )
        shown &= rng.random(len(shown)) < 0.7
        count = int(shown.sum())
        noise = rng.normal(0.0, 4.0, (count, 128))
        descriptors = np.clip(words[shown] + noise, 0, 255).astype(np.uint8)
        points = pixels[shown] + rng.normal(0.0, 0.4, (count, 2))
        found = Features(points, descriptors, CAMERA.width_px, CAMERA.height_px)
        views.append(view(f"{k:03}", shot, found, rng))
    return views


def _strewn(
    shots: list[Shot],
    rng: np.random.Generator,
    again: tuple[tuple[float, float], tuple[float, float], float] | None,
) -> tuple[np.ndarray, np.ndarray]:
    """Points of the ground, some 1.2 a square metre around the shots, and their words."""
    places = {(round(s.east_m / 10.0), round(s.north_m / 10.0)) for s in shots}
    tiles = sorted(
        {(e + i, n + j) for e, n in places for i in (-2, -1, 0, 1, 2) for j in (-2, -1, 0, 1, 2)}
    )
    middles = 10.0 * np.repeat(np.array(tiles), 120, axis=0)
    ground = middles + rng.uniform(-5.0, 5.0, middles.shape)
    words = rng.gamma(0.6, 1.0, (len(ground), 128))
    words = 512.0 * np.sqrt(words / words.sum(axis=1, keepdims=True))
    if again is not None:
        here, there, half = again
        copied = (np.abs(ground - here) < half).all(axis=1)
        kept = ~(np.abs(ground - there) < half).all(axis=1)
        ground = np.vstack([ground[kept], ground[copied] - here + there])
        words = np.vstack([words[kept], words[copied]])
    return ground, words
