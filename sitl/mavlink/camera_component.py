"""The camera as a MAVLink component: takes pictures on command, announces them, keeps the last.

Camera protocol v2: IMAGE_START_CAPTURE, CAMERA_IMAGE_CAPTURED with pose and `file_url`; a lost
announcement can be requested by its index. An ArduPilot reports each picture in CAMERA_FEEDBACK
too. The pictures carry geotags.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon, Quaternion
from sitl.camera.exif import EPOCH_UTC_S, Geotag, black, broken, tagged
from sitl.camera.pinhole import CameraSpec, Shot
from sitl.camera.render import render
from sitl.codec import Message
from sitl.mavlink.telemetry import Telemetry
from sitl.quirks import Quirks
from sitl.world.world import World

_KEPT = 400  # announcements and exposures kept
_KEPT_JPEGS = 16
_SENSOR_WIDTH_MM = 6.17
_SHORTEST_INTERVAL_S = 0.02
_SOON_S = 1e-6


@dataclass(frozen=True, slots=True)
class Exposure:
    """The true pose of the camera, and its pose by the autopilot's estimate."""

    shot: Shot
    believed: tuple[float, float, float]  # east, north, up in the world's plane, metres
    believed_height_m: float  # above home
    body_rad: tuple[float, float, float]  # roll, pitch, yaw of the aircraft, by its compass
    attitude: Quaternion  # of the camera, by the compass
    damage: Literal["", "black", "corrupt"] = ""  # what a fault makes of the picture


