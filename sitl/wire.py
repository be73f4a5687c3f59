"""Bytes to messages and back: frames of MAVLink 2 (and 1, when received)."""

from __future__ import annotations

from typing import Any, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as mav

# pymavlink carries no types; this is the one name for its messages
Message: TypeAlias = Any

_V1, _V2 = mav.PROTOCOL_MARKER_V1, mav.PROTOCOL_MARKER_V2


class Packer:
    """Frames of one component, numbered in sequence."""

    def __init__(self, system_id: int, component_id: int) -> None:
        self._link = mav.MAVLink(None, srcSystem=system_id, srcComponent=component_id)

    def pack(self, message: Message) -> bytes:
        """The bytes of a message, with this component's address and next sequence number."""
        frame: bytes = message.pack(self._link)
        self._link.seq = (self._link.seq + 1) & 0xFF
        return frame


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


def _frame_size(buffer: bytearray, at: int) -> int | None:
    """Length of the frame that begins at `at`, None while its header is incomplete."""
    if len(buffer) - at < 3:
        return None
    payload = buffer[at + 1]
    if buffer[at] == _V1:
        return payload + 8
    signature = 13 if buffer[at + 2] & mav.MAVLINK_IFLAG_SIGNED else 0
    return payload + 12 + signature
