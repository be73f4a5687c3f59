"""The update of the view by each message of a vehicle whose ranges the gate has checked."""

from __future__ import annotations

from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon, Quaternion
from uavmap.mavlink.continuity import CameraClock
from uavmap.mavlink.message_gate import RULES, Sender
from uavmap.mavlink.position_history import Fix
from uavmap.mavlink.status_texts import Text
from uavmap.mavlink.vehicle_view import HEIGHT_ERROR_M, OFF_GROUND_M, WORST_ERROR_M, VehicleView

Message = Any

_NO_AUTOPILOT: Final = (mav.MAV_AUTOPILOT_INVALID, mav.MAV_AUTOPILOT_GENERIC)
"""Autopilot types in heartbeats of gimbals, cameras and companion computers."""
_OTHER: Final = frozenset({Sender.ANY})
_AUTOPILOT: Final = _OTHER | {Sender.AUTOPILOT}
_CAMERA: Final = _OTHER | {Sender.CAMERA}
PREARM_BIT: Final = 0x10000000
LANDED_STATE_S: Final = 5.0
"""Maximum age of a landed state, s; after it armed and height decide."""
HOME_MOVES_M: Final = 3.0
"""Height above home below which a PX4 on the ground counts as at home's height, m."""
CLOCKS_APART_S: Final = 2.0
"""Difference of times from which on an attitude is by another clock than the position, s."""
CAMERA_SILENT_S: Final = 10.0
"""Silence after which another camera of the vehicle may replace the first, s."""

_UNKNOWN_16: Final = 0xFFFF
"""Value of an unknown field of 16 bits."""
_UNKNOWN_8: Final = 0xFF
BATTERY_SILENT_S: Final = 5.0
"""Time without a percentage in BATTERY_STATUS after which that of SYS_STATUS counts, s."""
CHARGE_LOW: Final = {
    mav.MAV_BATTERY_CHARGE_STATE_LOW: "low",
    mav.MAV_BATTERY_CHARGE_STATE_CRITICAL: "critical",
    mav.MAV_BATTERY_CHARGE_STATE_EMERGENCY: "almost empty",
    mav.MAV_BATTERY_CHARGE_STATE_FAILED: "failed",
    mav.MAV_BATTERY_CHARGE_STATE_UNHEALTHY: "unhealthy",
}
"""Charge states that forbid a mission, as text."""


def update(view: VehicleView, message: Message, now_s: float) -> bool:
    """Update the view; return False for a message of another system, or one that is refused."""
    name = message.get_type()
    system, component = message.get_srcSystem(), message.get_srcComponent()
    if name == "HEARTBEAT" and view.system_id == 0:
        _bind(view, message, system, component)
    if system != view.system_id or system == 0:
        return False
    if not view.gate.admits(message, _senders(view, component), now_s):
        return False
    if name == "HEARTBEAT" and component == view.autopilot_component:
        if message.autopilot != view.autopilot and view.autopilot is not None:
            view.gate.refuse(name, "another autopilot", now_s)
            return False
        view.received_s = now_s
    handler = _HANDLERS.get(name)
    if handler is not None:
        handler(view, message, now_s, component)
    return True


def is_autopilot(heartbeat: Message) -> bool:
    """Return whether a heartbeat is an autopilot's, by which a vehicle is known."""
    known = heartbeat.autopilot not in _NO_AUTOPILOT
    return known and RULES["HEARTBEAT"].fault(heartbeat) is None


def _bind(view: VehicleView, message: Message, system: int, component: int) -> None:
    """Bind the view to the vehicle of the first heartbeat of an autopilot."""
    if view.wanted_system not in (None, system):
        return
    if is_autopilot(message):
        view.system_id, view.autopilot_component = system, component


def _senders(view: VehicleView, component: int) -> frozenset[Sender]:
    if component == view.autopilot_component:
        both = component == view.camera_component
        return _AUTOPILOT | _CAMERA if both else _AUTOPILOT
    return _CAMERA if component == view.camera_component else _OTHER


