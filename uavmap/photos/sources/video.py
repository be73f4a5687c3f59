"""A video with its telemetry, DJI's captions or an autopilot's log: one picture a second.

An SRT file of captions has a block of text for each frame or second:

    [latitude: 46.84] [longitude: -91.99] [rel_alt: 40.1 abs_alt: 198.6] [gb_yaw: 45.0 ...]
    GPS(-91.9945,46.8426,17) BAROMETER:40.1
    GPS (-91.9945, 46.8426, 17), D 24.26m, H 40.10m, ...

Newer models write the first kind (older firmware misspells it longtitude). The Mavic Pro and the
Phantom write the others, longitude first.
"""

from __future__ import annotations

import hashlib
import math
import re
import struct
import threading
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import ImageError
from missions.units import LatLon
from uavmap.photos.sources.photo_file import Pixels, reduced, text_beside
from uavmap.photos.sources.photo_tags import film_lens
from uavmap.photos.sources.picture_record import Picture, Refused
from vision.registration.views import Measured

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
    """The values of a block; None for a missing one. Times are seconds from the video's start.

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
    """Return the moment nearest to a time, of at least one."""
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
            system = sender  # a gimbal's own aircraft is not known yet
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
    """Return the length of the frame that begins here; None if there is none."""
    if data[at] == _V1:
        return data[at + 1] + 8
    if data[at] == _V2:
        return data[at + 1] + 12 + (13 if data[at + 2] & 1 else 0)
    return None


def _message_id(data: bytes, at: int) -> int:
    if data[at] == _V1:
        return data[at + 5]
    return int.from_bytes(data[at + 7 : at + 10], "little")


# --- the pictures --------------------------------------------------------------------------------
EVERY_S: Final = 1.0
"""Time between frames, s: a video from a stand-still adds no evidence beyond one frame."""
_AHEAD: Final = 4  # kept frames that were passed for another thread's later one
_POSITION_SIGMA_M: Final = 5.0
_LARGEST_SIDE: Final = 10_000
_LONGEST_FRAMES: Final = 10_000_000


@dataclass(slots=True)
class Video:
    """The frames of a video at an interval of `EVERY_S`, with the telemetry of the file beside it.

    `start_utc_s`, in seconds since 1970, ties the video to a .tlog. Raises `ImageError` on creation
    if the video or the telemetry cannot be read.
    """

    path: Path
    start_utc_s: float | None = None
    _moments: tuple[Moment, ...] = field(init=False, repr=False)
    _reader: _Reader = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._moments = self._telemetry()
        self._reader = _Reader(self.path)

    def _telemetry(self) -> tuple[Moment, ...]:
        """Return the moments beside the video, in seconds from its start."""
        beside = {path.suffix.lower(): path for path in self.path.parent.glob("*.*")
                  if path.stem == self.path.stem and path.is_file()}  # fmt: skip
        if ".srt" in beside:
            return read_srt(beside[".srt"])
        if ".tlog" not in beside:
            raise ImageError(
                f"{self.path}: no {self.path.stem}.SRT (a DJI's captions) and no "
                f"{self.path.stem}.tlog beside it; one of them gives the position of each frame"
            )
        if self.start_utc_s is None:
            raise ImageError(
                f"{self.path}: when did the recording begin? Its .tlog has times of day; give "
                "--video-start 2024-05-01T10:11:12Z"
            )
        start_s = self.start_utc_s
        logged = read_tlog(beside[".tlog"])
        return tuple(replace(moment, t_s=moment.t_s - start_s) for moment in logged)

    def pictures(self) -> Iterator[Picture | Refused]:
        """See `uavmap.photos.sources.picture_record.PictureSource`."""
        reader = self._reader
        for index in range(0, reader.count, reader.step):
            t_s = index / reader.frames_s
            moment = nearest(self._moments, t_s)
            name = f"{self.path.name}#{index}"
            if abs(moment.t_s - t_s) > EVERY_S + 1.0:
                yield Refused(name, f"no telemetry of it (the nearest is of {moment.t_s:.1f} s)")
                continue
            yield self._picture(name, index, t_s, moment)

    def left_out(self) -> tuple[str, ...]:
        """See `uavmap.photos.sources.picture_record.PictureSource`."""
        return ()

    def _picture(self, name: str, index: int, t_s: float, moment: Moment) -> Picture:
        reader = self._reader
        size = (reader.width_px, reader.height_px)
        return Picture(
            name,
            VideoFrame(reader, index),
            *size,
            taken_s=t_s,
            clock="relative",
            position=moment.position,
            position_sigma_m=_POSITION_SIGMA_M,
            height_m=_measured(moment.height_m, 2.0),
            amsl_m=_measured(moment.amsl_m, 10.0),
            yaw_deg=_measured(None if moment.yaw_deg is None else moment.yaw_deg % 360.0, 5.0),
            pitch_deg=_measured(moment.pitch_deg, 1.0),
            roll_deg=_measured(moment.roll_deg, 1.0),
            lens=None if moment.film_mm is None else film_lens(moment.film_mm, *size),
            lens_from="" if moment.film_mm is None else "the captions of the video",
        )


def _measured(value: float | None, sigma: float) -> Measured | None:
    return None if value is None else Measured(value, sigma)


@dataclass(frozen=True, slots=True)
class VideoFrame:
    """The pixels of a frame."""

    reader: _Reader
    index: int

    @property
    def size_bytes(self) -> int:
        """Number of the frame, which distinguishes it: frames have no files."""
        return self.index

    def digest(self) -> str:
        """See `uavmap.photos.sources.picture_record.Content`."""
        return hashlib.sha256(f"{self.reader.path.name}#{self.index}".encode()).hexdigest()

    def decode(self, max_width_px: int) -> Pixels:
        """See `uavmap.photos.sources.picture_record.Content`."""
        return reduced(self.reader.frame(self.index), max_width_px)


class _Reader:
    """A video that is read forwards; a request for an earlier frame begins it again."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()
        self._passed: dict[int, NDArray[np.uint8]] = {}
        self._next = 0
        self._video = self._opened()
        get = self._video.get
        self.width_px = round(get(cv2.CAP_PROP_FRAME_WIDTH))
        self.height_px = round(get(cv2.CAP_PROP_FRAME_HEIGHT))
        self.frames_s = get(cv2.CAP_PROP_FPS)
        self.count = round(get(cv2.CAP_PROP_FRAME_COUNT))
        sides = (self.width_px, self.height_px)
        plain = all(1 <= side <= _LARGEST_SIDE for side in sides)
        rate = math.isfinite(self.frames_s) and 0.1 < self.frames_s < 1000.0
        if not (plain and rate and 0 < self.count <= _LONGEST_FRAMES):
            raise ImageError(f"{path}: not a readable video")
        self.step = max(1, round(self.frames_s * EVERY_S))

    def frame(self, index: int) -> NDArray[np.uint8]:
        """Return a frame by its number from 0. Raises `ImageError` if it cannot be decoded."""
        with self._lock:
            if index in self._passed:
                return self._passed.pop(index)
            if index < self._next:
                self._video.release()
                self._video, self._next = self._opened(), 0
            while self._next < index:
                if not self._video.grab():
                    raise ImageError(f"the video ends at frame {self._next}")
                self._keep_requested()
                self._next += 1
            good, image = self._video.read()
            self._next += 1
            if not good or image is None:
                raise ImageError("the frame cannot be decoded")
            return np.asarray(image, dtype=np.uint8)

    def _keep_requested(self) -> None:
        """Keep passed frames that another thread is about to request."""
        if self._next % self.step:
            return
        good, image = self._video.retrieve()
        if good and image is not None:
            self._passed[self._next] = np.asarray(image, dtype=np.uint8)
            while len(self._passed) > _AHEAD:
                del self._passed[min(self._passed)]

    def _opened(self) -> cv2.VideoCapture:
        video = cv2.VideoCapture(str(self.path))
        if not video.isOpened():
            raise ImageError(f"{self.path}: not a readable video")
        return video
