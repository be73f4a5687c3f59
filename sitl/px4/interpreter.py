"""PX4's differences in messages: bytewise parameters, setpoints, its mission protocol.

Its texts go to ground stations only; every client receives an EVENT (410). The number of an event
is a hash of its name; the firmware's metadata explain it. The ardupilotmega dialect does not define
the message, so its payload is packed here.
"""

from __future__ import annotations

import math
import struct
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.codec import EVENT, Message, Packed, crc_extra_of
from sitl.copter.aircraft import Notice
from sitl.copter.mission_items import IDLE_COMMANDS, MISSION, Item
from sitl.copter.mission_items import check as check_any
from sitl.copter.params import INT32, Parameter
from sitl.copter.trajectory import Setpoint
from sitl.copter.transfer import Transfer
from sitl.mavlink.interpreter import AUTOPILOT, NO_POSITION, NO_VELOCITY, NO_YAW, Interpreter
from sitl.px4.autopilot import Px4Autopilot
from sitl.px4.params import bytewise, from_bytewise

_TERRAIN = (mav.MAV_FRAME_GLOBAL_TERRAIN_ALT, mav.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT)
# parameters (from 0) by which an item is flown; all others may be not-a-numbers
_FLOWN_BY = {
    mav.MAV_CMD_NAV_WAYPOINT: (0,),
    mav.MAV_CMD_NAV_SPLINE_WAYPOINT: (0,),
    mav.MAV_CMD_NAV_LOITER_TIME: (0,),
    mav.MAV_CMD_NAV_DELAY: (0,),
    mav.MAV_CMD_CONDITION_DELAY: (0,),
    mav.MAV_CMD_CONDITION_DISTANCE: (0,),
    mav.MAV_CMD_CONDITION_YAW: (0, 2),
    mav.MAV_CMD_DO_JUMP: (0, 1),
    mav.MAV_CMD_DO_CHANGE_SPEED: (0, 1),
    mav.MAV_CMD_DO_SET_CAM_TRIGG_DIST: (0,),
    mav.MAV_CMD_DO_FENCE_ENABLE: (0,),
    mav.MAV_CMD_IMAGE_START_CAPTURE: (1, 2),
}


def check(kind: int, item: Item) -> int:
    """Return the MAV_MISSION_RESULT for one item of a list of this kind.

    >>> check(MISSION, Item(mav.MAV_CMD_NAV_TAKEOFF, p=(math.nan,) * 4))
    0
    >>> check(MISSION, Item(mav.MAV_CMD_NAV_WAYPOINT, p=(math.nan,) * 4))
    6
    """
    if item.frame in _TERRAIN:
        return int(mav.MAV_MISSION_UNSUPPORTED_FRAME)
    if kind == MISSION:
        needed = _FLOWN_BY.get(item.command, ())
        p = [0.0 if math.isnan(v) and i not in needed else v for i, v in enumerate(item.p)]
        idle = item.command in IDLE_COMMANDS and math.isnan(item.z)
        item = replace(item, p=(p[0], p[1], p[2], p[3]), z=0.0 if idle else item.z)
    return check_any(kind, item)


_AUTOPILOT = 1 << 24
# number, time, sequence; to component and system (all); the log levels
_LAYOUT = struct.Struct("<IIHBBB")

# by the beginning of the text
_NAMES = (
    ("Arming denied", "commander_arm_denied_resolve_failures"),
    ("Armed by", "commander_armed_by"),
    ("Disarmed by", "commander_disarmed_by"),
)
_OTHER = "commander_other"


def number_of(name: str) -> int:
    """Return the number of an event: 24 bits of FNV-1a below the component.

    >>> hex(number_of("commander_armed_by"))
    '0x190caf3'
    """
    value = 0x811C9DC5
    for byte in name.encode("ascii"):
        value = (value ^ byte) * 0x01000193 & 0xFFFFFFFF
    return _AUTOPILOT | value & 0xFFFFFF


class Events:
    """The events of one vehicle, numbered in sequence."""

    def __init__(self) -> None:
        self._sequence = 0

    def event_for(self, notice: Notice, t_s: float) -> Packed:
        """Return the event that goes with a text."""
        severity, text, name, arguments = notice
        name = name or next((name for begin, name in _NAMES if text.startswith(begin)), _OTHER)
        self._sequence = (self._sequence + 1) & 0xFFFF
        levels = severity & 0xF | (severity & 0xF) << 4
        boot_ms = round(t_s * 1000.0) & 0xFFFFFFFF
        payload = _LAYOUT.pack(number_of(name), boot_ms, self._sequence, 0, 0, levels)
        return EVENT, crc_extra_of(EVENT), payload + arguments