def _heartbeat(view: VehicleView, message: Message, now_s: float, component: int) -> None:
    if message.type == mav.MAV_TYPE_CAMERA:
        _note_camera(view, now_s, component)
    if component != view.autopilot_component or message.autopilot in _NO_AUTOPILOT:
        return
    view.autopilot = message.autopilot
    view.mode = message.custom_mode
    armed = bool(message.base_mode & mav.MAV_MODE_FLAG_SAFETY_ARMED)
    view.keeps_home = view.keeps_home and not (view.armed and not armed)
    view.armed = armed
    critical = message.system_status == mav.MAV_STATE_CRITICAL
    view.failsafe = critical and view.kind.reports_failsafe
    if critical and not (view.critical or view.failsafe):
        _add_texts(view, [Text(mav.MAV_SEVERITY_WARNING, "system status CRITICAL")], now_s)
    view.critical = critical
    _add_texts(view, view.chunks.late(now_s), now_s)


def _current_mode(view: VehicleView, message: Message, now_s: float, component: int) -> None:
    """Set the mode between heartbeats.

    An armed PX4 in another mode than intended is in a failsafe. So is one whose heartbeat reports
    it, until the next: it may wait in Hold.
    """
    view.mode, intended = message.custom_mode, message.intended_custom_mode
    if view.kind.reports_failsafe and intended:
        view.failsafe = view.armed and (view.critical or intended != view.mode)


def _note_camera(view: VehicleView, now_s: float, component: int) -> None:
    """Note a camera's message; a second camera does not replace the first while that is active."""
    if component != view.camera_component:
        if now_s - view.camera_received_s < CAMERA_SILENT_S:
            return
        view.camera_component = component
        view.gate.camera_clock = CameraClock()
    view.camera_received_s = now_s


def _position(view: VehicleView, message: Message, now_s: float, component: int) -> None:
    if now_s - view.landed_state_s > LANDED_STATE_S:
        view.landed_state = mav.MAV_LANDED_STATE_UNDEFINED
    if not (view.home_is_kept and view.position is not None):
        view.home_amsl_m = _home_amsl_m(view, message)
    view.reported = LatLon(message.lat / 1e7, message.lon / 1e7)
    view.follow_leap(view.reported, message.time_boot_ms / 1000.0, now_s)
    view.position = view.corrected(view.reported)
    view.position_s = now_s
    view.height_m = view.height_of(message)
    view.rose = view.armed and (view.rose or view.height_m > OFF_GROUND_M)
    view.velocity_ned_m_s = (message.vx / 100.0, message.vy / 100.0, message.vz / 100.0)
    boot_s = message.time_boot_ms / 1000.0
    view.whereabouts.add(Fix(boot_s, view.reported, view.height_m, view.velocity_ned_m_s))


def _home_amsl_m(view: VehicleView, message: Message) -> float:
    """Return the height of home above the sea, m.

    A PX4 takes off above its place. Its reported home moves by up to 1.5 m from one message to the
    next, for minutes after a take-off, on the ground as well. Its own height does not.
    """
    above_home_m = message.relative_alt / 1000.0
    stands = view.landed_state == mav.MAV_LANDED_STATE_ON_GROUND
    if view.kind.amsl and stands and abs(above_home_m) < HOME_MOVES_M:
        above_home_m = 0.0
    return float(message.alt / 1000.0 - above_home_m)


def _attitude(view: VehicleView, message: Message, now_s: float, component: int) -> None:
    """Note an attitude; one with a stamp of another clock is refused and counted."""
    kind = message.get_type()
    boot_s, clock_s = message.time_boot_ms / 1000.0, view.gate.clock.boot_s
    if clock_s is not None and abs(boot_s - clock_s) > CLOCKS_APART_S:
        view.gate.refuse(kind, "its time is not that of the vehicle's position", now_s)
    elif kind == "ATTITUDE":
        turned = Quaternion.from_euler(message.roll, message.pitch, message.yaw)
        view.attitudes.add(boot_s, turned)
    else:
        turned = Quaternion(message.q1, message.q2, message.q3, message.q4)
        view.attitudes.add(boot_s, turned)


def _add_capture(view: VehicleView, message: Message, now_s: float, component: int) -> None:
    boot_s = message.time_boot_ms / 1000.0
    view.gate.camera_clock.add(boot_s, now_s, view.boot_offset_s or 0.0)


def _home(view: VehicleView, message: Message, now_s: float, component: int) -> None:
    view.home = LatLon(message.latitude / 1e7, message.longitude / 1e7)
    if view.ground_home is None or not view.home_is_kept:
        view.ground_home = view.home


