"""Pictures of painted cells, rendered without the code under test.

Corners go over WGS84 into a plane of true north and east, which knows nothing of UTM, and from
there along the camera's axes to pixels.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import cv2
import numpy as np

from missions.geo.geodesy import LocalPlane
from missions.geo.grid import Grid
from missions.units import Cell, GridPoint, Pose, Quaternion
from vision.camera import Camera
from vision.projection import Frame
from vision.upright import UprightSearch

DARK, BRIGHT = 60, 220
_FRACTION_BITS = 6


def camera_axes(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Forward, right and down of the camera in NED, from turns about one axis at a time."""
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
    """A pose over a point of the fixed frame, and its axes (forward, right, down) in NED."""
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
    """A bright picture with dark areas; their corners are in the moving frame."""
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
    """The outline of a cell, from its centre and size alone."""
    e, n, h = cell.east * grid.cell_m, cell.north * grid.cell_m, grid.cell_m / 2
    return [GridPoint(e + a * h, n + b * h) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]


def photograph(
    texture: np.ndarray, pitch_m: float, grid: Grid, camera: Camera, pose: Pose, axes: np.ndarray
) -> np.ndarray:
    """A picture of a gray texture that lies on the ground, its middle at the grid's origin.

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
    """For each frame, whether the others find it stored upside down."""
    search = UprightSearch(grid, UprightSearch.pitch_for([f.pose.height_m for f in frames]))
    for frame in frames:
        search.add(search.patch(frame))
    return search.turned()
