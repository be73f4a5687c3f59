"""Ground that is not a plane, as a camera sees it: where the ray of each pixel meets it.

A height field is met by walking along the ray: the height of the ground below its present point
says how far the ray still has to go. That is done for a lattice of pixels; between them the ground
is smooth.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from sitl.camera.pinhole import CameraSpec, Shot, lens_height_m
from sitl.world.orthophoto import Matrix
from sitl.world.relief import Relief

_EVERY_PX: Final = 16
_STEPS: Final = 40
_ENOUGH_M: Final = 0.002
_LEAST, _MOST = 0.05, 8.0  # of the way to the plane through the ground below


def seen_ground(
    camera: CameraSpec, shot: Shot, to_ground: Matrix, relief: Relief
) -> tuple[Matrix, Matrix]:
    """East and north of the ground in every pixel, metres from the camera's foot point.

    `to_ground` takes pixels to the level plane through the ground below the camera.
    """
    columns = camera.width_px // _EVERY_PX + 3
    rows = camera.height_px // _EVERY_PX + 3
    middle = (_EVERY_PX - 1) / 2.0
    u, v = np.meshgrid(
        middle + _EVERY_PX * (np.arange(columns) - 1.0),
        middle + _EVERY_PX * (np.arange(rows) - 1.0),
    )
    plane = np.tensordot(to_ground, np.stack([u, v, np.ones_like(u)]), axes=1)
    east, north = plane[0] / plane[2], plane[1] / plane[2]
    lens_m = lens_height_m(shot)
    way = np.ones_like(east)
    for _ in range(_STEPS):
        rise = relief.heights_m(shot.east_m + way * east, shot.north_m + way * north)
        onward = np.clip(1.0 - (rise - shot.ground_m) / lens_m, _LEAST, _MOST)
        off_m = float(np.abs(onward - way).max()) * lens_m
        way = 0.25 * way + 0.75 * onward  # damped: on steep ground the steps would swing
        if off_m < _ENOUGH_M:
            break
    size = (columns * _EVERY_PX, rows * _EVERY_PX)
    inside = (
        slice(_EVERY_PX, _EVERY_PX + camera.height_px),
        slice(_EVERY_PX, _EVERY_PX + camera.width_px),
    )
    fine = [
        np.asarray(cv2.resize(way * level, size, interpolation=cv2.INTER_LINEAR))[inside]
        for level in (east, north)
    ]
    return fine[0], fine[1]


def pixels_of(
    homography: Matrix, shot: Shot, relief: Relief, east_m: Matrix, north_m: Matrix
) -> Matrix:
    """Pixels, (n, 2), of ground points given in metres from the camera's foot point."""
    lens_m = lens_height_m(shot)
    rise = relief.heights_m(shot.east_m + east_m, shot.north_m + north_m) - shot.ground_m
    points = homography @ np.stack([east_m, north_m, (lens_m - rise) / lens_m])
    return np.asarray((points[:2] / np.maximum(points[2], 1e-3)).T, dtype=np.float64)
