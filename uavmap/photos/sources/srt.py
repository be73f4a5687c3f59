"""DJI's telemetry beside a video: an SRT file, a block of text for each frame or second.

    [latitude: 46.84] [longitude: -91.99] [rel_alt: 40.1 abs_alt: 198.6] [gb_yaw: 45.0 ...]
    GPS(-91.9945,46.8426,17) BAROMETER:40.1
    GPS (-91.9945, 46.8426, 17), D 24.26m, H 40.10m, ...

Newer models write the first kind (an older firmware misspells it longtitude), the Mavic Pro and the
Phantom the others, longitude first.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from missions.errors import ImageError
from missions.units import LatLon
from uavmap.base.text_files import read_text

LARGEST_BYTES: Final = 256 * 2**20
_TIME: Final = re.compile(r"(\d{1,3}):(\d\d):(\d\d)[,.](\d{1,3})\s*-->")
_NUMBER: Final = r"\s*[:=]?\s*([-+]?\d{1,9}(?:\.\d+)?)"
_WORDS: Final = {
    "lat": re.compile(r"\blatitude" + _NUMBER, re.IGNORECASE),
    "lon": re.compile(r"\blongt?itude" + _NUMBER, re.IGNORECASE),
    "height": re.compile(r"\b(?:rel_alt|BAROMETER)" + _NUMBER, re.IGNORECASE),
    "amsl": re.compile(r"\babs_alt" + _NUMBER, re.IGNORECASE),
    "yaw": re.compile(r"\b(?:gb|gimbal)_yaw" + _NUMBER, re.IGNORECASE),
    "pitch": re.compile(r"\b(?:gb|gimbal)_pitch" + _NUMBER, re.IGNORECASE),
    "roll": re.compile(r"\b(?:gb|gimbal)_roll" + _NUMBER, re.IGNORECASE),
    "film_mm": re.compile(r"\bfocal_len" + _NUMBER, re.IGNORECASE),
}
_PAIR: Final = re.compile(r"\bGPS\s*\(\s*([-+]?[\d.]+)\s*,\s*([-+]?[\d.]+)", re.IGNORECASE)
_OLD_HEIGHT: Final = re.compile(r",\s*H\s+([-+]?\d{1,9}(?:\.\d+)?)\s*m\b")


@dataclass(frozen=True, slots=True)
class Moment:
    """What a block says; None for what it does not. Times in seconds from the video's start."""

    t_s: float
    position: LatLon | None
    height_m: float | None
    amsl_m: float | None
    yaw_deg: float | None
    pitch_deg: float | None
    roll_deg: float | None
    film_mm: float | None
    """The 35 mm equivalent of the focal length."""


def read_srt(path: Path) -> tuple[Moment, ...]:
    """The moments of a file, in order. Raises `ImageError` where it holds no positions."""
    try:
        text = read_text(path, LARGEST_BYTES)
    except OSError as error:
        raise ImageError(f"{path}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError:
        raise ImageError(f"{path}: not a text file in UTF-8") from None
    moments = parse_srt(text)
    if not any(moment.position is not None for moment in moments):
        raise ImageError(f"{path}: no positions; was the recording of captions switched on?")
    return moments


def parse_srt(text: str) -> tuple[Moment, ...]:
    """The moments in the text of an SRT file, sorted by time.

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
    """The moment next to a time; one at least."""
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
    height = values["height"]
    if height is None and (old := _OLD_HEIGHT.search(text)):
        height = float(old.group(1))
    film_mm = values["film_mm"]
    if film_mm is not None and film_mm > 200.0:
        film_mm /= 10.0  # some models write tenths
    return Moment(
        hours * 3600.0 + minutes * 60.0 + seconds + fraction,
        _position(values["lat"], values["lon"], text),
        height,
        values["amsl"],
        values["yaw"],
        values["pitch"],
        values["roll"],
        film_mm,
    )


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
