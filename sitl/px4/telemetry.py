"""A PX4's state as MAVLink messages: differences to ArduPilot's, and its default streams."""

from __future__ import annotations

import math
import struct
from collections.abc import Collection

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import Quaternion
from sitl.codec import CURRENT_MODE, Message, Packed, crc_extra_of
from sitl.mavlink.telemetry import IDENTITY, Telemetry
from sitl.px4.autopilot import Px4Autopilot
from sitl.px4.modes import UNARMABLE, Px4Mode

_VERSION_1_15_4 = (1 << 24) | (15 << 16) | (4 << 8) | 255  # FIRMWARE_VERSION_TYPE_OFFICIAL
_CAPABILITIES = (
    mav.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | mav.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mav.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
    | mav.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | mav.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
    | mav.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    | mav.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    | mav.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
)
_AUTO = (
    mav.MAV_MODE_FLAG_AUTO_ENABLED
    | mav.MAV_MODE_FLAG_STABILIZE_ENABLED
    | mav.MAV_MODE_FLAG_GUIDED_ENABLED
)
_BY_HAND = mav.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED | mav.MAV_MODE_FLAG_STABILIZE_ENABLED
_ESTIMATOR_GOOD = 0x33F  # attitude, velocities, relative and absolute position, predictions
_ESTIMATOR_AT_REST = 0x3FF  # and, on the ground, that the position is held constant
_ESTIMATOR_NO_POSITION = 0xA7
_CURRENT_MODE = struct.Struct("<IIB")  # mode, intended mode, standard mode (none)
_ESTIMATOR_ABSOLUTE = 0x210  # the absolute position, and its prediction

DEFAULT_HZ = {
    mav.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mav.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    mav.MAVLINK_MSG_ID_GPS_RAW_INT: 1.0,
    mav.MAVLINK_MSG_ID_ATTITUDE: 10.0,
    mav.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 5.0,
    mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 1.0,
    mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 5.0,
    mav.MAVLINK_MSG_ID_MISSION_CURRENT: 1.0,
    mav.MAVLINK_MSG_ID_VFR_HUD: 4.0,
    mav.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: 1.0,
    mav.MAVLINK_MSG_ID_ALTITUDE: 1.0,
    mav.MAVLINK_MSG_ID_BATTERY_STATUS: 0.5,
    mav.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 0.5,
    mav.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
    mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1.0,
    CURRENT_MODE: 0.5,
}
"""Messages on a link to a ground station without a request (PX4's mode "normal")."""

_NOT_SENT = ("ekf_status_report", "wind", "fence_status")  # which an ArduPilot sends
DEFAULT_S = {int(message_id): 1.0 / hz for message_id, hz in DEFAULT_HZ.items()}


class Px4Telemetry(Telemetry):
    """Builds a PX4's messages."""

    _ap: Px4Autopilot

    kinds = (
        *(kind for kind in Telemetry.kinds if kind not in _NOT_SENT),
        "estimator_status", "altitude", "attitude_quaternion", "current_mode",
    )  # fmt: skip

    @property
    def streamable(self) -> Collection[int]:
        """All but the heartbeat (`mavlink_receiver.cpp`, `set_message_interval`)."""
        return self._builders.keys() - {mav.MAVLINK_MSG_ID_HEARTBEAT}

    def current_mode(self) -> Packed:
        """CURRENT_MODE, which the dialect does not define: the mode and the intended mode."""
        payload = _CURRENT_MODE.pack(int(self.reported_mode), int(self._ap.intended), 0)
        return CURRENT_MODE, crc_extra_of(CURRENT_MODE), payload

    @property
    def reported_mode(self) -> Px4Mode:
        """Mode; a blind descent out of OFFBOARD is reported as ALTITUDE."""
        ap = self._ap
        blind = ap.failsafes.engaged and ap.mode == Px4Mode.LAND and not ap.position_ok
        return Px4Mode.ALTITUDE if blind and ap.intended == Px4Mode.OFFBOARD else ap.mode

    def heartbeat(self) -> Message:
        """HEARTBEAT."""
        ap, mode = self._ap, self.reported_mode
        base = mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        if mode.automatic:
            base |= _AUTO
        elif mode != Px4Mode.OFFBOARD:
            base |= _BY_HAND
        armable = ap.prearm_ok and mode not in UNARMABLE
        status = mav.MAV_STATE_STANDBY if armable else mav.MAV_STATE_UNINIT
        if ap.armed:
            base |= mav.MAV_MODE_FLAG_SAFETY_ARMED
            status = mav.MAV_STATE_CRITICAL if ap.failsafes.active else mav.MAV_STATE_ACTIVE
        return mav.MAVLink_heartbeat_message(
            mav.MAV_TYPE_QUADROTOR, mav.MAV_AUTOPILOT_PX4, base, int(mode), status, 3
        )

    @property
    def _percents(self) -> tuple[int, int]:
        """Rounded up, and to the nearest (`SYS_STATUS.hpp`, `BATTERY_STATUS.hpp`)."""
        percent = 100.0 * self._ap.battery.remaining_share
        return math.ceil(percent - 1e-9), math.floor(percent + 0.5)

    @property
    def _current_ca(self) -> int:
        return -1  # it is not measured

    @property
    def _consumed(self) -> tuple[int, int]:
        return -1, -1

    def autopilot_version(self) -> Message:
        """AUTOPILOT_VERSION of a PX4 1.15, with the simulator's own vendor and product."""
        return mav.MAVLink_autopilot_version_message(
            _CAPABILITIES, _VERSION_1_15_4, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, *IDENTITY, 0
        )

    def estimator_status(self) -> Message:
        """ESTIMATOR_STATUS: no absolute position until ready."""
        flags = _ESTIMATOR_GOOD if self._ap.airborne else _ESTIMATOR_AT_REST
        if not self._ap.position_ok:
            flags = _ESTIMATOR_NO_POSITION
        elif not self._ap.aiding.absolute:
            flags &= ~_ESTIMATOR_ABSOLUTE
        accuracy_m = self._ap.error.accuracy_m
        return mav.MAVLink_estimator_status_message(
            round(self._ap.t_s * 1e6), flags, 0.1, 0.1, 0.1, 0.1, 0.0, 0.0, accuracy_m, 0.5
        )

    def altitude(self) -> Message:
        """ALTITUDE: over the sea, the origin and home; the terrain is not known."""
        up, amsl = self._ap.estimate.up, self.amsl_m + self._ap.estimate.up
        return mav.MAVLink_altitude_message(
            round(self._ap.t_s * 1e6), amsl, amsl, up - self.origin[2],
            up - self._ap.home[2], math.nan, math.nan,
        )  # fmt: skip

    def attitude_quaternion(self) -> Message:
        """ATTITUDE_QUATERNION, from the body to north, east and down."""
        body = self._ap.body
        roll, pitch = body.estimated_roll_pitch
        attitude = Quaternion.from_euler(roll, pitch, body.heading)
        return mav.MAVLink_attitude_quaternion_message(
            self.boot_ms, *attitude, 0.0, 0.0, body.yaw_rate
        )

    def global_position_int(self) -> Packed | None:
        """GLOBAL_POSITION_INT, once home is known."""
        return super().global_position_int() if self._ap.home_known else None
