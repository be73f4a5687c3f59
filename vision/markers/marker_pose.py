"""The position of another vehicle by the marker on its top, relative to the camera, with
covariance.

Three things are known with errors: the corners in the picture, the camera's attitude and the other
vehicle's tilt. A maximum a posteriori estimate weighs them all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import cv2
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
"""Largest chi square of the residuals: more is a wrong attitude."""


@dataclass(frozen=True, slots=True)
class SightingErrors:
    """Standard deviations of a sighting's inputs.

    Attributes:
        corner_px: The lens's distortion after calibration, beside the picture's noise.
        tilt_rad: Of the camera's attitude about each level axis, at the exposure.
        heading_rad: Of the camera's heading.
    """

    corner_px: float = 0.1
    tilt_rad: float = math.radians(0.5)
    heading_rad: float = math.radians(2.0)


@dataclass(frozen=True, slots=True)
class Carrier:
    """What is known of the vehicle that carries the marker.

    Attributes:
        roll_rad: By its telemetry, right side down.
        pitch_rad: By its telemetry, nose up.
        tilt_rad: Standard deviation of each; the default, that of hovering in wind, is for no
            telemetry.
    """

    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    tilt_rad: float = math.radians(4.0)


@dataclass(frozen=True, slots=True)
class Sighting:
    """A marker's middle, in metres true east, north and up of the camera; its (3, 3) covariance."""

    east_m: float
    north_m: float
    up_m: float
    covariance_m2: Array


def sight(
    found: FoundTag,
    camera: Camera,
    attitude: Quaternion,
    tag_m: float,
    carrier: Carrier = Carrier(),
    errors: SightingErrors = SightingErrors(),
) -> Sighting | None:
    """Return where a marker is; None if nothing fits, as with a wrong attitude.

    Args:
        found: From `vision.markers.marker_corners.find_tags`.
        camera: Without distortion.
        attitude: Camera axes to NED at the exposure, as in `missions.units.Pose`.
        tag_m: Side of the marker's black square, above 0.
    """
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
    return Sighting(east, north, up, np.asarray(covariance[_PLACE, _PLACE]))


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
        self._camera, self._to_ned, self._tag_m = camera, to_ned, tag_m
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
        """Guess by size and direction, as if nothing was tilted; None where that is no place."""
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
        """Return what is known less what follows from `x`, in standard deviations."""
        focal, centre_u, centre_v = self._focus()
        body = rotation(Quaternion.from_euler(float(x[4]), float(x[5]), float(x[_YAW])))
        corners = body @ self._corners + np.array([[x[1]], [x[0]], [-x[2]]])
        camera_axes = cv2.Rodrigues(x[_CAMERA])[0] @ self._to_ned
        forward, right, down = camera_axes.T @ corners
        pixels = np.stack(
            [centre_u + focal * right / forward, centre_v + focal * down / forward], axis=1
        )
        off = self._whiten @ (pixels - self._pixels).ravel()
        return np.concatenate([off, (x[4:] - self._told) / self._sigmas])

    def slopes(self, x: Array) -> Array:
        columns = []
        for i in range(_UNKNOWNS):
            step = np.zeros(_UNKNOWNS)
            step[i] = _STEPS[i]
            ahead, behind = self.misfits(x + step), self.misfits(x - step)
            columns.append((ahead - behind) / (2.0 * _STEPS[i]))
        return np.stack(columns, axis=1)
