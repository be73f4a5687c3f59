"""EVENT (410): what a PX4 tells to everybody where its texts go to ground stations only.

The text of every failsafe is the same; why it came is in the arguments of its event alone.

The number of an event is a hash of its name; what it means is in metadata that comes with the
firmware. The ardupilotmega dialect does not know the message, so its payload is packed here.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from enum import IntEnum

from sitl.codec import EVENT, Packed, crc_extra_of
from sitl.copter.aircraft import Notice
from sitl.px4.modes import Px4Mode

_AUTOPILOT = 1 << 24
_CRITICAL = 2
# number, time, sequence; to component and system (all); the log levels
_LAYOUT = struct.Struct("<IIHBBB")

# by the beginning of the text that says the same
_NAMES = (
    ("Arming denied", "commander_arm_denied_resolve_failures"),
    ("Armed by", "commander_armed_by"),
    ("Disarmed by", "commander_disarmed_by"),
)
_OTHER = "commander_other"


def number_of(name: str) -> int:
    """The number of an event: 24 bits of FNV-1a below the component that tells it.

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

    def of(self, notice: Notice, t_s: float) -> Packed:
        """The event that says the same as a text."""
        severity, text, name, arguments = notice
        name = name or next((name for begin, name in _NAMES if text.startswith(begin)), _OTHER)
        self._sequence = (self._sequence + 1) & 0xFFFF
        levels = severity & 0xF | (severity & 0xF) << 4
        boot_ms = round(t_s * 1000.0) & 0xFFFFFFFF
        payload = _LAYOUT.pack(number_of(name), boot_ms, self._sequence, 0, 0, levels)
        return EVENT, crc_extra_of(EVENT), payload + arguments


class Cause(IntEnum):
    """`failsafe_cause_t`: a lost stream, position or place inside the fence has no cause."""

    GENERIC = 0
    RADIO = 1
    STATION = 2
    LOW_BATTERY = 3
    CRITICAL_BATTERY = 4
    EMERGENCY_BATTERY = 5


MOTORS_OFF = -1
_ACTIONS: Mapping[int, int] = {
    Px4Mode.POSITION: 2, Px4Mode.ALTITUDE: 3, Px4Mode.STABILIZED: 4, Px4Mode.HOLD: 5,
    Px4Mode.RTL: 6, Px4Mode.LAND: 7, MOTORS_OFF: 10,
}  # fmt: skip
"""`failsafe_action_t`."""


def failsafe(intended: Px4Mode, action: int, cause: Cause, holds_s: float = 0.0) -> Notice:
    """A failsafe begins: one text for all of them, and an event that says why.

    Arguments (`failsafe/framework.cpp`, `notifyUser`): the mode that it was meant to be in, what
    it does, after how many seconds where it holds first, and the cause where there is one.

    >>> failsafe(Px4Mode.OFFBOARD, Px4Mode.RTL, Cause.GENERIC).text
    'Failsafe activated'
    """
    name, text = "commander_failsafe_enter", "Failsafe activated"
    arguments = struct.pack("<IB", int(intended), _ACTIONS[action])
    if cause == Cause.GENERIC:
        name += "_generic"
    if holds_s > 0.0:
        name, text = name + "_hold", f"{text}, entering Hold for {holds_s:.0f} seconds"
        arguments += struct.pack("<H", round(holds_s))
    if cause != Cause.GENERIC:
        arguments += struct.pack("<B", cause)
    return Notice(_CRITICAL, text, name, arguments)