def _sys_status(view: VehicleView, message: Message, now_s: float, component: int) -> None:
    view.prearm_ok = bool(message.onboard_control_sensors_health & PREARM_BIT)
    millivolts = message.voltage_battery
    view.volts = millivolts / 1000.0 if 0 < millivolts < _UNKNOWN_16 else None
    _percent(view, message, now_s)


def _battery(view: VehicleView, message: Message, now_s: float, component: int) -> None:
    if view.battery_id is not None and message.id > view.battery_id:
        return  # a second battery: of the camera, of a winch
    if view.battery_id != message.id:
        view.battery_id, view.energy_consumed_j = message.id, None
    _percent(view, message, now_s)
    view.energy_consumed_j = None
    if message.energy_consumed >= 0:
        view.energy_consumed_j = message.energy_consumed * 100.0
        view.battery_s = now_s
    low = CHARGE_LOW.get(message.charge_state, "")
    if low and not view.battery_low:
        words = f"its battery is reported as {low}"
        _add_texts(view, [Text(mav.MAV_SEVERITY_WARNING, words)], now_s)
    view.battery_low = low


def _percent(view: VehicleView, message: Message, now_s: float) -> None:
    """Note the percentage of BATTERY_STATUS, or else of SYS_STATUS.

    SYS_STATUS counts if the other held none for `BATTERY_SILENT_S`. A PX4 rounds it differently in
    each, and it would rise and fall.
    """
    kind, percent = message.get_type(), message.battery_remaining
    counts = kind == "BATTERY_STATUS" or now_s - view.battery_status_s > BATTERY_SILENT_S
    if percent >= 0 and kind == "BATTERY_STATUS":
        view.battery_status_s = now_s
    if percent >= 0 and counts:
        view.battery_percent, view.battery_percent_from = percent, kind
        view.battery_s = now_s
    elif percent < 0 and view.battery_percent_from == kind:
        view.battery_percent = None


def _set_landed_state(view: VehicleView, message: Message, now_s: float, component: int) -> None:
    view.landed_state, view.landed_state_s = message.landed_state, now_s
    if view.off_ground:  # it keeps home by itself until it has landed
        view.keeps_home = False


def _ekf(view: VehicleView, message: Message, now_s: float, component: int) -> None:
    view.ekf_flags = message.flags


def _gps(view: VehicleView, message: Message, now_s: float, component: int) -> None:
    view.gps_fix = message.fix_type
    seen, dilution = message.satellites_visible, message.eph
    view.satellites = None if seen == _UNKNOWN_8 else seen
    view.hdop = None if dilution == _UNKNOWN_16 else dilution / 100.0
    view.height_error_m = (
        min(message.v_acc / 1000.0, WORST_ERROR_M) if message.v_acc else HEIGHT_ERROR_M
    )


def _timesync(view: VehicleView, message: Message, now_s: float, component: int) -> None:
    if message.tc1 != 0:
        view.gate.clock.add_answer(message.ts1, now_s)


def _version(view: VehicleView, message: Message, now_s: float, component: int) -> None:
    view.identity = (message.vendor_id, message.product_id)
    long_uid = bytes(message.uid2)
    if any(long_uid):
        view.uid = long_uid.hex()
    elif message.uid:
        view.uid = f"{message.uid:016x}"


def _text(view: VehicleView, message: Message, now_s: float, component: int) -> None:
    _add_texts(view, view.chunks.add(component, message, now_s), now_s)


def _add_texts(view: VehicleView, texts: list[Text], now_s: float) -> None:
    for text in texts:
        view.add_text(text, now_s)


_HANDLERS: Final = {
    "HEARTBEAT": _heartbeat,
    "CURRENT_MODE": _current_mode,
    "GLOBAL_POSITION_INT": _position,
    "HOME_POSITION": _home,
    "ATTITUDE": _attitude,
    "ATTITUDE_QUATERNION": _attitude,
    "SYS_STATUS": _sys_status,
    "BATTERY_STATUS": _battery,
    "EXTENDED_SYS_STATE": _set_landed_state,
    "EKF_STATUS_REPORT": _ekf,
    "ESTIMATOR_STATUS": _ekf,  # the flags are the same
    "GPS_RAW_INT": _gps,
    "AUTOPILOT_VERSION": _version,
    "STATUSTEXT": _text,
    "TIMESYNC": _timesync,
    "CAMERA_IMAGE_CAPTURED": _add_capture,
}
