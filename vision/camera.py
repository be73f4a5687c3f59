"""The pinhole camera: from metres on the ground to pixels.

Pixel coordinates are those of OpenCV: (0, 0) is the *centre* of the top left pixel, so a picture of
`width_px` columns reaches from -0.5 to `width_px - 0.5`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.ground.grid import Grid
from missions.units import Pose, Quaternion


@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole camera with square pixels, its optical axis through the middle of the picture.

    Attributes:
        hfov_rad: Angle of view across the picture, 0 to pi, open.
        width_px: Columns of the picture, at least 1.
        height_px: Rows of the picture, at least 1.

    >>> camera = Camera(math.radians(90.0), 640, 480)
    >>> round(camera.focal_px, 9)
    320.0
    >>> across_m, along_m = camera.footprint_m(12.0)
    >>> round(across_m, 9), round(along_m, 9)
    (24.0, 18.0)
    """

    hfov_rad: float
    width_px: int
    height_px: int

    def __post_init__(self) -> None:
        """Refuse what is not a camera with `ValueError`."""
        if not 0.0 < self.hfov_rad < math.pi:
            raise ValueError(f"hfov_rad is {self.hfov_rad:g}, expected 0 to pi, open")
        if self.width_px < 1 or self.height_px < 1:
            raise ValueError(f"a picture of {self.width_px} x {self.height_px} px has no pixels")

    @property
    def focal_px(self) -> float:
        """Focal length in pixels."""
        return self.width_px / 2.0 / math.tan(self.hfov_rad / 2.0)

    @property
    def vfov_rad(self) -> float:
        """Angle of view along the picture, top to bottom."""
        return 2.0 * math.atan(self.height_px / 2.0 / self.focal_px)

    def footprint_m(self, height_m: float) -> tuple[float, float]:
        """Ground metres (across, along) that a level camera pointing down sees from `height_m`."""
        metres_a_pixel = height_m / self.focal_px
        return self.width_px * metres_a_pixel, self.height_px * metres_a_pixel

    def homography(self, pose: Pose, grid: Grid, t_s: float) -> NDArray[np.float64]:
        """The 3 x 3 matrix from the grid's moving frame to pixels.

        `H @ (east_m, north_m, 1)` is `(u w, v w, w)`. `w` is the distance in metres along the
        optical axis: a point with `w <= 0` lies behind the camera and is not in the picture,
        whatever `u` and `v` say. The ground is a plane `pose.height_m` below the camera. Between
        the grid and the attitude, which is to true north, lies the grid's meridian convergence.
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
        focal = self.focal_px
        pixels_of_camera = np.array(
            [
                [(self.width_px - 1) / 2.0, focal, 0.0],
                [(self.height_px - 1) / 2.0, 0.0, focal],
                [1.0, 0.0, 0.0],
            ]
        )
        matrix: NDArray[np.float64] = pixels_of_camera @ rotation(pose.attitude).T @ ned_of_ground
        return matrix


def rotation(attitude: Quaternion) -> NDArray[np.float64]:
    """The 3 x 3 matrix that takes vectors from camera axes to NED.

    >>> level_east = Quaternion.from_euler(0.0, 0.0, math.pi / 2)
    >>> forward, right, down = rotation(level_east).T.round(9) + 0.0
    >>> [float(x) for x in forward]
    [0.0, 1.0, 0.0]
    """
    w, x, y, z = attitude
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def project(
    matrix: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pixels of ground points.

    Args:
        matrix: 3 x 3, from `Camera.homography`.
        points: shape (..., 2), metres east and north in the moving frame.

    Returns:
        `pixels`, shape (..., 2), NaN where the point is not in front of the camera, and `depth`,
        shape (...), metres along the optical axis.
    """
    homogeneous = points @ matrix[:, :2].T + matrix[:, 2]
    depth = homogeneous[..., 2]
    in_front = np.where(depth > 0.0, depth, np.nan)
    return homogeneous[..., :2] / in_front[..., None], depth
