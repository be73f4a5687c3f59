"""The gate: every message of a vehicle passes it before any other code sees it.

`RULES` has a row for each kind of message that is read. It is the allowed sender, and the range of
each field that is read, in the message's own units. A NaN is in no range. A kind without a row is
not read. Checks against earlier messages are in `uavmap.mavlink.continuity`.

A refused message changes nothing. It is counted by kind and reason, and logged at most once in ten
seconds a kind.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from uavmap.mavlink.continuity import OLDER, BootClock, CameraClock, Fix, Track, distance_m

Message = Any  # pymavlink carries no types


class Sender(Enum):
    """The component of a vehicle that may send a message."""

    AUTOPILOT = "the autopilot"
    CAMERA = "the camera"
    ANY = "any component"


@dataclass(frozen=True, slots=True)
class Limit:
    """The range of a field, ends included."""

    field: str
    low: float
    high: float

    def holds(self, message: Message) -> bool:
        """Return whether the message is in the range."""
        in_range: bool = self.low <= getattr(message, self.field) <= self.high
        return in_range


@dataclass(frozen=True, slots=True)
class Rule:
    """The rule for a kind of message; `check` returns the fault of the whole message."""

    sender: Sender
    limits: tuple[Limit, ...] = ()
    check: Callable[[Message], str | None] = lambda message: None

    def fault(self, message: Message) -> str | None:
        """Return the fault of a message by itself."""
        for limit in self.limits:
            if not limit.holds(message):
                return f"{limit.field} is out of range"
        return self.check(message)


UNIT_TOLERANCE: Final = 0.02
NO_FIX: Final = "no position yet"
"""Reason for zeros, which an ArduPilot sends before its first fix; it is not logged."""

_LOWEST_M, _HIGHEST_M = -500.0, 10_000.0
_TURN = 2.0 * math.pi + 0.01
_ARDUPILOT_MODES = 255
_LARGEST_PARAMETER = 1e9
_MAX_ITEMS = 65_534


def unit_fault(w: float, x: float, y: float, z: float) -> str | None:
    """Return the fault of a quaternion of an attitude; None for a unit one."""
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
    """Return a fault of the mode: a PX4 sends main modes and sub-modes, an ArduPilot numbers."""
    modes = message.custom_mode, message.intended_custom_mode
    if any(mode > _ARDUPILOT_MODES and mode & 0xFFFF for mode in modes):
        return "no such mode"
    return None


def _no_place(message: Message) -> str | None:
    """Return the reason for a missing place; apart from `RULES`, as such a message's clock is
    right."""
    return NO_FIX if message.lat == message.lon == 0 else None


def _home(message: Message) -> str | None:
    return NO_FIX if message.latitude == message.longitude == 0 else None


def _attitude_quaternion(message: Message) -> str | None:
    return unit_fault(message.q1, message.q2, message.q3, message.q4)


def _parameter(message: Message) -> str | None:
    """Return a fault of a parameter: a float is a number; an integer's bytes may be anything."""
    real = message.param_type in (mav.MAV_PARAM_TYPE_REAL32, mav.MAV_PARAM_TYPE_REAL64)
    if real and not abs(message.param_value) <= _LARGEST_PARAMETER:
        return "param_value is out of range"
    return None


def _degrees(latitude: str, longitude: str) -> tuple[Limit, Limit]:
    return Limit(latitude, -90e7, 90e7), Limit(longitude, -180e7, 180e7)


def _heights(*fields: str) -> tuple[Limit, ...]:
    return _each(*fields, low=_LOWEST_M * 1e3, high=_HIGHEST_M * 1e3)


def _each(*fields: str, low: float, high: float) -> tuple[Limit, ...]:
    return tuple(Limit(field, low, high) for field in fields)


