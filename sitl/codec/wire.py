"""Bytes to messages and back: frames of MAVLink 2 (and 1, when received)."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any, Final, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as mav

# pymavlink carries no types; this is the one name for its messages
Message: TypeAlias = Any
# a payload that needs no message object: message id, CRC_EXTRA, the fields
Packed: TypeAlias = tuple[int, int, bytes]

_V1, _V2 = mav.PROTOCOL_MARKER_V1, mav.PROTOCOL_MARKER_V2
_BYTES = [bytes((value,)) for value in range(256)]
# behind the marker: size, both flags, sequence, system and component, message id
_head = struct.Struct("<BHBHHB").pack


def _x25(data: bytes) -> int:
    crc: int = mav.x25crc(data).crc
    return crc


# pymavlink's own C function, which it may come without
_checksum: Callable[[bytes], int] = getattr(mav, "mcrf4xx", None) or _x25


class Packer:
    """Frames of one component, numbered in sequence."""

    def __init__(self, system_id: int, component_id: int) -> None:
        self._address = system_id | component_id << 8
        self._sequence = 0
        self._message_id = 0

    def pack(self, message: Message) -> bytes:
        """The frame of a message or `Packed`, with this address and the next sequence number."""
        if type(message) is tuple:
            return self._frame(*message)
        # pymavlink lays out the payload and hands it to its `_pack`, which is several times
        # slower than `_frame`
        self._message_id = type(message).id  # some messages have a field of that name
        message._pack = self._take
        packed: bytes = message.pack(None)
        del message._pack
        return packed

    def _take(self, _: object, crc_extra: int, payload: bytes, **__: object) -> bytes:
        return self._frame(self._message_id, crc_extra, payload)

    def _frame(self, message_id: int, crc_extra: int, payload: bytes) -> bytes:
        payload = payload.rstrip(b"\0") or b"\0"
        sequence = self._sequence
        self._sequence = (sequence + 1) & 0xFF
        body = _head(
            len(payload), 0, sequence, self._address, message_id & 0xFFFF, message_id >> 16
        )
        body += payload
        return b"\xfd" + body + _checksum(body + _BYTES[crc_extra]).to_bytes(2, "little")


EVENT: Final = 410
CURRENT_MODE: Final = 436
CRC_EXTRA_OF_OTHERS: Final = {EVENT: 160, CURRENT_MODE: 193}
"""Of messages that vehicles here send and the dialect does not know."""


def crc_extra_of(message_id: int) -> int:
    """What goes into the checksum of a kind of message."""
    known = CRC_EXTRA_OF_OTHERS.get(message_id)
    return int(mav.mavlink_map[message_id].crc_extra) if known is None else known


class Cutter:
    """Cuts a stream into pieces that are, as far as headers tell, a frame each.

    No checksum is looked at; what stands between frames is a piece of its own. It is what a radio
    sends at once, so that a loss takes whole frames.
    """

    def __init__(self) -> None:
        self._rest = b""

    @property
    def empty(self) -> bool:
        """No piece is unfinished."""
        return not self._rest

    def feed(self, data: bytes) -> list[bytes]:
        """The pieces completed by `data`."""
        data = self._rest + data
        pieces, at = [], 0
        while at < len(data):
            if data[at] in (_V1, _V2):
                size = _frame_size(data, at)
                if size is None or at + size > len(data):
                    break
                end = at + size
            else:
                ends = [end for end in (data.find(_V1, at), data.find(_V2, at)) if end >= 0]
                end = min(ends, default=len(data))
            pieces.append(data[at:end])
            at = end
        self._rest = data[at:]
        return pieces


def cut(frames: bytes) -> list[bytes]:
    """The frames of bytes that begin with a frame and hold only whole ones."""
    return Cutter().feed(frames)


class Framer:
    """Cuts received bytes into messages; what is no frame is passed over.

    A frame with a wrong checksum costs its own first byte only, so a good frame behind it is
    found again. At most one unfinished frame is kept.
    """

    def __init__(self) -> None:
        self._decoder = mav.MAVLink(None)
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Message]:
        """Messages completed by `data`."""
        buffer = self._buffer
        buffer += data
        messages: list[Message] = []
        at = 0
        while at < len(buffer):
            marker = buffer[at]
            if marker not in (_V1, _V2):
                at += 1
                continue
            size = _frame_size(buffer, at)
            if size is None or at + size > len(buffer):
                break
            message = self._decode(buffer[at : at + size])
            if message is None:
                at += 1
                continue
            at += size
            if message.get_msgId() >= 0:
                messages.append(message)
        del buffer[:at]
        return messages

    def _decode(self, frame: bytearray) -> Message | None:
        if frame[0] == _V2 and frame[2] & ~mav.MAVLINK_IFLAG_SIGNED:
            return None
        try:
            return self._decoder.decode(frame)
        except mav.MAVError:
            return None


def _frame_size(buffer: bytes | bytearray, at: int) -> int | None:
    """Length of the frame that begins at `at`, None while its header is incomplete."""
    if len(buffer) - at < 3:
        return None
    payload = buffer[at + 1]
    if buffer[at] == _V1:
        return payload + 8
    signature = 13 if buffer[at + 2] & mav.MAVLINK_IFLAG_SIGNED else 0
    return payload + 12 + signature
