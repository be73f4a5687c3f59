"""MAV_CMD_*: a table of commands, each a small function.

A function gets a `Request` and returns a `Reply`: the MAV_RESULT of the COMMAND_ACK and the
messages that follow it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.copter.aircraft import Aircraft
from sitl.mavlink.base_commands import (
    ACCEPTED,
    DENIED,
    FAILED,
    UNSUPPORTED,
    BaseCommands,
    Reply,
    Request,
    statustext,
)
from sitl.mavlink.camera_component import Payload
from sitl.mavlink.streams import Streams
from sitl.mavlink.telemetry import Telemetry
from sitl.quirks import CameraKind

__all__ = ["Commands", "Reply", "Request", "statustext"]

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


class Commands:
    """The commands of the autopilot and of its camera.

    `default_s` has the messages that are streamed unasked, and their intervals. `camera`: see
    `sitl.quirks.Quirks`. `answers_for_camera`: the autopilot answers what a camera is asked that
    is not there.
    """

    def __init__(
        self,
        autopilot: Aircraft,
        telemetry: Telemetry,
        streams: Streams,
        payload: Payload,
        flight: BaseCommands,
        default_s: Mapping[int, float],
        camera: CameraKind,
        answers_for_camera: bool,
    ) -> None:
        self._ap = autopilot
        self._telemetry = telemetry
        self._streams = streams
        self._payload = payload
        self.flight = flight
        self._default_s = default_s
        self._camera, self._answers_for_camera = camera, answers_for_camera
        autopilot.route.camera = self._route_camera
        # asked first: the result of a command that a fault answers, None for all others
        self.intercept: Callable[[Request], int | None] | None = None
        self._table: dict[int, Callable[[Request], Reply]] = {
            **self.flight.table,
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
            mav.MAV_CMD_DO_DIGICAM_CONTROL: self._digicam,
            mav.MAV_CMD_IMAGE_STOP_CAPTURE: lambda _: Reply(self._payload.stop()),
            mav.MAV_CMD_REQUEST_CAMERA_INFORMATION: lambda _: self._camera_message(
                mav.MAVLINK_MSG_ID_CAMERA_INFORMATION, 0
            ),
            mav.MAV_CMD_REQUEST_MESSAGE: self._request_message,
        }

    def carry_out(self, request: Request, for_camera: bool) -> Reply:
        """Do it. The autopilot passes the camera's commands on, the camera knows only its own."""
        if self.intercept is not None and (result := self.intercept(request)) is not None:
            return Reply(result)
        function = self._camera_table.get(request.command)
        if self._camera != "component" and (for_camera or request.command in _TRIGGERS):
            return self._without_component(request, for_camera)
        if not for_camera:
            function = self._table.get(request.command, function)
        return function(request) if function is not None else Reply(UNSUPPORTED)

    def _without_component(self, request: Request, for_camera: bool) -> Reply:
        """What becomes of a camera's command where no camera is on the link."""
        if not self._answers_for_camera:
            return Reply(UNSUPPORTED, silent=for_camera)
        if self._camera == "none" or request.command not in _TRIGGERS:
            return Reply(FAILED, by_autopilot=True)
        return replace(self._camera_table[request.command](request), by_autopilot=True)

    # --- messages -------------------------------------------------------------------------------

    def _set_interval(self, request: Request) -> Reply:
        message_id, interval_us = request.integer(1), request.p[1]
        if message_id is None or message_id not in self._telemetry.streamable:
            return Reply(DENIED)
        if not math.isfinite(interval_us):
            return Reply(DENIED)
        interval_s = interval_us / 1e6 if interval_us > 0.0 else None
        if interval_us == 0.0:
            interval_s = self._default_s.get(message_id)
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

    def _digicam(self, request: Request) -> Reply:
        """DO_DIGICAM_CONTROL: a picture when parameter 5 is 1; there is nothing to zoom or focus.

        In a COMMAND_INT that parameter is the field of the latitude, as it is.
        """
        shoot = request.p[4] if request.place is None else request.place[1]
        if shoot != 1:
            return Reply(ACCEPTED)
        return Reply(self._payload.start(0.0, 1.0, 0.0, self._ap.t_s))

    def _route_camera(self, series: tuple[float, int] | None) -> None:
        """What a mission asks of the camera: interval and count, or None to stop.

        A camera that is still busy loses the picture, and says so.
        """
        if series is None:
            self._payload.stop()
            return
        result = self._payload.start(series[0], series[1], 0.0, self._ap.t_s)
        if result != ACCEPTED:
            self._ap.say(mav.MAV_SEVERITY_WARNING, "Camera: not ready, picture lost")

    def _camera_message(self, message_id: int, index: int) -> Reply:
        message = self._payload.build(message_id, index)
        if message is None:
            return Reply(FAILED)
        return Reply(ACCEPTED, (message,), from_camera=True)
