"""EVENT (410): what a PX4 says where it takes nobody for a ground station; not in our dialect.

An event is a number, a hash of its name, with arguments; its words are in a file that belongs to
the firmware, which is not here. Those of failsafes are known here by their names. Of the others
the number is told: with it the event is found in QGroundControl or in the flight's log.
"""

from __future__ import annotations

import struct
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from uavmap.mavlink.status_texts import Text

EVENT_ID: Final = 410
_CRC_EXTRA: Final = 160
_HEAD: Final = struct.Struct("<IIHBBB")
"""Number, time since boot (ms), sequence, destination (component, system), levels."""


def number_of(name: str) -> int:
    """The number of an event: 24 bits of FNV-1a, without the component that tells it.

    >>> hex(number_of("commander_armed_by"))
    '0x90caf3'
    """
    value = 0x811C9DC5
    for byte in name.encode("ascii"):
        value = (value ^ byte) * 0x01000193 & 0xFFFFFFFF
    return value & 0xFFFFFF


_WORDS: Final = {
    number_of(f"commander_failsafe_enter{name}"): words
    for name, words in (
        ("", "Failsafe activated"),
        ("_hold", "Failsafe activated: holding first"),
        ("_generic", "Failsafe activated"),
        ("_generic_hold", "Failsafe activated: holding first"),
        ("_generic_warn", "Failsafe warning"),
        ("_warn", "Failsafe warning"),
        ("_low_bat", "Low battery level, return advised"),
        ("_crit_bat_warn", "Critical battery level, land now"),
        ("_crit_low_bat_warn", "Emergency battery level, land immediately"),
        ("_low_flight_time_warn", "Low remaining flight time, return advised"),
    )
}


def event_text(frame: bytes) -> Text | None:
    """The event in a frame of MAVLink 2, as far as it can be told; None where it is none.

    >>> event_text(b"\\xfd\\x00")
    """
    if len(frame) < mav.HEADER_LEN_V2 + 2 or int.from_bytes(frame[7:10], "little") != EVENT_ID:
        return None
    end = mav.HEADER_LEN_V2 + frame[1]
    crc = mav.x25crc(frame[1:end] + bytes([_CRC_EXTRA])).crc
    if crc != int.from_bytes(frame[end : end + 2], "little"):
        return None
    payload = frame[mav.HEADER_LEN_V2 : end].ljust(_HEAD.size, b"\0")
    number, _, _, _, _, levels = _HEAD.unpack_from(payload)
    known = _WORDS.get(number & 0xFFFFFF, "its words are known to QGroundControl, not here")
    words = f"event {number:#010x}: {known}"
    return Text(levels & 0x0F, words)
