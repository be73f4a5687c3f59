"""Cameras: a pinhole, from metres on the ground to pixels; a real lens with its distortion.

Pixel (0, 0) is the *centre* of the top left pixel, as in OpenCV: a picture reaches from -0.5 to
`width_px - 0.5`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import cv2
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
    """Return roll, pitch and yaw (radians) as `Quaternion.from_euler` accepts them.

    Straight down, roll is 0.

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


# --- a real lens ---------------------------------------------------------------------------------
Model = Literal["brown", "fisheye"]
"""`brown`: k1 k2 p1 p2 [k3 [k4 k5 k6]]; `fisheye`: k1 k2 k3 k4 (Kannala-Brandt), as in OpenCV."""

_COUNTS = {"brown": (0, 4, 5, 8), "fisheye": (4,)}
_CENTRED = 1e-4  # of the width: a tenth of a pixel in a thousand


@dataclass(frozen=True, slots=True)
class Lens:
    """The intrinsics of a picture of `width_px` x `height_px`, in its pixels.

    The principal point `cx_px`, `cy_px` lies inside the picture; `model` gives the meaning of
    `distortion`, which is empty for a pinhole. Raises `ValueError` for what is no lens.
    """

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    model: Model = "brown"
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.width_px < 1 or self.height_px < 1:
            raise ValueError(f"a picture of {self.width_px} x {self.height_px} px has no pixels")
        numbers = (self.fx_px, self.fy_px, self.cx_px, self.cy_px, *self.distortion)
        if not all(map(math.isfinite, numbers)):
            raise ValueError("a lens needs finite numbers")
        if self.fx_px <= 0.0 or self.fy_px <= 0.0:
            raise ValueError(f"focal lengths {self.fx_px:g}, {self.fy_px:g} px: must be above 0")
        inside = (
            -0.5 < self.cx_px < self.width_px - 0.5 and -0.5 < self.cy_px < self.height_px - 0.5
        )
        if not inside:
            raise ValueError(
                f"principal point ({self.cx_px:g}, {self.cy_px:g}) px outside of the picture of "
                f"{self.width_px} x {self.height_px} px"
            )
        if len(self.distortion) not in _COUNTS[self.model]:
            counts = ", ".join(map(str, _COUNTS[self.model]))
            raise ValueError(
                f"{len(self.distortion)} coefficients of distortion; the model {self.model} has "
                f"{counts}"
            )

    @classmethod
    def pinhole(cls, hfov_rad: float, width_px: int, height_px: int) -> Lens:
        """Return an undistorted lens with its axis in the middle; `ValueError` for no angle."""
        if not 0.0 < hfov_rad < math.pi:
            raise ValueError(f"hfov_rad is {hfov_rad:g}, expected 0 to pi, open")
        return cls.square(width_px / 2.0 / math.tan(hfov_rad / 2.0), width_px, height_px)

    @classmethod
    def square(cls, focal_px: float, width_px: int, height_px: int) -> Lens:
        """Return an undistorted lens of square pixels with its axis in the middle."""
        middle = ((width_px - 1) / 2.0, (height_px - 1) / 2.0)
        return cls(width_px, height_px, focal_px, focal_px, *middle)

    @property
    def hfov_rad(self) -> float:
        """Angle of view across the picture of a pinhole of the same focal length, radians."""
        return 2.0 * math.atan(self.width_px / 2.0 / self.fx_px)

    @property
    def hfov_deg(self) -> float:
        """Angle of view across the picture of a pinhole of the same focal length, degrees."""
        return math.degrees(self.hfov_rad)

    @property
    def is_pinhole(self) -> bool:
        """True for a pinhole with square pixels and its axis in the middle."""
        return (
            self.model == "brown"
            and not any(self.distortion)
            and math.isclose(self.fx_px, self.fy_px, rel_tol=1e-4)
            and abs(self.cx_px - (self.width_px - 1) / 2.0) < _CENTRED * self.width_px
            and abs(self.cy_px - (self.height_px - 1) / 2.0) < _CENTRED * self.width_px
        )

    def scaled(self, width_px: int, height_px: int) -> Lens:
        """Return the lens of the same picture, scaled to another size.

        >>> half = Lens.pinhole(math.radians(90.0), 640, 480).scaled(320, 240)
        >>> round(half.fx_px, 6), half.cx_px
        (160.0, 159.5)
        """
        across, along = width_px / self.width_px, height_px / self.height_px
        return replace(
            self,
            width_px=width_px,
            height_px=height_px,
            fx_px=self.fx_px * across,
            fy_px=self.fy_px * along,
            cx_px=(self.cx_px + 0.5) * across - 0.5,
            cy_px=(self.cy_px + 0.5) * along - 0.5,
        )


