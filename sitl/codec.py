"""Frames of MAVLink 2 from messages, and messages from frames of MAVLink 2 and 1."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from operator import itemgetter
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
    """The frames of one component, numbered in sequence."""

    def __init__(self, system_id: int, component_id: int) -> None:
        self._address = system_id | component_id << 8
        self._sequence = 0
        self._message_id = 0

    def pack(self, message: Message) -> bytes:
        """Return the frame of a message or `Packed`, with the next sequence number."""
        if type(message) is tuple:
            return self._frame(*message)
        # pymavlink lays out the payload and hands it to its `_pack`, which is several times
        # slower than `_frame`
        self._message_id = type(message).id  # some messages have a field of that name
        message._pack = self._add_crc
        packed: bytes = message.pack(None)
        del message._pack
        return packed

    def _add_crc(self, _: object, crc_extra: int, payload: bytes, **__: object) -> bytes:
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
"""CRC extras of messages that the simulated vehicles send and the dialect does not define."""


def crc_extra_of(message_id: int) -> int:
    """Return the CRC_EXTRA of a message id."""
    known = CRC_EXTRA_OF_OTHERS.get(message_id)
    return int(mav.mavlink_map[message_id].crc_extra) if known is None else known


class Cutter:
    """Cuts a stream into frames by their headers, without checksums.

    Bytes between frames are a piece of their own. A radio loses whole pieces.
    """

    def __init__(self) -> None:
        self._rest = b""

    @property
    def empty(self) -> bool:
        """True if no piece is unfinished."""
        return not self._rest

    def feed(self, data: bytes) -> list[bytes]:
        """Return the pieces completed by `data`."""
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
    """Return the frames of bytes that hold whole frames only."""
    return Cutter().feed(frames)


class Framer:
    """Decodes received bytes into messages; skips what is no frame.

    A frame with a wrong checksum costs its first byte only, so a good frame behind it is found. At
    most one unfinished frame is kept.
    """

    def __init__(self) -> None:
        self._decoder = mav.MAVLink(None)
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Message]:
        """Return the messages completed by `data`."""
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
    """Return the length of the frame at `at`, None while its header is incomplete."""
    if len(buffer) - at < 3:
        return None
    payload = buffer[at + 1]
    if buffer[at] == _V1:
        return payload + 8
    signature = 13 if buffer[at + 2] & mav.MAVLINK_IFLAG_SIGNED else 0
    return payload + 12 + signature


Pack: TypeAlias = Callable[..., Packed]


def layout(kind: Message, fields: int | None = None) -> Pack:
    """Return a function that packs messages of pymavlink's class `kind` as their `pack` does.

    It takes the values in the order of that class, arrays flat, a text as bytes. It raises
    `struct.error` for a value that does not fit. `fields`: it takes the first `fields` values, and
    the rest is zero. Raises `ValueError` unless the rest comes last in the payload, as extensions
    do.

    >>> pack = layout(mav.MAVLink_system_time_message)
    >>> pack(0, 1000)
    (2, 137, b'\\x00\\x00\\x00\\x00\\x00\\x00\\x00\\x00\\xe8\\x03\\x00\\x00')
    """
    names = kind.fieldnames[:fields]
    ordered = kind.ordered_fieldnames[: len(names)]
    if set(ordered) != set(names):
        raise ValueError(f"{kind.msgname}: other fields than the first {fields} begin its payload")
    codes = dict(
        zip(kind.ordered_fieldnames, re.findall(r"\d*[a-zA-Z]", kind.unpacker.format), strict=True)
    )
    places: dict[str, range] = {}
    count = 0
    for name in names:
        code = codes[name]
        values = 1 if code.endswith("s") else int(code[:-1] or 1)
        places[name] = range(count, count + values)
        count += values
    order = [at for name in ordered for at in places[name]]
    pack_fields = struct.Struct("<" + "".join(codes[name] for name in ordered)).pack
    message_id, crc_extra = kind.id, kind.crc_extra
    if order == list(range(count)):
        return lambda *values: (message_id, crc_extra, pack_fields(*values))
    arrange = itemgetter(*order)

    def pack(*values: float) -> Packed:
        if len(values) != count:
            raise struct.error(f"{kind.msgname} takes {count} values, not {len(values)}")
        return message_id, crc_extra, pack_fields(*arrange(values))

    return pack


def int16(value: float) -> int:
    """Round, and limit to the range of an int16_t."""
    rounded = round(value)
    return rounded if -0x8000 <= rounded <= 0x7FFF else 0x7FFF if rounded > 0 else -0x8000


def uint16(value: float) -> int:
    """Round, and limit to the range of a uint16_t."""
    rounded = round(value)
    return rounded if 0 <= rounded <= 0xFFFF else 0xFFFF if rounded > 0 else 0


def int32(value: float) -> int:
    """Round, and limit to the range of an int32_t."""
    rounded = round(value)
    if -0x80000000 <= rounded <= 0x7FFFFFFF:
        return rounded
    return 0x7FFFFFFF if rounded > 0 else -0x80000000


# what the telemetry sends; numbers count the fields before the extensions that stay zero
heartbeat = layout(mav.MAVLink_heartbeat_message)
sys_status = layout(mav.MAVLink_sys_status_message, 13)
battery_status = layout(mav.MAVLink_battery_status_message, 11)
system_time = layout(mav.MAVLink_system_time_message)
gps_raw_int = layout(mav.MAVLink_gps_raw_int_message, 13)
attitude = layout(mav.MAVLink_attitude_message)
local_position_ned = layout(mav.MAVLink_local_position_ned_message)
global_position_int = layout(mav.MAVLink_global_position_int_message)
mission_current = layout(mav.MAVLink_mission_current_message)
fence_status = layout(mav.MAVLink_fence_status_message, 4)
gps_global_origin = layout(mav.MAVLink_gps_global_origin_message, 3)
vfr_hud = layout(mav.MAVLink_vfr_hud_message)
position_target_global_int = layout(mav.MAVLink_position_target_global_int_message)
autopilot_version = layout(mav.MAVLink_autopilot_version_message, 11)
wind = layout(mav.MAVLink_wind_message)
ekf_status_report = layout(mav.MAVLink_ekf_status_report_message)
home_position = layout(mav.MAVLink_home_position_message)
extended_sys_state = layout(mav.MAVLink_extended_sys_state_message)