RULES: Final[Mapping[str, Rule]] = {
    "HEARTBEAT": Rule(Sender.ANY, (Limit("system_status", 0, 8),), _heartbeat),
    "CURRENT_MODE": Rule(Sender.AUTOPILOT, check=_current_mode),
    "GLOBAL_POSITION_INT": Rule(
        Sender.AUTOPILOT,
        (
            *_degrees("lat", "lon"),
            *_heights("alt", "relative_alt"),
            *_each("vx", "vy", "vz", low=-10_000, high=10_000),
        ),
    ),
    "HOME_POSITION": Rule(
        Sender.AUTOPILOT, (*_degrees("latitude", "longitude"), *_heights("altitude")), _home
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
    "ATTITUDE": Rule(Sender.AUTOPILOT, _each("roll", "pitch", "yaw", low=-_TURN, high=_TURN)),
    "ATTITUDE_QUATERNION": Rule(Sender.AUTOPILOT, check=_attitude_quaternion),
    "GPS_RAW_INT": Rule(Sender.AUTOPILOT, (*_degrees("lat", "lon"), Limit("fix_type", 0, 8))),
    "WIND": Rule(Sender.AUTOPILOT, (Limit("direction", -360, 360), Limit("speed", 0, 100))),
    "FENCE_STATUS": Rule(Sender.AUTOPILOT, (Limit("breach_status", 0, 1),)),
    "PARAM_VALUE": Rule(Sender.AUTOPILOT, check=_parameter),
    # other faults in a report of another aircraft make it unknown, not unseen
    **dict.fromkeys(
        ("ADSB_VEHICLE", "UTM_GLOBAL_POSITION"),
        Rule(Sender.ANY, _degrees("lat", "lon"), _no_place),
    ),
    "OPEN_DRONE_ID_ARM_STATUS": Rule(Sender.ANY),  # of a module beside the autopilot
    "TIMESYNC": Rule(Sender.ANY),  # the requester recognises its own time
    "TERRAIN_REPORT": Rule(
        Sender.AUTOPILOT, (*_degrees("lat", "lon"), Limit("terrain_height", -500, 9000))
    ),
    "MISSION_COUNT": Rule(Sender.AUTOPILOT, (Limit("count", 0, _MAX_ITEMS),)),
    **dict.fromkeys(
        ("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ITEM_INT"),
        Rule(Sender.AUTOPILOT, (Limit("seq", 0, _MAX_ITEMS),)),
    ),
    **dict.fromkeys(
        ("AUTOPILOT_VERSION", "EKF_STATUS_REPORT", "ESTIMATOR_STATUS", "EVENT", "MISSION_ACK"),
        Rule(Sender.AUTOPILOT),
    ),
    "STATUSTEXT": Rule(Sender.ANY, (Limit("severity", 0, 7),)),
    "FILE_TRANSFER_PROTOCOL": Rule(Sender.ANY),  # the client knows its server
    "COMMAND_ACK": Rule(Sender.ANY),  # the session knows the component that it commanded
    # an invalid pose costs the picture and is reported there (`uavmap.aircraft.cameras.pose`)
    "CAMERA_IMAGE_CAPTURED": Rule(Sender.CAMERA, (Limit("image_index", 0, 2**31 - 1),)),
    "CAMERA_FEEDBACK": Rule(
        Sender.AUTOPILOT,
        (
            *_degrees("lat", "lng"),
            Limit("alt_rel", _LOWEST_M, _HIGHEST_M),
            *_each("roll", "pitch", "yaw", low=-360, high=360),
        ),
    ),
    "CAMERA_CAPTURE_STATUS": Rule(
        Sender.CAMERA, (Limit("image_status", 0, 3), Limit("image_interval", 0, 86_400))
    ),
    **dict.fromkeys(("CAMERA_INFORMATION", "CAMERA_SETTINGS"), Rule(Sender.CAMERA)),
}


LOG_INTERVAL_S: Final = 10.0
AREA_M: Final = 100_000.0
"""Distance from the mission beyond which no position is accepted, m."""
HOME_M: Final = 50_000.0
OVERTAKEN_S: Final = 2.0
"""Time after which a frame with a lower number is of a vehicle that restarted, s."""
OVERTAKEN: Final = "overtaken on its way"
_STATES: Final = frozenset({"HEARTBEAT", "CURRENT_MODE", "EXTENDED_SYS_STATE"})
"""Messages without a time of their own whose latest one counts."""
_EXPECTED: Final = (NO_FIX, OLDER, OVERTAKEN)
"""Reasons that are counted, but not logged."""


@dataclass(slots=True)
class Gate:
    """Refuses impossible messages, and logs them by `say`."""

    say: Callable[[str], None] = lambda text: None
    refused: Counter[tuple[str, str]] = field(default_factory=Counter)
    """Counts by (kind of message, reason). Reasons are of this program: there are few."""
    area: LatLon | None = None
    """Place of the mission, if known: positions far away are refused."""
    clock: BootClock = field(default_factory=BootClock)
    camera_clock: CameraClock = field(default_factory=CameraClock)
    track: Track = field(default_factory=Track)
    _logged_s: dict[str, float] = field(default_factory=dict)
    _numbers: dict[tuple[int, str], tuple[int, float]] = field(default_factory=dict)
    """Number of the latest frame, and its time, by component and kind."""

    def admits(self, message: Message, sender: frozenset[Sender], now_s: float) -> bool:
        """Return whether a message of our vehicle, from such a component, is accepted."""
        kind = message.get_type()
        rule = RULES.get(kind)
        if rule is None:
            return True
        fault = rule.fault(message) if rule.sender in sender else f"not sent by {rule.sender.value}"
        if fault is None and kind == "GLOBAL_POSITION_INT":
            fault = self._position_fault(message, now_s)
        elif fault is None and kind in _STATES and self._is_overtaken(message, now_s):
            fault = OVERTAKEN
        elif fault is None and kind == "HOME_POSITION":
            fault = self._home_fault(message)
        if fault is None:
            return True
        self.refuse(kind, fault, now_s)
        return False

    def refuse(self, kind: str, reason: str, now_s: float) -> None:
        """Count and log a refused message. `reason` holds no value of the message."""
        self.refused[kind, reason] += 1
        told_s = self._logged_s.get(kind, float("-inf"))
        if reason in _EXPECTED or now_s - told_s < LOG_INTERVAL_S:
            return
        self._logged_s[kind] = now_s
        count = self.refused[kind, reason]
        self.say(f"{kind} refused: {reason}" + (f" ({count} times by now)" if count > 1 else ""))

    def refuse_once(self, kind: str, reason: str) -> None:
        """Count a refused message, and log the first one only."""
        self.refused[kind, reason] += 1
        if self.refused[kind, reason] == 1:
            self.say(f"{kind} refused: {reason}; further ones are counted, and not logged")

    def figures(self) -> dict[str, int]:
        """Return the refused messages for a summary: "KIND: reason" and the count."""
        return {f"{kind}: {why}": count for (kind, why), count in sorted(self.refused.items())}

    def _position_fault(self, message: Message, now_s: float) -> str | None:
        boot_s = message.time_boot_ms / 1000.0
        reboots = self.clock.reboots
        fault = self.clock.add(boot_s, now_s) or _no_place(message)
        if self.clock.reboots != reboots:
            self.say("the vehicle's clock has begun anew: it has restarted")
        if fault is not None:
            return fault
        position = LatLon(message.lat / 1e7, message.lon / 1e7)
        if self.area is not None and distance_m(position, self.area) > AREA_M:
            return f"more than {AREA_M / 1000.0:g} km from the mission"
        jumps = self.track.jumps
        fault = self.track.add(
            Fix(
                position,
                message.alt / 1000.0,
                (message.alt - message.relative_alt) / 1000.0,
                now_s,
                boot_s,
            )
        )
        if self.track.jumps != jumps:
            self.say(
                f"the vehicle's position or height has jumped by {self.track.jumped_m:.0f} m and "
                "stays there: it is accepted now"
            )
        return fault

    def _is_overtaken(self, message: Message, now_s: float) -> bool:
        """Return whether a later one of its kind has come before."""
        key, number = (message.get_srcComponent(), message.get_type()), message.get_seq()
        last, received_s = self._numbers.get(key, (number, now_s))
        if now_s - received_s < OVERTAKEN_S and (number - last) % 256 >= 128:
            return True
        self._numbers[key] = number, now_s
        return False

    def _home_fault(self, message: Message) -> str | None:
        home = LatLon(message.latitude / 1e7, message.longitude / 1e7)
        near = self.track.last.position if self.track.last is not None else self.area
        if near is not None and distance_m(home, near) > HOME_M:
            return f"more than {HOME_M / 1000.0:g} km from the vehicle"
        return None
