"""The pinhole camera: from metres on the ground to pixels.

Pixel (0, 0) is the *centre* of the top left pixel, as in OpenCV: a picture reaches from -0.5 to
`width_px - 0.5`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.geo.footprint import Optics
from missions.geo.grid import Grid
from missions.units import Pose, Quaternion

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Camera(Optics):
    """A pinhole camera with square pixels, at any pose."""

    def homography(self, pose: Pose, grid: Grid, t_s: float) -> Floats:
        """Return the 3 x 3 matrix from the grid's moving frame to pixels.

        `H @ (east_m, north_m, 1)` is `(u w, v w, w)`; `w` is metres along the optical axis. Points
        with `w <= 0` lie behind the camera and are not in the picture. The ground is a plane
        `pose.height_m` below the camera. The attitude is to true north: the grid's meridian
        convergence lies between.
        """
        place = grid.to_moving(grid.fixed(pose.position), t_s)
        cos, sin = math.cos(grid.convergence_rad), math.sin(grid.convergence_rad)
        ned_of_ground = np.array(
            [
                [-sin, cos, sin * place.east_m - cos * place.north_m],
                [cos, sin, -cos * place.east_m - sin * place.north_m],
                [0.0, 0.0, pose.height_m],
            ]
        )
        matrix: Floats = self.pixels_of_ned(pose) @ ned_of_ground
        return matrix

    def pixels_of_ned(self, pose: Pose) -> Floats:
        """Return the 3 x 3 matrix from metres north, east and down of the camera to pixels."""
        focal = self.focal_px
        pixels_of_camera = np.array(
            [
                [(self.width_px - 1) / 2.0, focal, 0.0],
                [(self.height_px - 1) / 2.0, 0.0, focal],
                [1.0, 0.0, 0.0],
            ]
        )
        matrix: Floats = pixels_of_camera @ rotation(pose.attitude).T
        return matrix


def edges(camera: Optics, matrix: Floats) -> tuple[Floats, Floats]:
    """Return the picture's rim on the ground as four half-planes.

    A ground point `p` is `normals @ p + offsets` metres inside the left, right, upper and lower
    edge. An edge at infinity (the horizon) has the offset +-inf.

    Args:
        matrix: 3 x 3, from `Camera.homography`.

    Returns:
        `normals`, shape (4, 2), of length 1 or 0, and `offsets`, shape (4,), metres.
    """
    right, low = camera.width_px - 0.5, camera.height_px - 0.5
    inward = np.array([[1.0, 0.0, 0.5], [-1.0, 0.0, right], [0.0, 1.0, 0.5], [0.0, -1.0, low]])
    planes = inward @ matrix
    lengths = np.hypot(planes[:, 0], planes[:, 1])
    far = lengths < 1e-12
    scale = np.where(far, 1.0, lengths)
    normals = np.where(far[:, None], 0.0, planes[:, :2] / scale[:, None])
    offsets = np.where(far, np.copysign(np.inf, planes[:, 2]), planes[:, 2] / scale)
    return normals, offsets


def rotation(attitude: Quaternion) -> Floats:
    """Return the 3 x 3 matrix from camera axes (forward, right, down) to NED."""
    w, x, y, z = attitude
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def project(matrix: Floats, points: Floats) -> tuple[Floats, Floats]:
    """Project ground points to pixels.

    Args:
        matrix: 3 x 3, from `Camera.homography`.
        points: Shape (..., 2), metres east and north in the moving frame.

    Returns:
        `pixels`, shape (..., 2), NaN behind the camera, and `depth`, metres along the optical axis.
    """
    homogeneous = points @ matrix[:, :2].T + matrix[:, 2]
    depth = homogeneous[..., 2]
    in_front = np.where(depth > 0.0, depth, np.nan)
    return homogeneous[..., :2] / in_front[..., None], depth


def euler(turn: Quaternion) -> tuple[float, float, float]:
    """Return roll, pitch and yaw (radians) as `Quaternion.from_euler` takes them; straight down,
    roll is 0.

    >>> [round(v, 9) for v in euler(Quaternion.from_euler(0.1, -1.2, 2.0))]
    [0.1, -1.2, 2.0]
    """
    m = rotation(turn)
    pitch = -math.asin(max(-1.0, min(1.0, float(m[2, 0]))))
    if math.hypot(m[0, 0], m[1, 0]) > 1e-6:
        return (
            math.atan2(m[2, 1], m[2, 2]),
            pitch,
            math.atan2(m[1, 0], m[0, 0]),
        )
    return 0.0, pitch, math.atan2(-m[0, 1], m[1, 1])
