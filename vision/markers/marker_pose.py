"""Where another vehicle is, by the marker on its top, relative to the camera, with covariance.

Four things are known, none of them exactly: the corners in the picture, the camera's attitude, how
the other vehicle is tilted, and, where both tell their heights, how far it is below. What agrees
best with all of them at once is taken (a maximum a posteriori estimate); its covariance says what
they leave open. So a range by the marker's size and one by the heights need not be chosen between:
each counts by its own error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.units import Quaternion
from vision.camera import Camera, rotation
from vision.markers.marker_corners import FoundTag

Array = NDArray[np.float64]

_PLACE, _YAW, _CAMERA = slice(0, 3), 3, slice(6, 9)
_UNKNOWNS: Final = 9
_STEPS = np.array([1e-4] * 3 + [1e-5] * 6)
_ITERATIONS = 25
_ENOUGH: Final = 1e-7
_LIKELY: Final = 40.0
"""Of what is left over, as chi square: more is no marker of that size, or a wrong attitude."""


@dataclass(frozen=True, slots=True)
class SightingErrors:
    """Standard deviations of what a sighting rests on.

    Attributes:
        corner_px: What a calibration leaves of the lens's distortion, beside the picture's noise.
        tilt_rad: Of the camera's attitude about each level axis, at the exposure.
        heading_rad: Of the camera's heading.
    """

    corner_px: float = 0.1
    tilt_rad: float = math.radians(0.5)
    heading_rad: float = math.radians(2.0)

    def __post_init__(self) -> None:
        """Refuse what is no error with `ValueError`."""
        if not (self.corner_px >= 0.0 and self.tilt_rad > 0.0 and self.heading_rad > 0.0):
            raise ValueError(f"corner_px is at least 0, tilt_rad and heading_rad above 0: {self}")


@dataclass(frozen=True, slots=True)
class Carrier:
    """What is told of the vehicle that carries the marker.

    Attributes:
        roll_rad: By its telemetry, right side down.
        pitch_rad: By its telemetry, nose up.
        tilt_rad: Standard deviation of each. Where nothing is told: how far a hovering vehicle
            tilts in the wind, the default.
        below_m: How much lower the marker is than the camera by both heights, None where these are
            not told.
        below_sigma_m: Standard deviation of that; of two barometers.
    """

    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    tilt_rad: float = math.radians(4.0)
    below_m: float | None = None
    below_sigma_m: float = 0.3

    def __post_init__(self) -> None:
        """Refuse errors that are none with `ValueError`."""
        if not (self.tilt_rad > 0.0 and self.below_sigma_m > 0.0):
            raise ValueError(f"tilt_rad and below_sigma_m are above 0: {self}")


@dataclass(frozen=True, slots=True)
class Sighting:
    """A marker's middle, in metres true east, true north and up of the camera.

    Attributes:
        tag_id: Its number.
        east_m: East of the camera.
        north_m: North of the camera.
        up_m: Above the camera; below it, it is negative.
        yaw_rad: The true bearing of the marker's upper edge (of the vehicle's nose), 0 to 2 pi.
        yaw_sigma_rad: Its standard deviation; it is that of the camera's heading, mostly.
        covariance_m2: (3, 3), of east, north and up.
    """

    tag_id: int
    east_m: float
    north_m: float
    up_m: float
    yaw_rad: float
    yaw_sigma_rad: float
    covariance_m2: Array

    @property
    def place_m(self) -> Array:
        """East, north and up."""
        return np.array([self.east_m, self.north_m, self.up_m])


def sight(
    found: FoundTag,
    camera: Camera,
    attitude: Quaternion,
    tag_m: float,
    carrier: Carrier = Carrier(),
    errors: SightingErrors = SightingErrors(),
) -> Sighting | None:
    """Where a marker is.

    Args:
        found: From `vision.markers.marker_corners.find_tags`.
        camera: That took the picture; without distortion.
        attitude: Camera axes to NED at the exposure, as in `missions.units.Pose`.
        tag_m: Side of the marker's black square, above 0.
        carrier: What is told of the other vehicle. Where it tells its height, that is used, too.
        errors: What all of it rests on.

    Returns:
        None where nothing fits what is told: a marker of another size, or a wrong attitude.
    """
    if not tag_m > 0.0:
        raise ValueError(f"tag_m is {tag_m:g}, expected above 0")
    view = _View(found, camera, rotation(attitude), tag_m, carrier, errors)
    guess = view.guess()
    if guess is None:
        return None
    now = guess
    for _ in range(_ITERATIONS):
        left, slopes = view.misfits(now), view.slopes(now)
        step = np.linalg.lstsq(slopes, -left, rcond=None)[0]
        now = now + step
        if np.abs(step).max() < _ENOUGH:
            break
    left, slopes = view.misfits(now), view.slopes(now)
    chi2 = float(left @ left)
    if not math.isfinite(chi2) or chi2 > _LIKELY:
        return None
    covariance = np.asarray(np.linalg.inv(slopes.T @ slopes), dtype=np.float64)
    east, north, up = (float(x) for x in now[_PLACE])
    return Sighting(
        found.tag_id, east, north, up, float(now[_YAW]) % math.tau,
        math.sqrt(covariance[_YAW, _YAW]), np.asarray(covariance[_PLACE, _PLACE]),
    )  # fmt: skip


class _View:
    """The measurement equations of one sighting.

    Unknown are place (3), yaw, the marker's roll and pitch, and the error of the camera's attitude
    as a small rotation about north, east and down.
    """

    def __init__(
        self,
        found: FoundTag,
        camera: Camera,
        to_ned: Array,
        tag_m: float,
        carrier: Carrier,
        errors: SightingErrors,
    ) -> None:
        self._pixels = found.corners_px
        self._camera, self._to_ned, self._carrier = camera, to_ned, carrier
        self._tag_m = tag_m
        half = tag_m / 2.0  # forward, right, down of the carrier
        self._corners = half * np.array([[1, -1, 0], [1, 1, 0], [-1, 1, 0], [-1, -1, 0]]).T
        covariance = found.covariance_px2 + errors.corner_px**2 * np.eye(8)
        self._whiten = np.linalg.inv(np.linalg.cholesky(covariance))
        self._told = np.array([carrier.roll_rad, carrier.pitch_rad, 0.0, 0.0, 0.0])
        self._sigmas = np.array(
            [carrier.tilt_rad] * 2 + [errors.tilt_rad] * 2 + [errors.heading_rad]
        )

    def _focus(self) -> tuple[float, float, float]:
        camera = self._camera
        return camera.focal_px, (camera.width_px - 1) / 2.0, (camera.height_px - 1) / 2.0

    def guess(self) -> Array | None:
        """By size and direction, as if nothing was tilted; None where that is no place."""
        focal, centre_u, centre_v = self._focus()
        quad = self._pixels
        one, other = quad[2] - quad[0], quad[3] - quad[1]
        area = 0.5 * abs(float(one[0] * other[1] - one[1] * other[0]))
        if not area > 0.0:
            return None
        middle = quad.mean(axis=0)
        ray = np.array([1.0, (middle[0] - centre_u) / focal, (middle[1] - centre_v) / focal])
        ned = self._to_ned @ ray
        if ned[2] <= 0.1:
            return None
        # a level square's area shrinks with the cube of depth over its height below
        depth = focal * self._tag_m * math.sqrt(ned[2] / area)
        north, east, down = depth * ned
        ahead = (quad[0] + quad[1] - quad[2] - quad[3]) / 2.0
        towards = self._to_ned @ np.array([0.0, ahead[0], ahead[1]])
        found = np.zeros(_UNKNOWNS)
        found[:4] = east, north, -down, math.atan2(towards[1], towards[0])
        found[4:] = self._told
        return found

    def misfits(self, x: Array) -> Array:
        """How far what is known is from what would follow from `x`, in standard deviations."""
        focal, centre_u, centre_v = self._focus()
        body = rotation(Quaternion.from_euler(float(x[4]), float(x[5]), float(x[_YAW])))
        corners = body @ self._corners + np.array([[x[1]], [x[0]], [-x[2]]])
        camera_axes = _small(x[_CAMERA]) @ self._to_ned
        forward, right, down = camera_axes.T @ corners
        pixels = np.stack(
            [centre_u + focal * right / forward, centre_v + focal * down / forward], axis=1
        )
        left = [self._whiten @ (pixels - self._pixels).ravel(), (x[4:] - self._told) / self._sigmas]
        if self._carrier.below_m is not None:
            left.append(np.array([(-x[2] - self._carrier.below_m) / self._carrier.below_sigma_m]))
        return np.concatenate(left)

    def slopes(self, x: Array) -> Array:
        """How the misfits answer to each unknown."""
        columns = []
        for i in range(_UNKNOWNS):
            step = np.zeros(_UNKNOWNS)
            step[i] = _STEPS[i]
            ahead, behind = self.misfits(x + step), self.misfits(x - step)
            columns.append((ahead - behind) / (2.0 * _STEPS[i]))
        return np.stack(columns, axis=1)


def _small(turn: Array) -> Array:
    """The matrix of a rotation about the axis `turn` by its length, radians."""
    angle = float(np.linalg.norm(turn))
    x, y, z = turn
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-12:
        return np.asarray(np.eye(3) + cross, dtype=np.float64)
    turned = math.sin(angle) / angle * cross + (1.0 - math.cos(angle)) / angle**2 * cross @ cross
    return np.asarray(np.eye(3) + turned, dtype=np.float64)
