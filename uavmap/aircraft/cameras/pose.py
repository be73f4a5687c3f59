"""The position and attitude of a camera when it took a picture.

A possible pose from the camera itself is used; missing values are interpolated from telemetry to
the time of the exposure.
"""

from __future__ import annotations

import asyncio
import math
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import GeodesyError, ImageError
from missions.geo.grid import Grid
from missions.units import LatLon, Pose, Quaternion
from uavmap.aircraft.cameras.source import Announcement
from uavmap.mavlink.continuity import FASTEST_M_S, distance_m
from uavmap.mavlink.message_gate import unit_fault
from uavmap.mavlink.session import Session
from uavmap.mavlink.vehicle_view import VehicleView

_NADIR: Final = Quaternion.from_euler(0.0, -math.pi / 2.0, 0.0)
"""A camera that looks straight down, its upper edge towards the nose."""


@dataclass(frozen=True, slots=True)
class Mount:
    """A camera under an aircraft that looks straight down, but for small angles.

    `fixed`: bolted to the body, so that it tilts with it; else a gimbal holds it straight down and
    only the heading turns it. `yaw_deg` is the bearing of the picture's upper edge relative to the
    nose. `pitch_deg` and `roll_deg` are the angles of its mounting plate, by which it looks forward
    (pitch) and to the left (roll) of straight down.

    >>> level = Quaternion.from_euler(0.0, 0.0, 0.0)
    >>> [round(x, 3) for x in Mount().attitude(level)]
    [0.707, 0.0, -0.707, 0.0]
    """

    fixed: bool = True
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    roll_deg: float = 0.0

    def attitude(self, body: Quaternion) -> Quaternion:
        """Return the camera axes to NED, from the body's attitude (body axes to NED)."""
        if not self.fixed:
            body = Quaternion.from_euler(0.0, 0.0, heading_rad(body))
        plate = Quaternion.from_euler(
            math.radians(self.roll_deg), math.radians(self.pitch_deg), math.radians(self.yaw_deg)
        )
        return product(body, product(plate, _NADIR))


def heading_rad(q: Quaternion) -> float:
    """Return the heading of a body's nose, clockwise from north, rad."""
    w, x, y, z = q
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the rotation of first `b`, then `a`."""
    return Quaternion(
        a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
        a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
        a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
        a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
    )


MAX_POSITION_DIFFERENCE_M: Final = 15.0
"""Maximum distance of the camera's position from the autopilot's at that time, m."""
MAX_EXTRAPOLATION_S: Final = 1.0
"""Time from the nearest position within which the vehicle's speed gives its place, s."""
RATE_HZ: Final = 10.0
"""Rate of the attitude, for a camera that does not report its own, Hz."""
MAX_TELEMETRY_WAIT_S: Final = 0.6
"""Maximum wait for telemetry after an exposure, s."""
_LOWEST_M, _HIGHEST_M = -500.0, 10_000.0


class Poses:
    """The poses of one camera's pictures; `grid` None: on a computer without a mission."""

    def __init__(self, session: Session, mount: Mount, grid: Grid | None) -> None:
        self._session = session
        self._view = session.view
        self._mount = mount
        self._grid = grid
        self._logged = False
        self.streams: dict[int, float] = {}
        """Rates, Hz, by message id, that it needs besides a mission's."""

    def need_telemetry(self) -> None:
        """Request the autopilot's attitude often: the camera does not report its own."""
        if self.streams:
            return
        self.streams[mav.MAVLINK_MSG_ID_ATTITUDE] = RATE_HZ
        if self._view.autopilot is not None:
            self._session.request_interval(mav.MAVLINK_MSG_ID_ATTITUDE, RATE_HZ)

    async def pose_of(self, picture: Announcement) -> Pose:
        """Return the pose of a picture; without the camera's own, wait for later telemetry.

        Raises `ImageError` with the fault, which is counted.
        """
        reported = picture.reported
        if reported.position is None or reported.attitude is None:
            self._log_missing_pose(picture)
            self.need_telemetry()
            await self._session.until(
                lambda: self._has_telemetry(picture.taken_s), MAX_TELEMETRY_WAIT_S
            )
        fault, pose = self._pose(picture)
        if pose is None or fault is not None:
            self._view.gate.refuse(
                picture.kind, f"the camera reports no usable pose: {fault}",
                asyncio.get_running_loop().time(),
            )  # fmt: skip
            raise ImageError(f"the camera reports no usable pose: {fault}")
        return pose

    def _log_missing_pose(self, picture: Announcement) -> None:
        """Log once that a camera does not report its pose."""
        if self._logged or picture.kind != "CAMERA_IMAGE_CAPTURED":
            return
        self._logged = True
        what = "attitude" if picture.reported.attitude is None else "position"
        self._view.gate.say(
            f"the camera does not report its {what}: the autopilot's is used, with "
            "camera.mounting, camera.yaw_deg, camera.pitch_deg and camera.roll_deg"
        )

    def _has_telemetry(self, taken_s: float) -> bool:
        boot_s = taken_s - (self._view.boot_offset_s or 0.0)
        place = self._view.place_at(taken_s)
        told_s = self._view.gate.clock.boot_s
        beyond = place is not None and told_s is not None and told_s >= boot_s
        return beyond and self._view.attitudes.last_s >= boot_s

    def _pose(self, picture: Announcement) -> tuple[str | None, Pose | None]:
        """Return the fault, and the pose."""
        reported = picture.reported
        if (reported.position is None or reported.attitude is None) and picture.fault is not None:
            return picture.fault, None
        attitude = reported.attitude
        if attitude is None:
            body = self._view.attitude_at(picture.taken_s)
            if body is None:
                return "it reports no attitude, and the vehicle's own at that time is unknown", None
            attitude = self._mount.attitude(body)
        position, height_m = reported.position, reported.height_m
        if position is None:
            place = self._view.place_at(picture.taken_s)
            if self._view.position is None or place is None or place.gap_s > MAX_EXTRAPOLATION_S:
                return "it reports no position, and the vehicle's own at that time is unknown", None
            position, height_m = place.position, place.height_m
        pose = Pose(position, height_m, attitude)
        return pose_fault(pose, self._view, self._grid, picture.taken_s), pose


def pose_fault(pose: Pose, view: VehicleView, grid: Grid | None, taken_s: float) -> str | None:
    """Return the fault of a pose, by the vehicle's position at the exposure (loop's time).

    None without a fault.
    """
    position, height_m = pose.position, pose.height_m
    if abs(position.lat_deg) > 90.0 or abs(position.lon_deg) > 180.0:
        return "the position is not on Earth"
    if not _LOWEST_M <= height_m <= _HIGHEST_M:
        return "the height is out of range"
    if fault := unit_fault(*pose.attitude):
        return fault
    place = view.place_at(taken_s)
    if view.position is None or place is None:
        return "the vehicle has not reported where it is"
    most_m = MAX_POSITION_DIFFERENCE_M + FASTEST_M_S * max(place.gap_s - MAX_EXTRAPOLATION_S, 0.0)
    if distance_m(position, place.position) > most_m:
        return "the position is not where the vehicle was"
    if abs(height_m - place.height_m) > most_m:
        return "the height is not that of the vehicle"
    return None if grid is None else _off_the_map(position, grid)


def _off_the_map(position: LatLon, grid: Grid) -> str | None:
    try:
        finite = all(map(math.isfinite, grid.fixed(position)))
    except GeodesyError:
        finite = False
    return None if finite else "the position is outside the map"
