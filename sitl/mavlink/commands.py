"""A table of MAV_CMD_*, each a small function; and places on the wire.

A function takes a `Request` and returns a `Reply`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from sitl.codec import Message
from sitl.copter.aiding import Answer
from sitl.copter.aircraft import Aircraft
from sitl.copter.fence import Place, zones
from sitl.copter.mission_items import FENCE, RALLY, SPEEDS, Item
from sitl.mavlink.camera_component import Payload
from sitl.mavlink.streams import Streams
from sitl.mavlink.telemetry import Telemetry
from sitl.quirks import CameraKind

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
        """Return parameter `index` (from 1) as an integer, None if it is not finite."""
        value = self.p[index - 1]
        return int(value) if math.isfinite(value) and abs(value) < 2**31 else None

    @property
    def lat_lon_e7(self) -> tuple[int, int] | None:
        """Latitude and longitude in 1e-7 degrees; None where a COMMAND_LONG has none."""
        if self.place is not None:
            return self.place[1:]
        lat, lon = self.p[4:6]
        if not (abs(lat) <= 90.0 and abs(lon) <= 180.0):
            return None
        return round(lat * 1e7), round(lon * 1e7)


@dataclass(frozen=True, slots=True)
class Reply:
    """The MAV_RESULT of a command, and the messages after the ACK.

    `before`: results sent before that one. `by_autopilot`: the autopilot answers for its camera.
    """

    result: int
    messages: tuple[Message, ...] = ()
    from_camera: bool = False
    before: tuple[int, ...] = ()
    by_autopilot: bool = False
    silent: bool = False


def statustext(severity: int, text: str) -> Message:
    """Return STATUSTEXT of at most 50 bytes."""
    return mav.MAVLink_statustext_message(severity, text.encode("ascii", "replace")[:50])


HIGHEST_M = 10_000.0
_FORCE = 21196.0
_AMSL_FRAMES = (mav.MAV_FRAME_GLOBAL, mav.MAV_FRAME_GLOBAL_INT)
_HOME_FRAMES = (mav.MAV_FRAME_GLOBAL_RELATIVE_ALT, mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
_TERRAIN_FRAMES = (mav.MAV_FRAME_GLOBAL_TERRAIN_ALT, mav.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT)
_CAMERA_MESSAGES = (
    mav.MAVLINK_MSG_ID_CAMERA_INFORMATION,
    mav.MAVLINK_MSG_ID_CAMERA_SETTINGS,
    mav.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS,
    mav.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED,
)
_TRIGGERS = (
    mav.MAV_CMD_IMAGE_START_CAPTURE,
    mav.MAV_CMD_IMAGE_STOP_CAPTURE,
    mav.MAV_CMD_DO_DIGICAM_CONTROL,
)


@dataclass(eq=False)
class Commands(ABC):
    """The commands of an autopilot and of its camera.

    `camera`: see `sitl.quirks.Quirks`. `intercept` returns the result of a command that a fault
    answers, None for others.
    """

    refused: ClassVar[int] = FAILED
    """The MAV_RESULT of a command that cannot be executed now."""
    nowhere: ClassVar[int] = DENIED
    """The MAV_RESULT of EXTERNAL_POSITION_ESTIMATE for an invalid place."""
    forces_arming: ClassVar[float] = _FORCE
    """Parameter 2 of COMPONENT_ARM_DISARM that arms whatever the checks object to."""
    unknown_rally_frames: ClassVar[tuple[int, ...]] = ()
    """Frames of rally points that are accepted, and that a return does not support."""
    default_s: ClassVar[Mapping[int, float]] = {}
    """Intervals of the messages that are streamed by default, s."""
    answers_for_camera: ClassVar[bool] = True
    """True if the autopilot answers for a missing camera."""

    ap: Aircraft
    telemetry: Telemetry
    streams: Streams
    payload: Payload
    camera: CameraKind
    intercept: Callable[[Request], int | None]

    def __post_init__(self) -> None:
        self.ap.route.locate = self._item_place
        self.ap.route.camera = self._route_camera
        self._table: dict[int, Callable[[Request], Reply]] = {
            mav.MAV_CMD_COMPONENT_ARM_DISARM: self._arm_disarm,
            mav.MAV_CMD_DO_CHANGE_SPEED: self._change_speed,
            mav.MAV_CMD_DO_SET_MISSION_CURRENT: self._mission_current,
            mav.MAV_CMD_DO_SET_HOME: self._set_home,
            mav.MAV_CMD_EXTERNAL_POSITION_ESTIMATE: self._external_position,
            mav.MAV_CMD_RUN_PREARM_CHECKS: self._prearm_checks,
            mav.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_interval,
            mav.MAV_CMD_GET_MESSAGE_INTERVAL: self._get_interval,
            mav.MAV_CMD_REQUEST_MESSAGE: self._request_message,
            mav.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: lambda _: self._send(
                mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION
            ),
            mav.MAV_CMD_GET_HOME_POSITION: lambda _: self._send(mav.MAVLINK_MSG_ID_HOME_POSITION),
            **self._flight_table(),
        }
        self._camera_table: dict[int, Callable[[Request], Reply]] = {
            mav.MAV_CMD_IMAGE_START_CAPTURE: self._start_capture,
            mav.MAV_CMD_DO_DIGICAM_CONTROL: self._digicam,
            mav.MAV_CMD_IMAGE_STOP_CAPTURE: lambda _: Reply(self.payload.stop()),
            mav.MAV_CMD_REQUEST_CAMERA_INFORMATION: lambda _: self._camera_message(
                mav.MAVLINK_MSG_ID_CAMERA_INFORMATION, 0
            ),
            mav.MAV_CMD_REQUEST_MESSAGE: self._request_message,
        }

    @abstractmethod
    def _flight_table(self) -> dict[int, Callable[[Request], Reply]]:
        """Return the commands that are this autopilot's own."""

    def carry_out(self, request: Request, for_camera: bool) -> Reply:
        """Execute it. The autopilot passes the camera's commands on; the camera has only those."""
        if (result := self.intercept(request)) is not None:
            return Reply(result)
        function = self._camera_table.get(request.command)
        if self.camera != "component" and (for_camera or request.command in _TRIGGERS):
            return self._without_component(request, for_camera)
        if not for_camera:
            function = self._table.get(request.command, function)
        return function(request) if function is not None else Reply(UNSUPPORTED)

    def _without_component(self, request: Request, for_camera: bool) -> Reply:
        if not self.answers_for_camera:
            return Reply(UNSUPPORTED, silent=for_camera)
        if self.camera == "none" or request.command not in _TRIGGERS:
            return Reply(FAILED, by_autopilot=True)
        return replace(self._camera_table[request.command](request), by_autopilot=True)

    # --- messages -------------------------------------------------------------------------------

    def _set_interval(self, request: Request) -> Reply:
        message_id, interval_us = request.integer(1), request.p[1]
        if message_id is None or message_id not in self.telemetry.streamable:
            return Reply(DENIED)
        if not math.isfinite(interval_us):
            return Reply(DENIED)
        interval_s = interval_us / 1e6 if interval_us > 0.0 else None
        if interval_us == 0.0:
            interval_s = self.default_s.get(message_id)
        self.streams.set(message_id, interval_s, self.ap.t_s)
        return Reply(ACCEPTED)

    def _get_interval(self, request: Request) -> Reply:
        message_id = request.integer(1)
        if message_id is None or not self.telemetry.knows(message_id):
            return Reply(DENIED)
        interval_s = self.streams.interval_s(message_id)
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
        if not self.telemetry.knows(message_id):
            return Reply(FAILED)
        message = self.telemetry.build(message_id)
        return Reply(FAILED) if message is None else Reply(ACCEPTED, (message,))

    # --- camera ---------------------------------------------------------------------------------

    def _start_capture(self, request: Request) -> Reply:
        _, interval_s, count, sequence = request.p[:4]
        return Reply(self.payload.start(interval_s, count, sequence, self.ap.t_s))

    def _digicam(self, request: Request) -> Reply:
        """Execute DO_DIGICAM_CONTROL: a picture if parameter 5 is 1; no zoom or focus.

        In a COMMAND_INT that parameter is the field of the latitude, as it is.
        """
        shoot = request.p[4] if request.place is None else request.place[1]
        if shoot != 1:
            return Reply(ACCEPTED)
        return Reply(self.payload.start(0.0, 1.0, 0.0, self.ap.t_s))

    def _route_camera(self, series: tuple[float, int] | None) -> None:
        """Execute a mission's interval and count, None to stop; a busy camera loses the picture."""
        if series is None:
            self.payload.stop()
            return
        result = self.payload.start(series[0], series[1], 0.0, self.ap.t_s)
        if result != ACCEPTED:
            self.ap.send_text(mav.MAV_SEVERITY_WARNING, "Camera: not ready, picture lost")

    def _camera_message(self, message_id: int, index: int) -> Reply:
        message = self.payload.build(message_id, index)
        if message is None:
            return Reply(FAILED)
        return Reply(ACCEPTED, (message,), from_camera=True)

    # --- flight ---------------------------------------------------------------------------------

    @abstractmethod
    def set_mode(self, number: int) -> Reply:
        """Change to a custom mode by its number, as SET_MODE has it."""

    def answer(self, refusal: str | None) -> Reply:
        """Return the ACK, and the text that explains a refusal."""
        if refusal is None:
            return Reply(ACCEPTED)
        return Reply(self.refused, (statustext(mav.MAV_SEVERITY_CRITICAL, refusal),))

    def _arm_disarm(self, request: Request) -> Reply:
        arm, force = request.p[:2]
        if arm == 1.0:
            return self.answer(self.ap.arm(force == self.forces_arming))
        if arm == 0.0:
            return self.answer(self.ap.disarm(force == _FORCE))
        return Reply(UNSUPPORTED)

    def _prearm_checks(self, _: Request) -> Reply:
        if self.ap.armed:
            return Reply(self.refused)
        refusal = self.ap.prearm_refusal()
        texts = () if refusal is None else (statustext(mav.MAV_SEVERITY_CRITICAL, refusal),)
        return Reply(ACCEPTED, texts)

    def target(self, frame: int, lat_e7: int, lon_e7: int, altitude_m: float) -> Place | None:
        """Return a global position in the world's plane (east, north, up); None if it is invalid.

        There are no terrain data: heights above terrain are taken above sea level, and the vehicle
        descends, as the real one does.
        """
        if not (math.isfinite(altitude_m) and abs(altitude_m) <= HIGHEST_M):
            return None
        if not (abs(lat_e7) <= 900_000_000 and abs(lon_e7) <= 1_800_000_000):
            return None
        if frame in _AMSL_FRAMES or frame in _TERRAIN_FRAMES:
            up = altitude_m - self.telemetry.amsl_m
        elif frame in _HOME_FRAMES:
            up = altitude_m + self.ap.home[2]
        else:
            return None
        return (*self._flat(lat_e7, lon_e7), up)

    def _flat(self, lat_e7: int, lon_e7: int) -> tuple[float, float]:
        return self.telemetry.plane.to_plane(LatLon(lat_e7 / 1e7, lon_e7 / 1e7))

    def locate(self, lat_e7: int, lon_e7: int) -> Place | None:
        """Return a latitude and longitude in the world's plane; None if it is invalid."""
        return self.target(mav.MAV_FRAME_GLOBAL, lat_e7, lon_e7, 0.0)

    def _item_place(self, item: Item) -> Place | None:
        return self.target(item.frame, item.x, item.y, item.z)

    def _change_speed(self, request: Request) -> Reply:
        kind = SPEEDS.get(request.integer(1) or 0)
        speed = request.p[1]
        if kind is None or not math.isfinite(speed):
            return Reply(DENIED)
        if speed > 0.0:  # -1: no change
            self.ap.set_speed(kind, speed)
        return Reply(ACCEPTED)

    def _external_position(self, request: Request) -> Reply:
        """Execute EXTERNAL_POSITION_ESTIMATE; its height is not used.

        The time of transmission is taken for the time of arrival.
        """
        ap, (_, delay_s, sigma_m) = self.ap, request.p[:3]
        where = request.lat_lon_e7
        place = None if where is None else self.locate(*where)
        if place is None:
            return Reply(self.nowhere)
        if not ap.home_known:
            return Reply(self.refused)
        delay_s = delay_s if math.isfinite(delay_s) else 0.0
        answer = ap.aiding.external_position(
            place[0], place[1], sigma_m if math.isfinite(sigma_m) else None,
            max(0.0, min(ap.aiding.most_delay_s, delay_s)), flying=ap.airborne,
        )  # fmt: skip
        results = {Answer.TAKEN: ACCEPTED, Answer.REFUSED: self.refused}
        return Reply(results.get(answer, self.nowhere))

    # --- missions, fence, home ------------------------------------------------------------------

    def _mission_current(self, request: Request) -> Reply:
        seq = request.integer(1)
        if seq is None:
            return Reply(DENIED)
        if request.p[1] == 1.0:
            self.ap.route.reset()
        return Reply(ACCEPTED if self.ap.route.jump_to(seq, self.ap) else self.refused)

    def _set_home(self, request: Request) -> Reply:
        if not self.ap.home_known:
            return Reply(self.refused)
        if request.p[0] == 1.0:
            self.ap.set_home(*self.ap.estimate.place)
            return Reply(ACCEPTED)
        where, frame = request.lat_lon_e7, int(mav.MAV_FRAME_GLOBAL)
        if request.place is not None:
            frame = request.place[0]
        home = None if where is None else self.target(frame, *where, request.p[6])
        if home is None or where == (0, 0):
            return Reply(self.refused)
        self.ap.set_home(*home)
        return Reply(ACCEPTED)

    def plans_changed(self, kind: int) -> None:
        """Take over a mission, a fence or rally points that have changed."""
        ap = self.ap
        items = ap.plans[kind]
        if kind == FENCE:
            ap.fence.zones = zones(items, self._flat)
        elif kind == RALLY:
            found = [(item.frame, self._item_place(item)) for item in items]
            ap.rally = tuple(place for _, place in found if place is not None)
            ap.rally_unknown = frozenset(
                place for frame, place in found if place and frame in self.unknown_rally_frames
            )
        else:
            ap.route.plan_changed()
        ap.count_items(kind, items)
