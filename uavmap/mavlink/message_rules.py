"""What is possible in a message: a row for each kind that somebody reads.

A row names who may say such a thing of a vehicle, and the range of each field that is read, in
the message's own units. A NaN is in no range. What has to fit the message before, and not only
itself, is in `uavmap.mavlink.continuity`. A kind without a row is read by nobody: who begins to
read one adds its row here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from uavmap.mavlink import dialect as _dialect  # noqa: F401 - the parser needs its messages

Message = Any  # pymavlink carries no types


class Sender(Enum):
    """Which component of a vehicle may say it."""

    AUTOPILOT = "the autopilot"
    CAMERA = "the camera"
    ANY = "any component"


@dataclass(frozen=True, slots=True)
class Limit:
    """The range of a field, ends included; of each element where the field is an array."""

    field: str
    low: float
    high: float

    def holds(self, message: Message) -> bool:
        """Whether the message keeps to it."""
        value = getattr(message, self.field)
        values = value if isinstance(value, list | tuple) else (value,)
        return all(self.low <= number <= self.high for number in values)


@dataclass(frozen=True, slots=True)
class Rule:
    """What a kind of message has to keep to; `check` tells what is wrong with the whole of it."""

    sender: Sender
    limits: tuple[Limit, ...] = ()
    check: Callable[[Message], str | None] = lambda message: None

    def fault(self, message: Message) -> str | None:
        """What is wrong with a message by itself."""
        for limit in self.limits:
            if not limit.holds(message):
                return f"{limit.field} is out of range"
        return self.check(message)


UNIT_TOLERANCE: Final = 0.02
NO_FIX: Final = "no position yet"
"""The reason for zeros, which an ArduPilot sends before its first fix; it is not told."""

_LOWEST_M, _HIGHEST_M = -500.0, 10_000.0
_TURN = 2.0 * math.pi + 0.01
_ARDUPILOT_MODES = 255
_LARGEST_PARAMETER = 1e9
_MOST_ITEMS = 65_534


def unit_fault(w: float, x: float, y: float, z: float) -> str | None:
    """What is wrong with a quaternion that should tell an attitude.

    >>> unit_fault(0.0, 0.0, 0.0, 0.0)
    'the quaternion is all zero'
    """
    if not all(map(math.isfinite, (w, x, y, z))):
        return "the quaternion is not finite"
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if length == 0.0:
        return "the quaternion is all zero"
    if abs(length - 1.0) > UNIT_TOLERANCE:
        return "the quaternion is not of unit length"
    return None


def _heartbeat(message: Message) -> str | None:
    if message.type not in mav.enums["MAV_TYPE"]:
        return "no such type of vehicle"
    if message.autopilot not in mav.enums["MAV_AUTOPILOT"]:
        return "no such autopilot"
    mode = message.custom_mode
    if message.autopilot == mav.MAV_AUTOPILOT_ARDUPILOTMEGA and mode > _ARDUPILOT_MODES:
        return "no such mode"
    # PX4: the main mode in the third byte, the sub-mode in the fourth
    if message.autopilot == mav.MAV_AUTOPILOT_PX4 and (mode & 0xFFFF or mode >> 16 & 0xFF == 0):
        return "no such mode"
    return None


def _current_mode(message: Message) -> str | None:
    """A PX4 sends main modes and sub-modes, an ArduPilot numbers."""
    modes = message.custom_mode, message.intended_custom_mode
    if any(mode > _ARDUPILOT_MODES and mode & 0xFFFF for mode in modes):
        return "no such mode"
    return None


def _place(message: Message) -> str | None:
    return NO_FIX if message.lat == message.lon == 0 else None


def _home(message: Message) -> str | None:
    return NO_FIX if message.latitude == message.longitude == 0 else None


def _attitude_quaternion(message: Message) -> str | None:
    return unit_fault(message.q1, message.q2, message.q3, message.q4)


def _parameter(message: Message) -> str | None:
    """A float is a number; what an integer's four bytes make as a float may be anything."""
    real = message.param_type in (mav.MAV_PARAM_TYPE_REAL32, mav.MAV_PARAM_TYPE_REAL64)
    if real and not abs(message.param_value) <= _LARGEST_PARAMETER:
        return "param_value is out of range"
    return None


def _degrees(latitude: str, longitude: str) -> tuple[Limit, Limit]:
    return Limit(latitude, -90e7, 90e7), Limit(longitude, -180e7, 180e7)


def _height(field: str) -> Limit:
    return Limit(field, _LOWEST_M * 1e3, _HIGHEST_M * 1e3)


