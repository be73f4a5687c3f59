"""The telemetry beside a video: DJI's captions, or an autopilot's log.

An SRT file has a block of text for each frame or second:

    [latitude: 46.84] [longitude: -91.99] [rel_alt: 40.1 abs_alt: 198.6] [gb_yaw: 45.0 ...]
    GPS(-91.9945,46.8426,17) BAROMETER:40.1
    GPS (-91.9945, 46.8426, 17), D 24.26m, H 40.10m, ...

Newer models write the first kind (an older firmware misspells it longtitude), the Mavic Pro and the
Phantom the others, longitude first.
"""

from __future__ import annotations

import math
import re
import struct
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import ImageError
from missions.units import LatLon
from uavmap.photos.sources.photo_file import text_beside

LARGEST_BYTES: Final = 256 * 2**20
_TIME: Final = re.compile(r"(\d{1,3}):(\d\d):(\d\d)[,.](\d{1,3})\s*-->")
_NUMBER: Final = r"\s*[:=]?\s*([-+]?\d{1,9}(?:\.\d+)?)"
_WORDS: Final = {
    key: re.compile(rf"\b{word}{_NUMBER}", re.IGNORECASE)
    for key, word in (
        ("lat", "latitude"),
        ("lon", "longt?itude"),
        ("height_m", "(?:rel_alt|BAROMETER)"),
        ("amsl_m", "abs_alt"),
        ("yaw_deg", "(?:gb|gimbal)_yaw"),
        ("pitch_deg", "(?:gb|gimbal)_pitch"),
        ("roll_deg", "(?:gb|gimbal)_roll"),
        ("film_mm", "focal_len"),
    )
}
_PAIR: Final = re.compile(r"\bGPS\s*\(\s*([-+]?[\d.]+)\s*,\s*([-+]?[\d.]+)", re.IGNORECASE)
_OLD_HEIGHT: Final = re.compile(r",\s*H\s+([-+]?\d{1,9}(?:\.\d+)?)\s*m\b")


@dataclass(frozen=True, slots=True)
class Moment:
    """The values of a block; None for what it lacks. Times in seconds from the video's start.

    `film_mm` is the 35 mm equivalent of the focal length.
    """

    t_s: float
    position: LatLon | None
    height_m: float | None
    amsl_m: float | None
    yaw_deg: float | None
    pitch_deg: float | None
    roll_deg: float | None
    film_mm: float | None


def read_srt(path: Path) -> tuple[Moment, ...]:
    """Return the moments of a file, in order. Raises `ImageError` if it holds no positions."""
    moments = parse_srt(text_beside(path, LARGEST_BYTES))
    if not any(moment.position is not None for moment in moments):
        raise ImageError(f"{path}: no positions; was the recording of captions switched on?")
    return moments


def parse_srt(text: str) -> tuple[Moment, ...]:
    """Return the moments in the text of an SRT file, sorted by time.

    >>> (moment,) = parse_srt("1\\n00:00:01,500 --> 00:00:02,000\\n[latitude: 46.5] [longitude: 7]")
    >>> moment.t_s, moment.position
    (1.5, LatLon(lat_deg=46.5, lon_deg=7.0))
    >>> parse_srt("no captions")
    ()
    """
    found = list(_TIME.finditer(text))
    starts = [match.start() for match in found]
    moments = [
        _moment(match, text[match.end() : end])
        for match, end in zip(found, [*starts[1:], len(text)], strict=False)  # maybe none at all
    ]
    return tuple(sorted(moments, key=lambda moment: moment.t_s))


def nearest(moments: Sequence[Moment], t_s: float) -> Moment:
    """Return the moment next to a time; at least one is given."""
    at = bisect_left(moments, t_s, key=lambda moment: moment.t_s)
    near = moments[max(0, at - 1) : at + 1] or moments[-1:]
    return min(near, key=lambda moment: abs(moment.t_s - t_s))


def _moment(time: re.Match[str], text: str) -> Moment:
    hours, minutes, seconds = (int(part) for part in time.groups()[:3])
    fraction = float(f"0.{time.group(4)}")
    values: dict[str, float | None] = {}
    for key, pattern in _WORDS.items():
        match = pattern.search(text)
        values[key] = None if match is None else float(match.group(1))
    if values["height_m"] is None and (old := _OLD_HEIGHT.search(text)):
        values["height_m"] = float(old.group(1))
    film_mm = values["film_mm"]
    if film_mm is not None and film_mm > 200.0:
        values["film_mm"] = film_mm / 10.0  # some models write tenths
    t_s = hours * 3600.0 + minutes * 60.0 + seconds + fraction
    place = _position(values.pop("lat"), values.pop("lon"), text)
    return Moment(t_s, place, **values)


def _position(lat: float | None, lon: float | None, text: str) -> LatLon | None:
    pair = _PAIR.search(text)
    if (lat is None or lon is None) and pair:
        try:
            lon, lat = float(pair.group(1)), float(pair.group(2))
        except ValueError:
            return None
    if lat is None or lon is None or not (abs(lat) <= 90.0 and abs(lon) <= 180.0):
        return None
    if math.hypot(lat, lon) == 0.0:
        return None  # no fix yet
    return LatLon(lat, lon)


_LARGEST_TLOG_BYTES: Final = 2**31
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
    """Return the moments of a log, in order, with times in seconds since 1970.

    A log (.tlog) is frames of MAVLink, each behind its time in microseconds since 1970 (UTC, big
    endian); damaged bytes are skipped. A moment is a reported position, with the last heading,
    pitch and roll of the same aircraft: the first that reports its position or attitude. Raises
    `ImageError` if there is none.
    """
    try:
        if path.stat().st_size > _LARGEST_TLOG_BYTES:
            raise ImageError(f"{path}: larger than {_LARGEST_TLOG_BYTES} bytes")
        moments = sorted(_moments(path.read_bytes()), key=lambda moment: moment.t_s)
    except OSError as error:
        raise ImageError(f"{path}: cannot be read ({error.strerror})") from None
    if not moments:
        raise ImageError(f"{path}: no positions (GLOBAL_POSITION_INT) in this log")
    return tuple(moments)


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
    """Yield the useful messages, each with its time."""
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
    """Return the length of the frame that begins here, None where none does."""
    if data[at] == _V1:
        return data[at + 1] + 8
    if data[at] == _V2:
        return data[at + 1] + 12 + (13 if data[at + 2] & 1 else 0)
    return None


def _message_id(data: bytes, at: int) -> int:
    if data[at] == _V1:
        return data[at + 5]
    return int.from_bytes(data[at + 7 : at + 10], "little")