class Payload:
    """One camera; `step` takes the pictures that are due."""

    def __init__(
        self,
        spec: CameraSpec,
        world: World,
        telemetry: Telemetry,
        url_prefix: str,
        expose: Callable[[int], Exposure],
        quirks: Quirks,
    ) -> None:
        self.spec = spec
        self._clock_s, self._reports_pose = quirks.camera_clock_s, quirks.camera_tells_pose
        self._world = world
        self._telemetry = telemetry
        self.url_prefix = url_prefix
        self._expose = expose
        self._count = 0
        self._exposures: OrderedDict[str, Exposure] = OrderedDict()
        self._announcements: OrderedDict[int, Message] = OrderedDict()
        self._jpegs: OrderedDict[str, bytes] = OrderedDict()
        self._left = 0  # pictures still to take; negative: until stopped
        self._interval_s = 0.0
        self._next_s: float | None = None  # None: the series begins with the next step
        self._last_s = -math.inf
        self._last_sequence = 0
        self.feedback: Message | None = None
        """CAMERA_FEEDBACK of the last picture, which the autopilot sends."""

    @property
    def boot_ms(self) -> int:
        """Milliseconds on the camera's own clock; it wraps, as `time_boot_ms` does."""
        return self._telemetry.boot_ms + round(self._clock_s * 1000.0) & 0xFFFFFFFF

    # --- commands -------------------------------------------------------------------------------

    def start(self, interval_s: float, count: float, sequence: float, now_s: float) -> int:
        """Execute IMAGE_START_CAPTURE; return its MAV_RESULT.

        A zero count continues until `stop`. An interval below the camera's shortest is lengthened.
        A single picture with the sequence number of the last is a repeated command: accepted, not
        taken twice.
        """
        if not all(map(math.isfinite, (interval_s, count, sequence))) or count < 0:
            return int(mav.MAV_RESULT_DENIED)
        number = int(min(count, 1e6))
        if number == 1 and sequence >= 1 and int(sequence) == self._last_sequence:
            return int(mav.MAV_RESULT_ACCEPTED)
        if self._left != 0 or (
            number == 1 and now_s - self._last_s < self.spec.min_interval_s - _SOON_S
        ):
            return int(mav.MAV_RESULT_TEMPORARILY_REJECTED)
        self._interval_s = max(interval_s, self.spec.min_interval_s, _SHORTEST_INTERVAL_S)
        self._left = number if number > 0 else -1
        self._next_s = None
        self._last_sequence = int(sequence) if number == 1 else 0
        return int(mav.MAV_RESULT_ACCEPTED)

    def stop(self) -> int:
        """Execute IMAGE_STOP_CAPTURE."""
        self._left = 0
        return int(mav.MAV_RESULT_ACCEPTED)

    # --- time -----------------------------------------------------------------------------------

    def step(self, now_s: float) -> Message | None:
        """Take a picture if one is due; return its announcement."""
        due_s = now_s if self._next_s is None else self._next_s
        if self._left == 0 or now_s + _SOON_S < due_s:
            return None
        if self._left > 0:
            self._left -= 1
        # keeps the rhythm, and lets pictures that came too late be lost
        self._next_s = max(due_s + self._interval_s, now_s + _SOON_S)
        self._last_s = now_s
        return self._photograph()

    def _photograph(self) -> Message:
        index = self._count
        self._count += 1
        exposure = self._expose(index)
        url = f"{self.url_prefix}{index}.jpg"
        place = self._telemetry.place(*exposure.believed)
        reported = (*place, round(exposure.believed_height_m * 1000.0), list(exposure.attitude))
        if not self._reports_pose:
            reported = (0, 0, 0, 0, [0.0] * 4)
        message = mav.MAVLink_camera_image_captured_message(
            self.boot_ms, 0, 0, *reported, index, 1, url.encode("ascii")
        )
        self.feedback = self._feedback(index, exposure, place)
        self._exposures[url] = exposure
        self._announcements[index] = message
        if len(self._exposures) > _KEPT:
            self._exposures.popitem(last=False)
            self._announcements.popitem(last=False)
        return message

    def _feedback(self, index: int, exposure: Exposure, place: tuple[int, int, int]) -> Message:
        lat, lon, amsl_mm = place
        roll, pitch, yaw = (math.degrees(angle) for angle in exposure.body_rad)
        count = index + 1
        return mav.MAVLink_camera_feedback_message(
            EPOCH_UTC_S * 1_000_000 + round(exposure.shot.t_s * 1e6), 0, 0, count & 0xFFFF,
            lat, lon, amsl_mm / 1000.0, exposure.believed_height_m, roll, pitch, yaw % 360.0,
            0.0, mav.CAMERA_FEEDBACK_PHOTO, count & 0xFFFF,
        )  # fmt: skip

    # --- what can be asked for ------------------------------------------------------------------

    def image(self, url: str) -> bytes | None:
        """Return the JPEG announced under an address, None if it is unknown or no longer kept.

        It is rendered at the first request from the state at the exposure, with the same bytes as
        if rendered then.
        """
        exposure = self._exposures.get(url)
        if exposure is None:
            return None
        data = self._jpegs.get(url)
        if data is None:
            picture = render(self._world, self.spec, exposure.shot)
            if exposure.damage == "black":
                picture = black(picture)
            data = self._jpegs[url] = tagged(picture, self._geotag(exposure))
            if len(self._jpegs) > _KEPT_JPEGS:
                self._jpegs.popitem(last=False)
        return broken(data) if exposure.damage == "corrupt" else data

    def _geotag(self, exposure: Exposure) -> Geotag:
        lat_e7, lon_e7, amsl_mm = self._telemetry.place(*exposure.believed)
        return Geotag(
            LatLon(lat_e7 / 1e7, lon_e7 / 1e7), amsl_mm / 1000.0, exposure.believed_height_m,
            exposure.attitude, exposure.body_rad, exposure.shot.t_s,
            math.radians(self.spec.hfov_deg), self.spec.width_px,
        )  # fmt: skip

    def build(self, message_id: int, index: int) -> Message | None:
        """Return a message that can be requested from the camera, None for others."""
        if message_id == mav.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED:
            return self._announcements.get(index)
        if message_id == mav.MAVLINK_MSG_ID_CAMERA_INFORMATION:
            return self._information()
        if message_id == mav.MAVLINK_MSG_ID_CAMERA_SETTINGS:
            return mav.MAVLink_camera_settings_message(
                self.boot_ms, mav.CAMERA_MODE_IMAGE, math.nan, math.nan
            )
        if message_id == mav.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS:
            # 0 idle, 1 capture, 3 interval capture in progress
            status = 0 if self._left == 0 else 1 if self._left == 1 else 3
            return mav.MAVLink_camera_capture_status_message(
                self.boot_ms, status, 0, self._interval_s, 0, 0.0, self._count
            )
        return None

    def _information(self) -> Message:
        spec = self.spec
        focal_mm = spec.focal_px * _SENSOR_WIDTH_MM / spec.width_px
        return mav.MAVLink_camera_information_message(
            self.boot_ms, _text(b"uavmap"), _text(b"simulated nadir camera"), 1,
            focal_mm, _SENSOR_WIDTH_MM, _SENSOR_WIDTH_MM * spec.height_px / spec.width_px,
            spec.width_px, spec.height_px, 0, mav.CAMERA_CAP_FLAGS_CAPTURE_IMAGE, 0, b"",
        )  # fmt: skip

    def heartbeat(self) -> Message:
        """HEARTBEAT of a camera."""
        return mav.MAVLink_heartbeat_message(
            mav.MAV_TYPE_CAMERA, mav.MAV_AUTOPILOT_INVALID, 0, 0, mav.MAV_STATE_ACTIVE, 3
        )


def _text(name: bytes) -> list[int]:
    return list(name.ljust(32, b"\0"))