RULES: Final[Mapping[str, Rule]] = {
    "HEARTBEAT": Rule(Sender.ANY, (Limit("system_status", 0, 8),), _heartbeat),
    "CURRENT_MODE": Rule(Sender.AUTOPILOT, check=_current_mode),
    "EVENT": Rule(Sender.AUTOPILOT),
    "GLOBAL_POSITION_INT": Rule(
        Sender.AUTOPILOT,
        (
            *_degrees("lat", "lon"),
            _height("alt"),
            _height("relative_alt"),
            Limit("vx", -10_000, 10_000),
            Limit("vy", -10_000, 10_000),
            Limit("vz", -10_000, 10_000),
        ),
    ),
    "HOME_POSITION": Rule(
        Sender.AUTOPILOT, (*_degrees("latitude", "longitude"), _height("altitude")), _home
    ),
    "SYS_STATUS": Rule(Sender.AUTOPILOT, (Limit("battery_remaining", -1, 100),)),
    "BATTERY_STATUS": Rule(
        Sender.AUTOPILOT,
        (
            Limit("id", 0, 15),
            Limit("battery_remaining", -1, 100),
            # hectojoules: up to 100 kWh
            Limit("energy_consumed", -1, 3_600_000),
        ),
    ),
    "EXTENDED_SYS_STATE": Rule(Sender.AUTOPILOT, (Limit("landed_state", 0, 4),)),
    "EKF_STATUS_REPORT": Rule(Sender.AUTOPILOT),
    "ESTIMATOR_STATUS": Rule(Sender.AUTOPILOT),
    "ATTITUDE": Rule(
        Sender.AUTOPILOT,
        (Limit("roll", -_TURN, _TURN), Limit("pitch", -_TURN, _TURN), Limit("yaw", -_TURN, _TURN)),
    ),
    "ATTITUDE_QUATERNION": Rule(Sender.AUTOPILOT, check=_attitude_quaternion),
    "GPS_RAW_INT": Rule(Sender.AUTOPILOT, (*_degrees("lat", "lon"), Limit("fix_type", 0, 8))),
    "WIND": Rule(Sender.AUTOPILOT, (Limit("direction", -360, 360), Limit("speed", 0, 100))),
    "FENCE_STATUS": Rule(Sender.AUTOPILOT, (Limit("breach_status", 0, 1),)),
    "AUTOPILOT_VERSION": Rule(Sender.AUTOPILOT),
    "PARAM_VALUE": Rule(Sender.AUTOPILOT, check=_parameter),
    "TIMESYNC": Rule(Sender.ANY),  # who asked knows its own time again
    "TERRAIN_REPORT": Rule(
        Sender.AUTOPILOT, (*_degrees("lat", "lon"), Limit("terrain_height", -500, 9000))
    ),
    "MISSION_COUNT": Rule(Sender.AUTOPILOT, (Limit("count", 0, _MOST_ITEMS),)),
    "MISSION_REQUEST": Rule(Sender.AUTOPILOT, (Limit("seq", 0, _MOST_ITEMS),)),
    "MISSION_REQUEST_INT": Rule(Sender.AUTOPILOT, (Limit("seq", 0, _MOST_ITEMS),)),
    "MISSION_ITEM_INT": Rule(Sender.AUTOPILOT, (Limit("seq", 0, _MOST_ITEMS),)),
    "MISSION_ACK": Rule(Sender.AUTOPILOT),
    "STATUSTEXT": Rule(Sender.ANY, (Limit("severity", 0, 7),)),
    "FILE_TRANSFER_PROTOCOL": Rule(Sender.ANY),  # the client knows whom it has asked
    "COMMAND_ACK": Rule(Sender.ANY),  # the session knows whom it has asked
    # a pose that makes no sense costs the picture and is told there
    # (`uavmap.aircraft.cameras.pose`)
    "CAMERA_IMAGE_CAPTURED": Rule(Sender.CAMERA, (Limit("image_index", 0, 2**31 - 1),)),
    "CAMERA_FEEDBACK": Rule(
        Sender.AUTOPILOT,
        (
            *_degrees("lat", "lng"),
            Limit("alt_rel", _LOWEST_M, _HIGHEST_M),
            Limit("roll", -360, 360),
            Limit("pitch", -360, 360),
            Limit("yaw", -360, 360),
        ),
    ),
    "CAMERA_CAPTURE_STATUS": Rule(
        Sender.CAMERA, (Limit("image_status", 0, 3), Limit("image_interval", 0, 86_400))
    ),
    "CAMERA_INFORMATION": Rule(Sender.CAMERA),
    "CAMERA_SETTINGS": Rule(Sender.CAMERA),
}


def place_fault(message: Message) -> str | None:
    """Whether a position message says that there is no position yet.

    Apart from `RULES`, since the clock of such a message is right.
    """
    return _place(message)