_WIDEST_RAD = math.radians(150.0)
"""Widest pinhole, rad: a wider one shows more of its picture's rim than of the ground."""
_EDGE_STEPS = 33
_TOUCH_PX = 1e-4


@dataclass(frozen=True, slots=True)
class Straightening:
    """Map from each pixel of the pinhole's picture to its place in the lens's picture."""

    camera: Camera
    columns: NDArray[np.float32]
    rows: NDArray[np.float32]

    def applied(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return a picture of the lens as the pinhole `camera` would show it, of its size."""
        straight = cv2.remap(
            image, self.columns, self.rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(straight, dtype=np.uint8)


def straightening(lens: Lens) -> Straightening:
    """Return the pinhole of a lens, and the map to its pictures.

    Its axis and picture size are the lens's. All of its picture lies inside the lens's, so corners
    are left out and no pixel is invented.

    >>> plan = straightening(Lens.pinhole(math.radians(80.0), 640, 480))
    >>> round(math.degrees(plan.camera.hfov_rad), 3)
    80.0
    """
    width_px, height_px = lens.width_px, lens.height_px
    focal_px = _focal_px(lens)
    camera = Camera(2.0 * math.atan(width_px / 2.0 / focal_px), width_px, height_px)
    u, v = np.meshgrid(
        np.arange(width_px, dtype=np.float64), np.arange(height_px, dtype=np.float64)
    )
    x = (u - (width_px - 1) / 2.0) / focal_px
    y = (v - (height_px - 1) / 2.0) / focal_px
    pixels = distorted(lens, np.stack([x, y], axis=-1).reshape(-1, 2))
    pixels = pixels.reshape(height_px, width_px, 2).astype(np.float32)
    return Straightening(
        camera, np.ascontiguousarray(pixels[..., 0]), np.ascontiguousarray(pixels[..., 1])
    )


def distorted(lens: Lens, rays: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return pixels of rays (x, y, 1), x to the right and y down; shape (n, 2) both."""
    matrix = np.array([[lens.fx_px, 0, lens.cx_px], [0, lens.fy_px, lens.cy_px], [0, 0, 1.0]])
    coefficients = np.array(lens.distortion or (0.0,) * 4)
    if lens.model == "fisheye":
        found = cv2.fisheye.distortPoints(rays.reshape(-1, 1, 2), matrix, coefficients)
    else:
        along = np.column_stack([rays, np.ones(len(rays))])
        none = np.zeros(3)
        found, _ = cv2.projectPoints(along, none, none, matrix, coefficients)
    return np.asarray(found, dtype=np.float64).reshape(-1, 2)


def _focal_px(lens: Lens) -> float:
    """Return the shortest focal length at which the pinhole's rim lies in the lens's picture."""
    width_px, height_px = lens.width_px, lens.height_px
    across = np.linspace(-0.5, width_px - 0.5, _EDGE_STEPS) - (width_px - 1) / 2.0
    along = np.linspace(-0.5, height_px - 0.5, _EDGE_STEPS) - (height_px - 1) / 2.0
    left, top = np.full(_EDGE_STEPS, across[0]), np.full(_EDGE_STEPS, along[0])
    rim = np.concatenate(
        [
            np.column_stack(side)
            for side in ((across, top), (across, -top), (left, along), (-left, along))
        ]
    )

    low_px = -0.5 - _TOUCH_PX
    right_px, bottom_px = width_px + low_px + 2 * _TOUCH_PX, height_px + low_px + 2 * _TOUCH_PX

    def inside(focal_px: float) -> bool:
        # every radius is checked out to the rim: a polynomial may turn back on itself
        for part in (0.25, 0.5, 0.75, 1.0):
            u, v = distorted(lens, rim * part / focal_px).T
            within = (u >= low_px) & (u <= right_px) & (v >= low_px) & (v <= bottom_px)
            if not bool(within.all()):
                return False
        return True

    low = width_px / 2.0 / math.tan(_WIDEST_RAD / 2.0)
    high = 20.0 * max(lens.fx_px, lens.fy_px)
    for _ in range(50):
        middle = (low + high) / 2.0
        low, high = (low, middle) if inside(middle) else (middle, high)
    return high