_RETRY_S, _GIVE_UP_S = 0.25, 5.0


class Px4Interpreter(Interpreter):
    """A PX4's end of the link."""

    ap: Px4Autopilot
    odometry_frames = (mav.MAV_FRAME_LOCAL_FRD, mav.MAV_FRAME_LOCAL_NED)
    banner = b""
    sends_mode_at_once = False
    camera_feedback = False
    texts_to_stations = True

    def __post_init__(self) -> None:
        super().__post_init__()
        self._copies: list[bytes] = []  # of parameters that have just been set
        self._events = Events()
        self._handlers["SET_POSITION_TARGET_LOCAL_NED"] = self._local_target
        del self._handlers["REQUEST_DATA_STREAM"]
        del self._handlers["TERRAIN_CHECK"]

    def pack_notice(self, notice: Notice) -> bytes:
        """Return a text, and an event."""
        event = self._events.event_for(notice, self.ap.t_s)
        return super().pack_notice(notice) + self.autopilot_wire.pack(event)

    def _make_transfer(self) -> Transfer:
        ap = self.ap

        def complain(severity: int, text: str) -> None:
            if severity < mav.MAV_SEVERITY_INFO:  # no text when all is well
                ap.send_text(severity, text)

        return Transfer(
            plans=ap.plans,
            home=None,
            running=lambda: False,
            changed=self.commands.plans_changed,
            send_text=complain,
            ask_int=True,
            retry_s=_RETRY_S,
            give_up_s=_GIVE_UP_S,
            whole=True,
            int_frames=True,
            answers_copies=False,
            check=check,
        )

    def _heartbeat(self, m: Message) -> None:
        if m.type == mav.MAV_TYPE_GCS:
            self.ap.failsafes.note_station(self.ap.t_s)

    # --- setpoints ------------------------------------------------------------------------------

    def _position_target(self, m: Message) -> None:
        if self._is_setpoint(m):
            self.ap.setpoints.note(self.ap.t_s)
        super()._position_target(m)

    def _local_target(self, m: Message) -> None:
        if not self._is_setpoint(m):
            return
        self.ap.setpoints.note(self.ap.t_s)
        if not m.type_mask & NO_POSITION:
            if m.coordinate_frame == mav.MAV_FRAME_LOCAL_NED:
                east, north, up = self.telemetry.origin
                yaw = None if m.type_mask & NO_YAW else m.yaw
                place = (east + m.y, north + m.x, up - m.z)
                if m.type_mask & NO_VELOCITY:
                    self.ap.go_to(*place, yaw)
                else:
                    self.ap.go_along(Setpoint(place, (m.vy, m.vx, -m.vz)), yaw)
        elif not m.type_mask & NO_VELOCITY:
            v_north, v_east = m.vx, m.vy
            if m.coordinate_frame == mav.MAV_FRAME_BODY_NED:
                heading = self.ap.body.heading
                v_north = m.vx * math.cos(heading) - m.vy * math.sin(heading)
                v_east = m.vx * math.sin(heading) + m.vy * math.cos(heading)
            self.ap.go_along(Setpoint(None, (v_east, v_north, -m.vz)))

    def _is_setpoint(self, m: Message) -> bool:
        if m.target_component not in (0, AUTOPILOT):
            return False
        numbers = [m.vx, m.vy, m.vz, m.afx, m.afy, m.afz, m.yaw]
        if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
            numbers += [m.x, m.y, m.z]
        return all(map(math.isfinite, numbers))

    # --- parameters -----------------------------------------------------------------------------

    def _param_set(self, m: Message) -> None:
        """Answer with the new value; an unknown name with a text, another type not at all."""
        parameter = self.ap.parameters.by_name.get(m.param_id)
        if parameter is None:
            self.ap.send_text(mav.MAV_SEVERITY_ERROR, f"unknown param: {m.param_id}")
            return
        if m.param_type != parameter.type:
            return
        value = from_bytewise(m.param_value) if parameter.type == INT32 else m.param_value
        if self.ap.parameters.set(m.param_id, value):
            self._send(self._param_value(m.param_id))
            self._copies.append(self.autopilot_wire.pack(self._param_value(m.param_id)))

    def step(self) -> bytes:
        """Send each parameter that was set once more, up to 50 ms later.

        It has the value that was set (`mavlink_parameters.cpp`, `send_untransmitted`), although the
        client's next PARAM_SET may be under way by then.
        """
        copies = b"".join(self._copies)
        self._copies.clear()
        return copies + super().step()

    def _on_wire(self, parameter: Parameter, value: float) -> float:
        return bytewise(int(value)) if parameter.type == INT32 else value
