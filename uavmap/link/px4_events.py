"""EVENT (410): what a PX4 says where it takes nobody for a ground station; not in our dialect.

An event is a number with arguments; its words are in a file that belongs to the firmware, which is
not here. So its number is told, and its level: with it the event is found in QGroundControl or in
the flight's log.
"""

from __future__ import annotations

import struct
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from uavmap.link.texts import Text

EVENT_ID: Final = 410
_CRC_EXTRA: Final = 160
_HEAD: Final = struct.Struct("<IIHBBB")
"""Number, time since boot (ms), sequence, destination (component, system), levels."""


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
    words = f"event {number:#010x}: its words are known to QGroundControl, not here"
    return Text(levels & 0x0F, words)
