"""A relay between an autopilot and `uavmap`: a link that can be bad, and a camera as component 100.

The camera renders the true ground, and announces the position that the autopilot estimates.
"""

from __future__ import annotations

import asyncio
import math
import random
import time
from collections.abc import Callable
from typing import Final, cast

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from sitl.camera.pinhole import CameraSpec, Shot
from sitl.codec import Cutter
from sitl.mavlink.camera_component import Exposure, Payload
from sitl.mavlink.telemetry import Telemetry
from sitl.quirks import Quirks
from sitl.world.world import World
from tests.real.autopilot import Autopilot
from tests.real.pilot import Message
from tests.real.sockets import LOOPBACK, Address, Socket

CAMERA: Final = 100
_BEAT_S: Final = 1.0
_COMMANDS: Final = (mav.MAVLINK_MSG_ID_COMMAND_INT, mav.MAVLINK_MSG_ID_COMMAND_LONG)
_EPOCH_S: Final = 1_420_070_400
_TICKS: Final = 1e5
"""Units of time in signatures per second, since the beginning of 2015."""
_FARTHEST_S: Final = 0.3
"""Maximum time for which a position is extrapolated by its velocity, s."""


class Relay:
    def __init__(
        self, autopilot: Autopilot, world: World, spec: CameraSpec, client_port: int, pictures: str
    ) -> None:
        self.lost = 0.0
        """Share of the frames that is lost, in each direction."""
        self.delay_s = 0.0
        """Delay in each direction, by the vehicle's clock, s."""
        self.silent = False
        self.camera_on = True
        self.mission_s: Callable[[], float] = lambda: 0.0
        """Time of the world, which is the mission's: the region may drift."""
        self._autopilot, self._world, self._spec = autopilot, world, spec
        self._vehicle: Address | None = None
        self.client_port = client_port
        self._client = (LOOPBACK, client_port)
        self._outer, self._inner = Socket(self._from_vehicle), Socket(self._from_client)
        self._cutters = Cutter(), Cutter()
        self._decoder = mav.MAVLink(None)
        self._out = mav.MAVLink(None, srcSystem=autopilot.system, srcComponent=CAMERA)
        self._payload = Payload(
            spec, world, cast(Telemetry, self), pictures, self._exposure, Quirks()
        )
        self._random = random.Random(autopilot.system)
        self._beat_s = -math.inf

    # --- the link --------------------------------------------------------------------------------
    async def open(self) -> None:
        await self._outer.open(self._autopilot.relay_port)
        await self._inner.open()
        self._autopilot.pilot.follow.append(self._tick)

    def close(self) -> None:
        self._outer.close()
        self._inner.close()

    def sign_with(self, key: bytes) -> None:
        signing = self._out.signing
        signing.secret_key, signing.link_id, signing.sign_outgoing = key, 7, True

    def _from_vehicle(self, data: bytes, address: Address) -> None:
        self._vehicle = address
        for frame in self._cutters[0].feed(data):
            self._pass_on(self._inner, frame, self._client)

    def _from_client(self, data: bytes, address: Address) -> None:
        for frame in self._cutters[1].feed(data):
            asked = self._for_camera(frame)
            if asked is not None:
                self._answer(asked)
            elif self._vehicle is not None:
                self._pass_on(self._outer, frame, self._vehicle)

    def _pass_on(self, end: Socket, frame: bytes, address: Address) -> None:
        if self.silent or self._random.random() < self.lost:
            return
        if self.delay_s:
            late_s = self.delay_s / self._autopilot.speed
            asyncio.get_running_loop().call_later(late_s, end.send, frame, address)
        else:
            end.send(frame, address)

    # --- the camera ------------------------------------------------------------------------------
    @property
    def boot_ms(self) -> int:
        """Return the time of the vehicle's clock, which the camera shares."""
        return round(self._autopilot.pilot.time_s * 1000.0)

    def place(self, east_m: float, north_m: float, up_m: float) -> tuple[int, int, int]:
        """Return a place in the world, in degrees times 1e7 and millimetres."""
        at = self._world.plane.to_wgs84(east_m, north_m)
        amsl_m = self._world.spec.origin_amsl_m + up_m
        return round(at.lat_deg * 1e7), round(at.lon_deg * 1e7), round(amsl_m * 1000.0)

    def image(self, url: str) -> bytes | None:
        return self._payload.image(url)

    def _tick(self, told: Message) -> None:
        if told.get_type() != "ATTITUDE" or not self.camera_on:
            return
        now_s = self._autopilot.pilot.time_s
        if now_s - self._beat_s >= _BEAT_S or now_s < self._beat_s:
            self._beat_s = now_s
            self._send(self._payload.heartbeat())
        if (
            self._autopilot.truth is None
            or "GLOBAL_POSITION_INT" not in self._autopilot.pilot.latest
        ):
            return
        taken = self._payload.step(now_s)
        if taken is not None:
            self._send(taken)

    def _send(self, message: Message) -> None:
        signing = self._out.signing
        signing.timestamp = max(signing.timestamp, round((time.time() - _EPOCH_S) * _TICKS))
        frame = bytes(message.pack(self._out))
        self._out.seq = (self._out.seq + 1) & 0xFF
        self._pass_on(self._inner, frame, self._client)

    def _for_camera(self, frame: bytes) -> Message | None:
        if frame[0] != mav.PROTOCOL_MARKER_V2 or int.from_bytes(frame[7:10], "little") not in (
            _COMMANDS
        ):
            return None
        message = self._decoder.decode(bytearray(frame))
        return message if message.target_component == CAMERA else None

    def _answer(self, asked: Message) -> None:
        if self.silent or not self.camera_on or self._random.random() < self.lost:
            return
        payload, now_s = self._payload, self._autopilot.pilot.time_s
        result = mav.MAV_RESULT_UNSUPPORTED
        if asked.command == mav.MAV_CMD_IMAGE_START_CAPTURE:
            result = payload.start(asked.param2, asked.param3, asked.param4, now_s)
        elif asked.command == mav.MAV_CMD_IMAGE_STOP_CAPTURE:
            result = payload.stop()
        elif asked.command == mav.MAV_CMD_REQUEST_MESSAGE:
            built = payload.build(int(asked.param1), int(asked.param2))
            if built is not None:
                result = mav.MAV_RESULT_ACCEPTED
                self._send(built)
        to = asked.get_srcSystem(), asked.get_srcComponent()
        self._send(mav.MAVLink_command_ack_message(asked.command, result, 0, 0, *to))

    def _exposure(self, index: int) -> Exposure:
        """Return the true pose and the estimated one, both as they are now."""
        truth, pilot = self._autopilot.truth, self._autopilot.pilot
        assert truth is not None
        told, turned = pilot.latest["GLOBAL_POSITION_INT"], pilot.latest["ATTITUDE"]
        plane, amsl_m = self._world.plane, self._world.spec.origin_amsl_m
        since_s = min(max(pilot.time_s - truth.t_s, 0.0), _FARTHEST_S)
        told_s = min(max(pilot.time_s - told.time_boot_ms / 1000.0, 0.0), _FARTHEST_S)
        north_m_s, east_m_s, down_m_s = truth.velocity_m_s
        east_m, north_m = plane.to_plane(truth.position)
        east_m, north_m = east_m + east_m_s * since_s, north_m + north_m_s * since_s
        up_m = max(0.0, truth.amsl_m - amsl_m - down_m_s * since_s)
        b_east_m, b_north_m = plane.to_plane(LatLon(told.lat / 1e7, told.lon / 1e7))
        b_east_m += told.vy / 100.0 * told_s
        b_north_m += told.vx / 100.0 * told_s
        open_s = self._spec.exposure_s
        body = turned.roll, turned.pitch, turned.yaw
        shot = Shot(
            east_m, north_m, up_m, self._spec.attitude(*truth.attitude_rad),
            self.mission_s(), self._autopilot.system * 1_000_003 + index,
            (east_m_s * open_s, north_m_s * open_s, -down_m_s * open_s),
        )  # fmt: skip
        believed = b_east_m, b_north_m, told.alt / 1000.0 - amsl_m
        height_m = told.relative_alt / 1000.0
        return Exposure(shot, believed, height_m, body, self._spec.attitude(*body))
