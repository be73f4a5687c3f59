"""MAVLink frames as bytes: cut from a stream, unchanged, with their addresses and losses.

For frames that are passed on without decoding: of other dialects, and signed ones.
"""

from __future__ import annotations

import functools
import struct
from dataclasses import dataclass, field
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

Message = Any  # pymavlink carries no types

_GAP: Final = 128
"""Gap of numbers from which on a frame came late or its sender restarted: numbers have a byte."""


@dataclass(slots=True)
class Losses:
    """Counts of received and missing frames, by (system, component) that sent them."""

    frames: dict[tuple[int, int], int] = field(default_factory=dict)
    missing: dict[tuple[int, int], int] = field(default_factory=dict)
    _last: dict[tuple[int, int], int] = field(default_factory=dict)

    def count(self, message: Message) -> None:
        """Count a frame of any kind."""
        sender = message.get_srcSystem(), message.get_srcComponent()
        sequence = message.get_seq()
        last = self._last.get(sender)
        self.frames[sender] = self.frames.get(sender, 0) + 1
        gap = 0 if last is None else (sequence - last - 1) % 256
        if gap >= _GAP:  # overtaken on its way: it was counted as missing
            self.missing[sender] = max(self.missing.get(sender, 0) - 1, 0)
            return
        self.missing[sender] = self.missing.get(sender, 0) + gap
        self._last[sender] = sequence

    def counts(self, sender: tuple[int, int]) -> tuple[int, int]:
        """Return the number of received frames of a sender, and of missing numbers."""
        return self.frames.get(sender, 0), self.missing.get(sender, 0)


_V2, _V1 = mav.PROTOCOL_MARKER_V2, mav.PROTOCOL_MARKER_V1
_MARKS: Final = (_V1, _V2)
_MAX_KEPT: Final = 2 * 280
_SIGNATURE_BYTES: Final = 13


def length_of(data: bytes | bytearray, at: int = 0) -> int:
    """Return the length of the frame that begins there; 0 if it is not known yet."""
    if len(data) - at < 3:
        return 0
    if data[at] == _V1:
        return 8 + data[at + 1]
    return 12 + data[at + 1] + (_SIGNATURE_BYTES if data[at + 2] & mav.MAVLINK_IFLAG_SIGNED else 0)


class Splitter:
    """Cuts a stream into whole frames; other bytes are skipped.

    Bytes are a frame if another begins behind it, nothing follows, or its checksum is right.
    """

    def __init__(self) -> None:
        self._kept = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        """Return the frames that are whole now."""
        buffer = self._kept
        buffer += data
        found: list[bytes] = []
        at = 0
        while at < len(buffer):
            if buffer[at] not in _MARKS:
                at += 1
                continue
            length = length_of(buffer, at)
            end = at + length
            if not length or end > len(buffer):
                break
            frame = bytes(buffer[at:end])
            if end == len(buffer) or buffer[end] in _MARKS or _checks(frame):
                found.append(frame)
                at = end
            else:
                at += 1
        del buffer[:at]
        if len(buffer) > _MAX_KEPT:
            buffer.clear()
        return found


def sender_of(frame: bytes) -> tuple[int, int]:
    """Return system and component that sent a frame."""
    return (frame[3], frame[4]) if frame[0] == _V1 else (frame[5], frame[6])


def message_id_of(frame: bytes) -> int:
    """Return the kind of message in a frame."""
    return frame[5] if frame[0] == _V1 else int.from_bytes(frame[7:10], "little")


def target_of(frame: bytes) -> int:
    """Return the target system of a frame; 0 for all, or if it is not known."""
    offset = _target_offset(message_id_of(frame))
    begin = 6 if frame[0] == _V1 else 10
    if offset is None or offset >= frame[1]:  # zeros at the end are not sent
        return 0
    return frame[begin + offset]


@functools.cache
def _target_offset(message_id: int) -> int | None:
    """Return the offset of the target system in the payload of a kind of message."""
    kind = mav.mavlink_map.get(message_id)
    if kind is None or "target_system" not in kind.ordered_fieldnames:
        return None
    index = kind.ordered_fieldnames.index("target_system")
    letters = kind.native_format.decode("ascii").lstrip("<")
    sizes: list[int] = [
        struct.calcsize(f"<{letter}") * max(count, 1)
        for letter, count in zip(letters, kind.array_lengths, strict=True)
    ]
    return sum(sizes[:index])


def _checks(frame: bytes) -> bool:
    """Return whether the checksum of a frame is right; False for an unknown kind."""
    kind = mav.mavlink_map.get(message_id_of(frame))
    if kind is None:
        return False
    end = (8 if frame[0] == _V1 else 12) + frame[1] - 2
    crc: int = mav.x25crc(frame[1:end] + bytes([kind.crc_extra])).crc
    return crc == int.from_bytes(frame[end : end + 2], "little")
