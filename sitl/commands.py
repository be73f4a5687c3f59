"""MAV_CMD_* as an ArduCopter answers them: a table of commands, each a small function.

A function gets a `Request` and returns a `Reply`: the MAV_RESULT of the COMMAND_ACK and the
messages that follow it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.geodesy import LocalPlane
from missions.units import LatLon
from sitl.autopilot import Autopilot
from sitl.modes import Mode
from sitl.payload import Payload
from sitl.streams import Streams
from sitl.telemetry import Telemetry
from sitl.wire import Message

_FORCE_ARM, _FORCE_DISARM = 2989.0, 21196.0
_AMSL_FRAMES = (mav.MAV_FRAME_GLOBAL, mav.MAV_FRAME_GLOBAL_INT)
_HOME_FRAMES = (mav.MAV_FRAME_GLOBAL_RELATIVE_ALT, mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
_TERRAIN_FRAMES = (mav.MAV_FRAME_GLOBAL_TERRAIN_ALT, mav.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT)
_CAMERA_MESSAGES = (
    mav.MAVLINK_MSG_ID_CAMERA_INFORMATION,
    mav.MAVLINK_MSG_ID_CAMERA_SETTINGS,
    mav.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS,
    mav.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED,
)
_SPEED_KINDS = {0: "speed_m_s", 1: "speed_m_s", 2: "climb_m_s", 3: "descent_m_s"}
_HIGHEST_M = 10_000.0

ACCEPTED: int = mav.MAV_RESULT_ACCEPTED
DENIED: int = mav.MAV_RESULT_DENIED
FAILED: int = mav.MAV_RESULT_FAILED
UNSUPPORTED: int = mav.MAV_RESULT_UNSUPPORTED


@dataclass(frozen=True, slots=True)
class Request:
    """A COMMAND_LONG or COMMAND_INT; `place` is the INT's frame, latitude and longitude (1e7)."""

    command: int
    p: tuple[float, float, float, float, float, float, float]
    place: tuple[int, int, int] | None

    def integer(self, index: int) -> int | None:
        """Parameter `index` (from 1) as an integer, None when it is no finite number."""
        value = self.p[index - 1]
        return int(value) if math.isfinite(value) and abs(value) < 2**31 else None


@dataclass(frozen=True, slots=True)
class Reply:
    """Result of a command, and what is sent behind the ACK by whom."""

    result: int
    messages: tuple[Message, ...] = ()
    from_camera: bool = False


