"""Messages in, messages out: everything a ground station or companion can say to the vehicle.

No message that arrives raises; what is not for this vehicle, or not understood, is passed over,
except unknown commands, which are refused.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.codec import Message, Packer
from sitl.copter.aircraft import Aircraft, Notice
from sitl.copter.mission_items import Item
from sitl.copter.params import Parameter
from sitl.copter.trajectory import Setpoint
from sitl.copter.transfer import Transfer
from sitl.mavlink.commands import Commands, Request, statustext
from sitl.mavlink.streams import STREAM_GROUPS, Streams
from sitl.mavlink.telemetry import Telemetry

AUTOPILOT, CAMERA = mav.MAV_COMP_ID_AUTOPILOT1, mav.MAV_COMP_ID_CAMERA

NO_POSITION = 0x7  # type_mask: ignore x, y, z
NO_VELOCITY = 0x38
NO_YAW = 0x400
_FTP_NAK, _FTP_FAIL = 129, 1
_READS_A_STEP = 24  # parameters asked for one by one: what comes faster is lost
_TERRAIN_READ_S = 1.0
_UNASKED = 65535  # index of a parameter that nobody has asked for
_NORTH_NORTH, _EAST_EAST = 0, 6  # in the upper triangle of a covariance
_NO_ACCURACY: int = mav.GPS_INPUT_IGNORE_FLAG_HORIZONTAL_ACCURACY
_BAD_QUALITY = -1  # of ODOMETRY


@dataclass(eq=False)
class Interpreter:
    """The vehicle's end of the link."""

    odometry_frames: ClassVar[tuple[int, ...]] = (mav.MAV_FRAME_LOCAL_FRD,)
    """In which ODOMETRY is taken; they lie north here."""
    banner: ClassVar[bytes] = b"\r\n\r\nInit ArduCopter V4.6.0\r\n\r\nFree RAM: 131072\r\n"
    """What a TCP client is greeted with."""
    tells_mode_at_once: ClassVar[bool] = True
    camera_feedback: ClassVar[bool] = True
    texts_to_stations: ClassVar[bool] = False
    """Texts go to links on which a ground station was heard."""

    system_id: int
    ap: Aircraft
    commands: Commands
    streams: Streams
    telemetry: Telemetry

    def __post_init__(self) -> None:
        self.heard = False
        self._reads = 0
        self._terrain_s: float | None = None
        """When its terrain database has been read; nobody has asked for it yet."""
        self._transfer = self._make_transfer()
        self.autopilot_wire = Packer(self.system_id, AUTOPILOT)
        self.camera_wire = Packer(self.system_id, CAMERA)
        self._handlers: dict[str, Callable[[Message], bytes]] = {
            "COMMAND_LONG": self._command_long,
            "COMMAND_INT": self._command_int,
            "SET_MODE": self._set_mode,
            "SET_POSITION_TARGET_GLOBAL_INT": self._position_target,
            "REQUEST_DATA_STREAM": self._data_stream,
            "PARAM_REQUEST_LIST": self._param_list,
            "PARAM_REQUEST_READ": self._param_read,
            "PARAM_SET": self._param_set,
            "PING": self._ping,
            "TERRAIN_CHECK": self._terrain_check,
            "TIMESYNC": self._timesync,
            "FILE_TRANSFER_PROTOCOL": self._ftp,
            "HEARTBEAT": self._heartbeat,
            "MISSION_SET_CURRENT": self._set_current,
            **dict.fromkeys(self._transfer.handled, self._mission),
            "GPS_INPUT": self._gps_input,
            "VISION_POSITION_ESTIMATE": self._vision,
            "ODOMETRY": self._odometry,
        }

    def _make_transfer(self) -> Transfer:
        ap = self.ap
        return Transfer(
            plans=ap.plans,
            home=self._home_item,
            running=lambda: ap.in_mission and ap.armed,
            changed=self.commands.plans_changed,
            say=ap.say,
        )

    def handle(self, messages: Iterable[Message]) -> bytes:
        """Handle received messages; the immediate replies."""
        replies = bytearray()
        for message in messages:
            self.heard = True
            handler = self._handlers.get(message.get_type())
            if handler is not None:
                replies += handler(message)
        return bytes(replies)

    def step(self) -> bytes:
        """What the passing of time brings: missing mission items asked for again, news."""
        self._reads = 0
        ap = self.ap
        sent = [self.autopilot_wire.pack(m) for m in self._transfer.step(ap.t_s)]
        if not (ap.route.reached or ap.parameters.untold):
            return b"".join(sent)
        if self.heard:
            sent += [
                self.autopilot_wire.pack(mav.MAVLink_mission_item_reached_message(seq))
                for seq in ap.route.reached
            ]
            sent += [self._param_value(name, _UNASKED) for name in ap.parameters.untold]
        ap.route.reached.clear()
        ap.parameters.untold.clear()
        return b"".join(sent)

    def tell(self, notice: Notice) -> bytes:
        """What the autopilot says, as a text."""
        return self.autopilot_wire.pack(statustext(notice.severity, notice.text))

    def _ours(self, message: Message) -> bool:
        return message.target_system in (0, self.system_id)

    def _terrain_check(self, m: Message) -> bytes:
        """What its terrain database knows of a place; it takes a moment to be read."""
        now_s = self.ap.t_s
        if self._terrain_s is None:
            self._terrain_s = now_s + _TERRAIN_READ_S
        loaded = now_s >= self._terrain_s
        return self.autopilot_wire.pack(self.telemetry.terrain_report(m.lat, m.lon, loaded=loaded))

    # --- commands -------------------------------------------------------------------------------

    def _command_long(self, m: Message) -> bytes:
        p = (m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7)
        return self._command(m, Request(m.command, p, None))

    def _command_int(self, m: Message) -> bytes:
        p = (m.param1, m.param2, m.param3, m.param4, 0.0, 0.0, m.z)
        return self._command(m, Request(m.command, p, (m.frame, m.x, m.y)))

    def _command(self, m: Message, request: Request) -> bytes:
        if not self._ours(m) or m.target_component not in (0, AUTOPILOT, CAMERA):
            return b""
        for_camera = m.target_component == CAMERA
        reply = self.commands.carry_out(request, for_camera)
        if reply.silent:
            return b""
        as_camera = for_camera and not reply.by_autopilot
        wire = self.camera_wire if as_camera else self.autopilot_wire
        sender = self.camera_wire if reply.from_camera or as_camera else self.autopilot_wire
        asker = m.get_srcSystem(), m.get_srcComponent()
        sent = bytearray()
        for result in (*reply.before, reply.result):
            sent += wire.pack(mav.MAVLink_command_ack_message(m.command, result, 0, 0, *asker))
        for message in reply.messages:
            sent += sender.pack(message)
        return bytes(sent)

    def _set_mode(self, m: Message) -> bytes:
        if not self._ours(m) or not m.base_mode & mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return b""
        reply = self.commands.set_mode(m.custom_mode)
        return b"".join(self.autopilot_wire.pack(message) for message in reply.messages)

    def _position_target(self, m: Message) -> bytes:
        """Never acknowledged; outside guided flight dropped without a word."""
        if not self._ours(m) or m.target_component not in (0, AUTOPILOT):
            return b""
        if not m.type_mask & NO_POSITION:
            target = self.commands.target(m.coordinate_frame, m.lat_int, m.lon_int, m.alt)
            yaw = None if m.type_mask & NO_YAW or not math.isfinite(m.yaw) else m.yaw
            velocity = (m.vy, m.vx, -m.vz)
            if target is None:
                pass
            elif m.type_mask & NO_VELOCITY:
                self.ap.go_to(*target, yaw)
            elif all(map(math.isfinite, velocity)):
                self.ap.go_along(Setpoint(target, velocity), yaw)
        elif not m.type_mask & NO_VELOCITY and all(map(math.isfinite, (m.vx, m.vy, m.vz))):
            self.ap.go_along(Setpoint(None, (m.vy, m.vx, -m.vz)))
        return b""

    # --- positions that others tell; their time of arrival counts --------------------------------

    def _gps_input(self, m: Message) -> bytes:
        place = self.commands.locate(m.lat, m.lon)
        if place is not None:
            sigma_m = 0.0 if m.ignore_flags & _NO_ACCURACY else _told(m.horiz_accuracy)
            self.ap.aiding.receiver(place[0], place[1], sigma_m, m.fix_type)
        return b""

    def _vision(self, m: Message) -> bytes:
        return self._local_position(m, m.covariance)

    def _odometry(self, m: Message) -> bytes:
        bodily = m.child_frame_id == mav.MAV_FRAME_BODY_FRD
        if m.frame_id in self.odometry_frames and bodily and m.quality != _BAD_QUALITY:
            return self._local_position(m, m.pose_covariance)
        return b""

    def _local_position(self, m: Message, covariance: Sequence[float]) -> bytes:
        """North and east of the origin (GPS_GLOBAL_ORIGIN)."""
        if math.isfinite(m.x) and math.isfinite(m.y) and self.ap.home_known:
            east, north, _ = self.telemetry.origin
            variance = 0.5 * (_told(covariance[_NORTH_NORTH]) + _told(covariance[_EAST_EAST]))
            sigma_m = math.sqrt(variance)
            self.ap.aiding.vision(east + m.y, north + m.x, sigma_m, m.reset_counter)
        return b""

    # --- missions -------------------------------------------------------------------------------

    def _mission(self, m: Message) -> bytes:
        if not self._ours(m) or m.target_component not in (0, AUTOPILOT):
            return b""
        answers = self._transfer.receive(m, self.ap.t_s)
        return b"".join(self.autopilot_wire.pack(answer) for answer in answers)

    def _set_current(self, m: Message) -> bytes:
        """MISSION_SET_CURRENT: answered with MISSION_CURRENT; an unknown item meets silence."""
        if not self._ours(m) or not self.ap.route.jump_to(m.seq, self.ap):
            return b""
        return self.autopilot_wire.pack(self.telemetry.mission_current())

    def _home_item(self) -> Item:
        lat, lon, amsl_mm = self.telemetry.place(*self.ap.home)
        return Item(
            mav.MAV_CMD_NAV_WAYPOINT, mav.MAV_FRAME_GLOBAL, x=lat, y=lon, z=amsl_mm / 1000.0
        )

    def _heartbeat(self, m: Message) -> bytes:
        """Whoever has the number of its ground station is that, whatever it calls itself."""
        if m.get_srcSystem() == int(self.ap.parameters["SYSID_MYGCS"]):
            self.ap.failsafes.hear_station(self.ap.t_s)
        return b""

    # --- streams --------------------------------------------------------------------------------

    def _data_stream(self, m: Message) -> bytes:
        if not self._ours(m):
            return b""
        every = m.req_stream_id == mav.MAV_DATA_STREAM_ALL
        groups = STREAM_GROUPS.values() if every else [STREAM_GROUPS.get(m.req_stream_id, ())]
        rate_hz = m.req_message_rate if m.start_stop else 0
        interval_s = 1.0 / rate_hz if rate_hz > 0 else None
        for group in groups:
            for message_id in group:
                self.streams.set(message_id, interval_s, self.ap.t_s)
        return b""

    # --- parameters -----------------------------------------------------------------------------

    def _param_list(self, m: Message) -> bytes:
        if not self._ours(m):
            return b""
        return b"".join(self._param_value(p.name) for p in self.ap.parameters.table)

    def _param_read(self, m: Message) -> bytes:
        if not self._ours(m):
            return b""
        self._reads += 1
        if self._reads > _READS_A_STEP:
            return b""
        if m.param_index >= 0:
            table = self.ap.parameters.table
            known = m.param_index < len(table)
            return self._param_value(table[m.param_index].name) if known else b""
        return self._param_value(m.param_id) if m.param_id in self.ap.parameters else b""

    def _param_set(self, m: Message) -> bytes:
        """The new value is the answer; an unknown name or a NaN meets silence."""
        if not self._ours(m) or not self.ap.parameters.set(m.param_id, m.param_value):
            return b""
        return self._param_value(m.param_id)

    def _param_value(self, name: str, told_index: int | None = None) -> bytes:
        parameters = self.ap.parameters
        parameter, index = parameters.by_name[name], parameters.index[name]
        return self.autopilot_wire.pack(
            mav.MAVLink_param_value_message(
                name.encode("ascii"), self._on_wire(parameter, parameters[name]), parameter.type,
                len(parameters.table), index if told_index is None else told_index,
            )
        )  # fmt: skip

    def _on_wire(self, parameter: Parameter, value: float) -> float:
        """The field `param_value`: integers as numbers."""
        return value

    # --- small talk -----------------------------------------------------------------------------

    def _ping(self, m: Message) -> bytes:
        if m.target_system != 0:  # somebody's answer
            return b""
        return self.autopilot_wire.pack(
            mav.MAVLink_ping_message(m.time_usec, m.seq, m.get_srcSystem(), m.get_srcComponent())
        )

    def _timesync(self, m: Message) -> bytes:
        if m.tc1 != 0:  # an answer to ours
            return b""
        return self.autopilot_wire.pack(
            mav.MAVLink_timesync_message(round(self.ap.t_s * 1e9), m.ts1)
        )

    def _ftp(self, m: Message) -> bytes:
        """Refused aloud: a client that meets silence waits for many seconds."""
        if not self._ours(m):
            return b""
        request = bytes(m.payload)
        sequence = (int.from_bytes(request[:2], "little") + 1) & 0xFFFF
        payload = bytearray(len(request))
        payload[0:2] = sequence.to_bytes(2, "little")
        payload[2] = request[2]  # session
        payload[3] = _FTP_NAK
        payload[4] = 1  # size of the data: the error code
        payload[5] = request[3]  # the opcode that is refused
        payload[12] = _FTP_FAIL
        return self.autopilot_wire.pack(
            mav.MAVLink_file_transfer_protocol_message(
                0, m.get_srcSystem(), m.get_srcComponent(), list(payload)
            )
        )


def _told(value: float) -> float:
    """A number that says something; 0 where it is not known.

    >>> _told(math.nan), _told(0.25)
    (0.0, 0.25)
    """
    return value if math.isfinite(value) and value > 0.0 else 0.0
