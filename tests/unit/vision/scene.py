"""Pictures of painted cells and of a meadow, rendered without the code under test; views of them.

Corners go over WGS84 into a plane of true north and east, without UTM, and from
there along the camera's axes to pixels. Views have wrong tags.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np

from missions.geo.geodesy import LocalPlane
from missions.geo.grid import Grid
from missions.units import Cell, GridPoint, LatLon, Pose, Quaternion
from sitl.world.ground import METRES_PER_PIXEL, TILE_PX, ground_tile
from vision.camera import Camera
from vision.projection import Frame
from vision.registration.ground_plane import Relief, bearing
from vision.registration.matching import extract
from vision.registration.views import Features, Measured, View
from vision.upright import UprightSearch

DARK, BRIGHT = 60, 220
_FRACTION_BITS = 6


def camera_axes(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Return forward, right and down of the camera in NED, from turns about one axis each."""
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll, pitch, yaw) for f in (math.cos, math.sin))
    about_down = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    about_right = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_forward = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return (about_down @ about_right @ about_forward).T


def nadir_pose(
    grid: Grid,
    over: GridPoint,
    height_m: float,
    yaw_deg: float,
    tilt_deg: tuple[float, float] = (0.0, 0.0),
) -> tuple[Pose, np.ndarray]:
    """Return a pose over a point of the fixed frame, and its axes (forward, right, down) in NED."""
    roll, pitch = math.radians(tilt_deg[0]), math.radians(-90.0 + tilt_deg[1])
    yaw = math.radians(yaw_deg)
    pose = Pose(grid.position(over), height_m, Quaternion.from_euler(roll, pitch, yaw))
    return pose, camera_axes(roll, pitch, yaw)


def paint(
    areas: Iterable[list[GridPoint]],
    grid: Grid,
    camera: Camera,
    pose: Pose,
    axes: np.ndarray,
    t_s: float = 0.0,
) -> np.ndarray:
    """Return a bright picture with dark areas; their corners are in the moving frame."""
    plane = LocalPlane(pose.position)
    focal = camera.width_px / 2 / math.tan(camera.hfov_rad / 2)
    image = np.full((camera.height_px, camera.width_px, 3), BRIGHT, np.uint8)
    for area in areas:
        outline = []
        for corner in area:
            east_m, north_m = plane.to_plane(grid.position(grid.to_fixed(corner, t_s)))
            depth, right, down = axes @ np.array([north_m, east_m, pose.height_m])
            u = (camera.width_px - 1) / 2 + focal * right / depth
            v = (camera.height_px - 1) / 2 + focal * down / depth
            outline.append((u, v))
        fixed_point = np.round(np.array(outline) * 2**_FRACTION_BITS).astype(np.int32)
        cv2.fillPoly(image, [fixed_point], (DARK, DARK, DARK), shift=_FRACTION_BITS)
    return image


def decoded(jpeg: bytes) -> np.ndarray:
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return image.astype(np.uint8)


def square(grid: Grid, cell: Cell) -> list[GridPoint]:
    """Return the outline of a cell, from its centre and size alone."""
    e, n, h = cell.east * grid.cell_m, cell.north * grid.cell_m, grid.cell_m / 2
    return [GridPoint(e + a * h, n + b * h) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]


def photograph(
    texture: np.ndarray, pitch_m: float, grid: Grid, camera: Camera, pose: Pose, axes: np.ndarray
) -> np.ndarray:
    """Return a picture of a gray texture on the ground, its middle at the grid's origin.

    `texture` has rows towards true north and columns towards true east, `pitch_m` apart.
    """
    focal = camera.width_px / 2 / math.tan(camera.hfov_rad / 2)
    v, u = np.mgrid[: camera.height_px, : camera.width_px]
    rays = np.stack(
        [
            np.ones(u.shape),
            (u - (camera.width_px - 1) / 2) / focal,
            (v - (camera.height_px - 1) / 2) / focal,
        ],
        axis=-1,
    )
    north, east, down = np.moveaxis(rays @ axes, -1, 0)
    east_m, north_m = LocalPlane(grid.position(GridPoint(0.0, 0.0))).to_plane(pose.position)
    rows = (north_m + pose.height_m * north / down) / pitch_m + texture.shape[0] / 2
    columns = (east_m + pose.height_m * east / down) / pitch_m + texture.shape[1] / 2
    gray = texture[np.round(rows).astype(int), np.round(columns).astype(int)]
    return np.repeat(gray[..., None], 3, axis=2)


def upside_down(frames: Sequence[Frame], grid: Grid) -> tuple[bool, ...]:
    """Return for each frame whether the others show that it is stored upside down."""
    search = UprightSearch(grid, UprightSearch.pitch_for([f.pose.height_m for f in frames]))
    for frame in frames:
        search.add(search.patch(frame))
    return search.turned()


GRID = Grid.at(LatLon(46.84, -91.99), 4.0)
CAMERA = Camera(math.radians(75.0), 320, 240)
HEIGHT_M = 11.0


@lru_cache
def meadow(seed: int) -> np.ndarray:
    """Return a tile of the simulator's ground, 51 m wide, that nowhere repeats."""
    return ground_tile(np.random.default_rng(seed), 120.0, 30.0)[:TILE_PX, :TILE_PX]


@dataclass(frozen=True)
class Shot:
    """True place of a picture, metres true east and north of the grid's origin.

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
        """Return columns right, down, forward of the picture as stored, in (east, north, up)."""
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
    """Return shots there and back, with a camera not quite level and varying heights."""
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
    """Return a view with a geotag 0.6 m off (standard deviation per axis), and no other tag."""
    focal_px = CAMERA.focal_px * features.width_px / CAMERA.width_px
    east_m, north_m = shot.east_m + rng.normal(0.0, 0.6), shot.north_m + rng.normal(0.0, 0.6)
    return View(name, features, Measured(focal_px, 0.03 * focal_px), "one", east_m, north_m, 3.0)


def tagged(bare: View, shot: Shot, *, height: float = 1.0) -> View:
    """Return such a view with heading, height and tilt, as wrong as given."""
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
    """Return views of points strewn on the ground, each with a descriptor: without pictures.

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
    """Return points of the ground around the shots, some 1.2 a square metre, and descriptors."""
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
