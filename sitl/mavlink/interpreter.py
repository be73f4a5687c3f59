"""The messages that a ground station or companion can send to the vehicle, and their answers.

No message raises. Messages to others, or unknown ones, are ignored; unknown commands are refused.
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
_UNASKED = 65535  # index of a parameter that is sent without a request
_TO_ALL = {
    "HEARTBEAT", "PING", "TERRAIN_CHECK", "TIMESYNC", "GPS_INPUT", "VISION_POSITION_ESTIMATE",
    "ODOMETRY",
}  # fmt: skip
"""Messages to all; others name their target system."""
_NORTH_NORTH, _EAST_EAST = 0, 6  # in the upper triangle of a covariance
_NO_ACCURACY: int = mav.GPS_INPUT_IGNORE_FLAG_HORIZONTAL_ACCURACY
_BAD_QUALITY = -1  # of ODOMETRY


@dataclass(eq=False)
class Interpreter:
    """The vehicle's end of the link."""

    odometry_frames: ClassVar[tuple[int, ...]] = (mav.MAV_FRAME_LOCAL_FRD,)
    """Accepted frames of ODOMETRY; they lie north here."""
    banner: ClassVar[bytes] = b"\r\n\r\nInit ArduCopter V4.6.0\r\n\r\nFree RAM: 131072\r\n"
    """Greeting of a TCP client."""
    sends_mode_at_once: ClassVar[bool] = True
    camera_feedback: ClassVar[bool] = True
    texts_to_stations: ClassVar[bool] = False
    """True if texts go only to links from which a ground station was received."""

    system_id: int
    ap: Aircraft
    commands: Commands
    streams: Streams
    telemetry: Telemetry

    def __post_init__(self) -> None:
        self.has_client = False
        self._reads = 0
        self._terrain_s: float | None = None
        """When its terrain database has been read; None before the first request."""
        self._transfer = self._make_transfer()
        self.autopilot_wire = Packer(self.system_id, AUTOPILOT)
        self.camera_wire = Packer(self.system_id, CAMERA)
        self._sent = bytearray()  # since it was last asked
        self._handlers: dict[str, Callable[[Message], None]] = {
            "COMMAND_LONG": self._command_long,
            "COMMAND_INT": self._command_int,
            "SET_MODE": self._set_mode,
            "SET_POSITION_TARGET_GLOBAL_INT": self._position_target,
            "REQUEST_DATA_STREAM": self._data_stream,
            "PARAM_REQUEST_LIST": lambda _: self._send(
                *(self._param_value(p.name) for p in self.ap.parameters.table)
            ),
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
            "VISION_POSITION_ESTIMATE": lambda m: self._local_position(m, m.covariance),
            "ODOMETRY": self._odometry,
        }

    def _make_transfer(self) -> Transfer:
        ap = self.ap
        return Transfer(
            plans=ap.plans,
            home=self._home_item,
            running=lambda: ap.in_mission and ap.armed,
            changed=self.commands.plans_changed,
            send_text=ap.send_text,
        )

    def handle(self, messages: Iterable[Message]) -> bytes:
        """Handle received messages; return the immediate replies."""
        for message in messages:
            self.has_client = True
            kind = message.get_type()
            handler = self._handlers.get(kind)
            if handler is not None and (
                kind in _TO_ALL or message.target_system in (0, self.system_id)
            ):
                handler(message)
        return self._sent_frames()

    def step(self) -> bytes:
        """Return what is due: requests for missing mission items, news."""
        self._reads = 0
        ap = self.ap
        self._send(*self._transfer.step(ap.t_s))
        if ap.route.reached or ap.parameters.unsent:
            if self.has_client:
                self._send(*map(mav.MAVLink_mission_item_reached_message, ap.route.reached))
                self._send(*(self._param_value(n, _UNASKED) for n in ap.parameters.unsent))
            ap.route.reached.clear()
            ap.parameters.unsent.clear()
        return self._sent_frames()

    def pack_notice(self, notice: Notice) -> bytes:
        """Return a notice as a text."""
        return self.autopilot_wire.pack(statustext(notice.severity, notice.text))

    def _send(self, *messages: Message) -> None:
        for message in messages:
            self._sent += self.autopilot_wire.pack(message)

    def _sent_frames(self) -> bytes:
        sent = bytes(self._sent)
        self._sent.clear()
        return sent

    def _terrain_check(self, m: Message) -> None:
        """Report the terrain at a place; its database takes a moment to be read."""
        now_s = self.ap.t_s
        if self._terrain_s is None:
            self._terrain_s = now_s + _TERRAIN_READ_S
        loaded = now_s >= self._terrain_s
        self._send(self.telemetry.terrain_report(m.lat, m.lon, loaded=loaded))

    # --- commands -------------------------------------------------------------------------------

    def _command_long(self, m: Message) -> None:
        p = (m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7)
        self._command(m, Request(m.command, p, None))

    def _command_int(self, m: Message) -> None:
        p = (m.param1, m.param2, m.param3, m.param4, 0.0, 0.0, m.z)
        self._command(m, Request(m.command, p, (m.frame, m.x, m.y)))

    def _command(self, m: Message, request: Request) -> None:
        if m.target_component not in (0, AUTOPILOT, CAMERA):
            return
        for_camera = m.target_component == CAMERA
        reply = self.commands.carry_out(request, for_camera)
        if reply.silent:
            return
        as_camera = for_camera and not reply.by_autopilot
        wire = self.camera_wire if as_camera else self.autopilot_wire
        sender = self.camera_wire if reply.from_camera or as_camera else self.autopilot_wire
        asker = m.get_srcSystem(), m.get_srcComponent()
        for result in (*reply.before, reply.result):
            ack = mav.MAVLink_command_ack_message(m.command, result, 0, 0, *asker)
            self._sent += wire.pack(ack)
        for message in reply.messages:
            self._sent += sender.pack(message)

    def _set_mode(self, m: Message) -> None:
        if m.base_mode & mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            self._send(*self.commands.set_mode(m.custom_mode).messages)

    def _position_target(self, m: Message) -> None:
        """Execute it, without an acknowledgement; outside guided flight it is dropped."""
        if m.target_component not in (0, AUTOPILOT):
            return
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

    # --- positions that others report; their time of arrival counts ------------------------------

    def _gps_input(self, m: Message) -> None:
        place = self.commands.locate(m.lat, m.lon)
        if place is not None:
            sigma_m = 0.0 if m.ignore_flags & _NO_ACCURACY else _positive(m.horiz_accuracy)
            self.ap.aiding.receiver(place[0], place[1], sigma_m, m.fix_type)

    def _odometry(self, m: Message) -> None:
        bodily = m.child_frame_id == mav.MAV_FRAME_BODY_FRD
        if m.frame_id in self.odometry_frames and bodily and m.quality != _BAD_QUALITY:
            self._local_position(m, m.pose_covariance)

    def _local_position(self, m: Message, covariance: Sequence[float]) -> None:
        """Take a position north and east of the origin (GPS_GLOBAL_ORIGIN)."""
        if math.isfinite(m.x) and math.isfinite(m.y) and self.ap.home_known:
            east, north, _ = self.telemetry.origin
            variance = 0.5 * (
                _positive(covariance[_NORTH_NORTH]) + _positive(covariance[_EAST_EAST])
            )
            sigma_m = math.sqrt(variance)
            self.ap.aiding.vision(east + m.y, north + m.x, sigma_m, m.reset_counter)

    # --- missions -------------------------------------------------------------------------------

    def _mission(self, m: Message) -> None:
        if m.target_component in (0, AUTOPILOT):
            self._send(*self._transfer.receive(m, self.ap.t_s))

    def _set_current(self, m: Message) -> None:
        """Answer MISSION_SET_CURRENT with MISSION_CURRENT; ignore an unknown item."""
        if self.ap.route.jump_to(m.seq, self.ap):
            self._send(self.telemetry.mission_current())

    def _home_item(self) -> Item:
        lat, lon, amsl_mm = self.telemetry.place(*self.ap.home)
        return Item(
            mav.MAV_CMD_NAV_WAYPOINT, mav.MAV_FRAME_GLOBAL, x=lat, y=lon, z=amsl_mm / 1000.0
        )

    def _heartbeat(self, m: Message) -> None:
        """Note its ground station, known by its system id whatever its type."""
        if m.get_srcSystem() == int(self.ap.parameters["SYSID_MYGCS"]):
            self.ap.failsafes.note_station(self.ap.t_s)

    # --- streams --------------------------------------------------------------------------------

    def _data_stream(self, m: Message) -> None:
        every = m.req_stream_id == mav.MAV_DATA_STREAM_ALL
        groups = STREAM_GROUPS.values() if every else [STREAM_GROUPS.get(m.req_stream_id, ())]
        rate_hz = m.req_message_rate if m.start_stop else 0
        interval_s = 1.0 / rate_hz if rate_hz > 0 else None
        for group in groups:
            for message_id in group:
                self.streams.set(message_id, interval_s, self.ap.t_s)

    # --- parameters -----------------------------------------------------------------------------

    def _param_read(self, m: Message) -> None:
        self._reads += 1
        parameters, name = self.ap.parameters, m.param_id
        if m.param_index >= 0:
            known = m.param_index < len(parameters.table)
            name = parameters.table[m.param_index].name if known else ""
        if self._reads <= _READS_A_STEP and name in parameters:
            self._send(self._param_value(name))

    def _param_set(self, m: Message) -> None:
        """Answer with the new value; ignore an unknown name or a NaN."""
        if self.ap.parameters.set(m.param_id, m.param_value):
            self._send(self._param_value(m.param_id))

    def _param_value(self, name: str, index: int | None = None) -> Message:
        parameters = self.ap.parameters
        parameter = parameters.by_name[name]
        return mav.MAVLink_param_value_message(
            name.encode("ascii"), self._on_wire(parameter, parameters[name]), parameter.type,
            len(parameters.table), parameters.index[name] if index is None else index,
        )  # fmt: skip

    def _on_wire(self, parameter: Parameter, value: float) -> float:
        return value

    # --- small talk -----------------------------------------------------------------------------

    def _ping(self, m: Message) -> None:
        if m.target_system == 0:  # otherwise it is an answer
            asker = m.get_srcSystem(), m.get_srcComponent()
            self._send(mav.MAVLink_ping_message(m.time_usec, m.seq, *asker))

    def _timesync(self, m: Message) -> None:
        if m.tc1 == 0:  # or it is an answer to the vehicle's
            self._send(mav.MAVLink_timesync_message(round(self.ap.t_s * 1e9), m.ts1))

    def _ftp(self, m: Message) -> None:
        """Refuse it: a client without an answer waits for many seconds."""
        request = bytes(m.payload)
        sequence = (int.from_bytes(request[:2], "little") + 1) & 0xFFFF
        payload = bytearray(len(request))
        payload[0:2] = sequence.to_bytes(2, "little")
        payload[2] = request[2]  # session
        payload[3] = _FTP_NAK
        payload[4] = 1  # size of the data: the error code
        payload[5] = request[3]  # the opcode that is refused
        payload[12] = _FTP_FAIL
        asker = m.get_srcSystem(), m.get_srcComponent()
        self._send(mav.MAVLink_file_transfer_protocol_message(0, *asker, list(payload)))


def _positive(value: float) -> float:
    """Return a positive finite number, 0 for others: it is not known."""
    return value if math.isfinite(value) and value > 0.0 else 0.0