class Commands:
    """The commands of the autopilot and of its camera."""

    def __init__(
        self,
        autopilot: Autopilot,
        telemetry: Telemetry,
        streams: Streams,
        payload: Payload,
        plane: LocalPlane,
        amsl_m: float,
    ) -> None:
        self._ap = autopilot
        self._telemetry = telemetry
        self._streams = streams
        self._payload = payload
        self._plane = plane
        self._amsl_m = amsl_m
        self._table: dict[int, Callable[[Request], Reply]] = {
            mav.MAV_CMD_COMPONENT_ARM_DISARM: self._arm_disarm,
            mav.MAV_CMD_DO_SET_MODE: self._set_mode,
            mav.MAV_CMD_NAV_TAKEOFF: self._take_off,
            mav.MAV_CMD_NAV_LAND: lambda _: self._mode(Mode.LAND),
            mav.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda _: self._mode(Mode.RTL),
            mav.MAV_CMD_DO_REPOSITION: self._reposition,
            mav.MAV_CMD_DO_CHANGE_SPEED: self._change_speed,
            mav.MAV_CMD_CONDITION_YAW: self._yaw,
            mav.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_interval,
            mav.MAV_CMD_GET_MESSAGE_INTERVAL: self._get_interval,
            mav.MAV_CMD_REQUEST_MESSAGE: self._request_message,
            mav.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: lambda _: self._send(
                mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION
            ),
            mav.MAV_CMD_GET_HOME_POSITION: lambda _: self._send(mav.MAVLINK_MSG_ID_HOME_POSITION),
        }
        self._camera_table: dict[int, Callable[[Request], Reply]] = {
            mav.MAV_CMD_IMAGE_START_CAPTURE: self._start_capture,
            mav.MAV_CMD_IMAGE_STOP_CAPTURE: lambda _: Reply(self._payload.stop()),
            mav.MAV_CMD_REQUEST_CAMERA_INFORMATION: lambda _: self._camera_message(
                mav.MAVLINK_MSG_ID_CAMERA_INFORMATION, 0
            ),
            mav.MAV_CMD_REQUEST_MESSAGE: self._request_message,
        }

    def carry_out(self, request: Request, for_camera: bool) -> Reply:
        """Do it. The autopilot passes the camera's commands on, the camera knows only its own."""
        function = self._camera_table.get(request.command)
        if not for_camera:
            function = self._table.get(request.command, function)
        return function(request) if function is not None else Reply(UNSUPPORTED)

    # --- flight ---------------------------------------------------------------------------------

    def _arm_disarm(self, request: Request) -> Reply:
        if request.p[0] == 1.0:
            refusal = self._ap.arm(force=request.p[1] == _FORCE_ARM)
        elif request.p[0] == 0.0:
            refusal = self._ap.disarm(force=request.p[1] == _FORCE_DISARM)
        else:
            return Reply(UNSUPPORTED)
        return self._answer(refusal)

    def _set_mode(self, request: Request) -> Reply:
        base, number = request.integer(1), request.integer(2)
        if base is None or number is None or not base & mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return Reply(DENIED)
        return self.set_mode(number)

    def set_mode(self, number: int) -> Reply:
        """A custom mode by its number, as DO_SET_MODE and SET_MODE ask for it."""
        try:
            mode = Mode(number)
        except ValueError:
            return self._answer(f"Mode change failed: no such mode {number}")
        return self._mode(mode)

    def _mode(self, mode: Mode) -> Reply:
        return self._answer(self._ap.set_mode(mode))

    def _take_off(self, request: Request) -> Reply:
        height_m = request.p[6]
        if not height_m <= _HIGHEST_M:
            return Reply(FAILED)
        return Reply(ACCEPTED if self._ap.take_off(height_m) is None else FAILED)

    def _reposition(self, request: Request) -> Reply:
        if request.place is None:
            return Reply(int(mav.MAV_RESULT_COMMAND_INT_ONLY))
        change_mode = request.integer(2) or 0
        if self._ap.mode != Mode.GUIDED:
            if not change_mode & mav.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE:
                return Reply(DENIED)
            if (refusal := self._ap.set_mode(Mode.GUIDED)) is not None:
                return self._answer(refusal)
        target = self.target(*request.place, request.p[6])
        if target is None:
            return Reply(DENIED)
        return Reply(ACCEPTED if self._ap.go_to(*target) else FAILED)

    def target(
        self, frame: int, lat_e7: int, lon_e7: int, altitude_m: float
    ) -> tuple[float, float, float] | None:
        """A global position in the world's plane (east, north, up); None when it is nowhere.

        Heights above terrain are taken from the home altitude's sea level without terrain data:
        as on the real one, the vehicle then comes down.
        """
        if not (math.isfinite(altitude_m) and abs(altitude_m) <= _HIGHEST_M):
            return None
        if not (abs(lat_e7) <= 900_000_000 and abs(lon_e7) <= 1_800_000_000):
            return None
        if frame in _AMSL_FRAMES:
            up = altitude_m - self._amsl_m
        elif frame in _HOME_FRAMES:
            up = altitude_m + self._ap.home[2]
        elif frame in _TERRAIN_FRAMES:
            up = altitude_m - self._amsl_m
        else:
            return None
        east, north = self._plane.to_plane(LatLon(lat_e7 / 1e7, lon_e7 / 1e7))
        return east, north, up

    def _change_speed(self, request: Request) -> Reply:
        kind = _SPEED_KINDS.get(request.integer(1) or 0)
        speed = request.p[1]
        if kind is None or not math.isfinite(speed):
            return Reply(DENIED)
        if speed > 0.0:  # -1: no change
            self._ap.set_speed(kind, speed)
        return Reply(ACCEPTED)

    def _yaw(self, request: Request) -> Reply:
        angle, _speed, direction, relative = request.p[:4]
        if not all(map(math.isfinite, (angle, direction, relative))):
            return Reply(DENIED)
        goal = math.radians(angle)
        if relative:
            goal = self._ap.yaw_goal + math.copysign(1.0, direction) * goal
        return Reply(ACCEPTED if self._ap.turn_to(goal) else FAILED)

    def _answer(self, refusal: str | None) -> Reply:
        """ACK, then (for a refusal) the text that explains it."""
        if refusal is None:
            return Reply(ACCEPTED)
        return Reply(FAILED, (statustext(mav.MAV_SEVERITY_CRITICAL, refusal),))

    # --- messages -------------------------------------------------------------------------------

    def _set_interval(self, request: Request) -> Reply:
        message_id, interval_us = request.integer(1), request.p[1]
        if message_id is None or not self._telemetry.knows(message_id):
            return Reply(DENIED)
        if not math.isfinite(interval_us):
            return Reply(DENIED)
        # 0 is the default rate, and by default nothing is streamed
        interval_s = interval_us / 1e6 if interval_us > 0.0 else None
        self._streams.set(message_id, interval_s, self._ap.t_s)
        return Reply(ACCEPTED)

    def _get_interval(self, request: Request) -> Reply:
        message_id = request.integer(1)
        if message_id is None or not self._telemetry.knows(message_id):
            return Reply(DENIED)
        interval_s = self._streams.interval_s(message_id)
        interval_us = -1 if interval_s is None else min(round(interval_s * 1e6), 2**31 - 1)
        return Reply(ACCEPTED, (mav.MAVLink_message_interval_message(message_id, interval_us),))

    def _request_message(self, request: Request) -> Reply:
        message_id = request.integer(1)
        if message_id is None:
            return Reply(DENIED)
        if message_id in _CAMERA_MESSAGES:
            return self._camera_message(message_id, request.integer(2) or 0)
        return self._send(message_id)

    def _send(self, message_id: int) -> Reply:
        if not self._telemetry.knows(message_id):
            return Reply(FAILED)
        message = self._telemetry.build(message_id)
        return Reply(FAILED) if message is None else Reply(ACCEPTED, (message,))

    # --- camera ---------------------------------------------------------------------------------

    def _start_capture(self, request: Request) -> Reply:
        _, interval_s, count, sequence = request.p[:4]
        return Reply(self._payload.start(interval_s, count, sequence, self._ap.t_s))

    def _camera_message(self, message_id: int, index: int) -> Reply:
        message = self._payload.build(message_id, index)
        if message is None:
            return Reply(FAILED)
        return Reply(ACCEPTED, (message,), from_camera=True)


def statustext(severity: int, text: str) -> Message:
    """STATUSTEXT of at most 50 bytes."""
    return mav.MAVLink_statustext_message(severity, text.encode("ascii", "replace")[:50])
