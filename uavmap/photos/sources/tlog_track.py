"""Where an aircraft was, from a telemetry log (.tlog): the poses of a video without captions.

A log is frames of MAVLink, each behind its time in microseconds since 1970 (UTC, big endian).
Damaged bytes are passed over.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import ImageError
from missions.units import LatLon
from uavmap.photos.sources.srt import Moment

LARGEST_BYTES: Final = 2**31
_STAMP: Final = struct.Struct(">Q")
_V1, _V2 = 0xFE, 0xFD
_EARLIEST_US, _LATEST_US = 946_684_800_000_000, 4_102_444_800_000_000  # 2000 to 2100
_UNKNOWN_HEADING = 65535
_READ: Final = frozenset(
    {
        mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mav.MAVLINK_MSG_ID_MOUNT_ORIENTATION,
        mav.MAVLINK_MSG_ID_ATTITUDE,
    }
)


def read_tlog(path: Path) -> tuple[Moment, ...]:
    """The moments of a log, in order, with times in seconds since 1970.

    A moment is a position told; heading and the camera's pitch and roll are those last told by the
    same aircraft: the first that tells its position or attitude. Raises `ImageError` where there is
    none.
    """
    try:
        if path.stat().st_size > LARGEST_BYTES:
            raise ImageError(f"{path}: larger than {LARGEST_BYTES} bytes")
        data = path.read_bytes()
    except OSError as error:
        raise ImageError(f"{path}: cannot be read ({error.strerror})") from None
    moments = tuple(_moments(data))
    if not moments:
        raise ImageError(f"{path}: no positions (GLOBAL_POSITION_INT) in this log")
    return tuple(sorted(moments, key=lambda moment: moment.t_s))


def _moments(data: bytes) -> Iterator[Moment]:
    system: int | None = None
    yaw_deg: float | None = None
    pitch_deg: float | None = None
    roll_deg: float | None = None
    for t_s, message in _messages(data):
        kind, sender = message.get_type(), message.get_srcSystem()
        if system is None and kind in ("GLOBAL_POSITION_INT", "ATTITUDE"):
            system = sender  # of a gimbal nobody knows yet whose it is
        if sender != system:
            continue
        if kind == "ATTITUDE":
            yaw_deg = math.degrees(message.yaw) % 360.0
        elif kind == "MOUNT_ORIENTATION":
            pitch_deg, roll_deg = float(message.pitch), float(message.roll)
            if math.isfinite(message.yaw_absolute):
                yaw_deg = float(message.yaw_absolute) % 360.0
        else:
            heading = None if message.hdg == _UNKNOWN_HEADING else message.hdg / 100.0
            place = LatLon(message.lat / 1e7, message.lon / 1e7)
            height_m, amsl_m = message.relative_alt / 1000.0, message.alt / 1000.0
            turned = heading if yaw_deg is None else yaw_deg
            yield Moment(t_s, place, height_m, amsl_m, turned, pitch_deg, roll_deg, None)


def _messages(data: bytes) -> Iterator[tuple[float, Any]]:
    """The messages that are of use, each with its time."""
    codec = mav.MAVLink(None)
    codec.robust_parsing = True
    at, end = 0, len(data)
    while at + _STAMP.size + 12 <= end:
        frame = at + _STAMP.size
        (stamp_us,) = _STAMP.unpack_from(data, at)
        length = _length(data, frame)
        if length is None or not _EARLIEST_US < stamp_us < _LATEST_US or frame + length > end:
            at += 1
            continue
        at = frame + length
        if _message_id(data, frame) in _READ:
            try:
                message = codec.decode(bytearray(data[frame:at]))
            except mav.MAVError:
                continue
            yield stamp_us / 1e6, message


def _length(data: bytes, at: int) -> int | None:
    """How long the frame is that begins here, None where none does."""
    if data[at] == _V1:
        return data[at + 1] + 8
    if data[at] == _V2:
        return data[at + 1] + 12 + (13 if data[at + 2] & 1 else 0)
    return None


def _message_id(data: bytes, at: int) -> int:
    if data[at] == _V1:
        return data[at + 5]
    return int.from_bytes(data[at + 7 : at + 10], "little")
