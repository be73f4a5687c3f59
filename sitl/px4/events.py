"""EVENT (410): what a PX4 tells to everybody where its texts go to ground stations only.

The number of an event is a hash of its name; what it means is in metadata that comes with the
firmware. The ardupilotmega dialect does not know the message, so its payload is packed here.
"""

from __future__ import annotations

import struct

from sitl.codec.wire import EVENT, Packed, crc_extra_of

_AUTOPILOT = 1 << 24
# number, time, sequence; to component and system (all); the log levels
_LAYOUT = struct.Struct("<IIHBBB")

# by the beginning of the text that says the same
_NAMES = (
    ("Arming denied", "commander_arm_denied_resolve_failures"),
    ("Armed by", "commander_armed_by"),
    ("Disarmed by", "commander_disarmed_by"),
    ("Failsafe", "commander_failsafe_enter_generic"),
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

    def of(self, severity: int, text: str, t_s: float) -> Packed:
        """The event that says the same as a text."""
        name = next((name for begin, name in _NAMES if text.startswith(begin)), _OTHER)
        self._sequence = (self._sequence + 1) & 0xFFFF
        levels = severity & 0xF | (severity & 0xF) << 4
        boot_ms = round(t_s * 1000.0) & 0xFFFFFFFF
        payload = _LAYOUT.pack(number_of(name), boot_ms, self._sequence, 0, 0, levels)
        return EVENT, crc_extra_of(EVENT), payload
