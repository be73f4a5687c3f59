"""The simulated camera, a pinhole of its own: its mounting, its pose, its pixels.

Frames: NED (true north, true east, down) has its origin on the ground. The camera's axes are
forward (optical axis), right, down (lower edge of the picture). Pixels: u to the right, v down, (0,
0) the centre of the upper left pixel. The optical axis is at ((width - 1) / 2, (height - 1) / 2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np

from missions.units import Quaternion
from sitl.world.ground import Matrix, Relief
from sitl.world.tags import TagPose

_LENS_OVER_GROUND_M = 0.1  # of a landed vehicle
_MAX_HALF_DIAGONAL_DEG = 55.0  # with the tilt limit this keeps the horizon out of the picture


@dataclass(frozen=True, slots=True)
class CameraSpec:
    """A camera on a multicopter, looking down.

    Attributes:
        hfov_deg: Horizontal field of view over the whole width.
        fixed: It tilts with the body; otherwise a gimbal holds it at nadir, and it turns with the
            nose.
        yaw_deg: Bearing of the picture's upper edge relative to the nose.
        min_interval_s: Shortest time between two pictures.
        exposure_s: How long the shutter is open, which blurs what moves.
    """

    hfov_deg: float = 70.0
    width_px: int = 640
    height_px: int = 480
    fixed: bool = True
    yaw_deg: float = 0.0
    min_interval_s: float = 0.2
    exposure_s: float = 0.002

    def __post_init__(self) -> None:
        if not (self.width_px >= 16 and self.height_px >= 16 and 5.0 <= self.hfov_deg <= 105.0):
            raise ValueError(f"a camera that cannot be simulated: {self}")
        if not 0.0 <= self.exposure_s <= 1.0:
            raise ValueError(f"exposure_s is {self.exposure_s:g}, expected 0 to 1")
        diagonal = math.hypot(self.width_px, self.height_px) / 2.0
        if math.degrees(math.atan2(diagonal, self.focal_px)) > _MAX_HALF_DIAGONAL_DEG:
            raise ValueError(f"the field of view reaches the horizon when it tilts: {self}")

    @property
    def focal_px(self) -> float:
        """Focal length in pixels."""
        return self.width_px / 2.0 / math.tan(math.radians(self.hfov_deg) / 2.0)

    @property
    def to_pixel(self) -> Matrix:
        """Matrix from the camera's axes (forward, right, down) to homogeneous pixels."""
        focal, centre = self.focal_px, ((self.width_px - 1) / 2.0, (self.height_px - 1) / 2.0)
        return np.array([[centre[0], focal, 0.0], [centre[1], 0.0, focal], [1.0, 0.0, 0.0]])

    def attitude(self, roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quaternion:
        """Return the camera's axes to NED for the body's attitude, as in CAMERA_IMAGE_CAPTURED."""
        mounting = Quaternion.from_euler(0.0, -math.pi / 2.0, math.radians(self.yaw_deg))
        if not self.fixed:
            roll_rad = pitch_rad = 0.0
        body = Quaternion.from_euler(roll_rad, pitch_rad, yaw_rad)
        return _product(body, mounting)


@dataclass(frozen=True, slots=True)
class Shot:
    """The truth in the middle of an exposure.

    Attributes:
        east_m, north_m: In the world's plane.
        height_m: Over the ground below, which is `ground_m` above the plane.
        moved_m: Motion of the camera (east, north, up) while the shutter is open.
        turned: Its attitude after that time; None: it does not turn.
        tags: The markers of the other vehicles.
    """

    east_m: float
    north_m: float
    height_m: float
    attitude: Quaternion
    t_s: float
    noise_seed: int
    moved_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turned: Quaternion | None = None
    ground_m: float = 0.0
    tags: tuple[TagPose, ...] = ()


def lens_height_m(shot: Shot) -> float:
    """Return the height of the lens over the ground below."""
    return max(shot.height_m, 0.0) + _LENS_OVER_GROUND_M


def ground_to_pixel(camera: CameraSpec, shot: Shot) -> Matrix:
    """Return the homography from ground (east, north, 1) to homogeneous pixels.

    The ground is in metres from the camera's foot point. The point's pixel is the first two
    components divided by the third, which is its depth.
    """
    rotation = axes_to_ned(shot.attitude)  # columns: forward, right, down of the camera in NED
    height = lens_height_m(shot)
    # a ground point (east, north) is (north, east, height) from the lens, in NED
    to_ned = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, height]])
    return np.asarray(camera.to_pixel @ rotation.T @ to_ned, dtype=np.float64)


def image_motion_px(camera: CameraSpec, shot: Shot) -> tuple[float, float]:
    """Return the motion of the ground in the middle of the picture in an exposure: right, down.

    The difference towards the rim is neglected: the turn about the axis, and the tilt. The turn is
    0.2 px at 20 degrees a second, 1/500 s and 300 px from the middle.
    """
    east, north, up = shot.moved_m
    middle = (camera.width_px - 1) / 2.0, (camera.height_px - 1) / 2.0
    ground = np.linalg.inv(ground_to_pixel(camera, shot)) @ (*middle, 1.0)
    later = replace(
        shot, height_m=shot.height_m + up, attitude=shot.turned or shot.attitude, turned=None
    )
    place = ground[0] / ground[2] - east, ground[1] / ground[2] - north, 1.0
    u, v, depth = ground_to_pixel(camera, later) @ place
    return float(u / depth) - middle[0], float(v / depth) - middle[1]


def axes_to_ned(q: Quaternion) -> Matrix:
    """Return the rotation matrix of a unit quaternion: its columns are the axes in NED."""
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _product(a: Quaternion, b: Quaternion) -> Quaternion:
    """First `b`, then `a`."""
    return Quaternion(
        a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
        a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
        a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
        a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
    )


_EVERY_PX: Final = 16
_STEPS: Final = 40
_ENOUGH_M: Final = 0.002
_LEAST, _MOST = 0.05, 8.0  # of the way to the plane through the ground below


def seen_ground(
    camera: CameraSpec, shot: Shot, to_ground: Matrix, relief: Relief
) -> tuple[Matrix, Matrix]:
    """Return east and north of the ground in every pixel, metres from the camera's foot point.

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
    """Return pixels, (n, 2), of ground points in metres from the camera's foot point."""
    lens_m = lens_height_m(shot)
    rise = relief.heights_m(shot.east_m + east_m, shot.north_m + north_m) - shot.ground_m
    points = homography @ np.stack([east_m, north_m, (lens_m - rise) / lens_m])
    return np.asarray((points[:2] / np.maximum(points[2], 1e-3)).T, dtype=np.float64)
