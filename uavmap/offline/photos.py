"""Recorded photographs: their geotags and their pixels, from disk.

Position comes from EXIF, height and angles from XMP (`drone-dji:*`, or `Camera:*` with
`drone-dji:RelativeAltitude`). A tag that is missing is an error that names it: a guessed height or
heading would put the map in the wrong place without a word.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from PIL import ExifTags

from missions.errors import ImageError
from missions.units import LatLon, Pose, Quaternion
from uavmap.pictures import opened

SUFFIXES = frozenset({".jpg", ".jpeg"})
"""The files of a folder that count as photographs, in any case."""

_FILM_WIDTH_MM = 36.0  # FocalLengthIn35mmFilm refers to a frame of this width
_DJI = "{http://www.dji.com/drone-dji/1.0/}"


@dataclass(frozen=True, slots=True)
class Photo:
    """A photograph on disk and what its tags say.

    `pose.height_m` is above the place of take-off. `taken_s` is in seconds since the first photo
    of the list. `hfov_rad` is the angle of view across the picture, from EXIF
    FocalLengthIn35mmFilm on a frame 36 mm wide, None where the tag is absent.
    """

    path: Path
    pose: Pose
    taken_s: float
    width_px: int
    height_px: int
    hfov_rad: float | None


def list_photos(folder: Path) -> list[Photo]:
    """The photographs of a folder, or the one file, by time of exposure and then by name.

    Raises `ImageError`, naming the file and the tag, for a photograph without a geotag, and for a
    path that is missing or holds no JPEG.
    """
    if folder.is_dir():
        paths = sorted(p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and p.is_file())
        if not paths:
            raise ImageError(f"{folder}: no JPEG photographs (*.jpg, *.jpeg) in this folder")
    elif folder.is_file():
        paths = [folder]
    else:
        raise ImageError(f"{folder}: no such file or folder")
    photos = sorted((_read_photo(path) for path in paths), key=lambda p: (p.taken_s, p.path.name))
    first_s = photos[0].taken_s
    return [replace(photo, taken_s=photo.taken_s - first_s) for photo in photos]


# --- tags ------------------------------------------------------------------------------------
def _read_photo(path: Path) -> Photo:
    """A photo with `taken_s` counted from 1970, for want of knowing the others."""
    with opened(path, str(path)) as picture:
        exif = picture.getexif()
        gps: Mapping[int, Any] = exif.get_ifd(ExifTags.IFD.GPSInfo)
        detail: Mapping[int, Any] = exif.get_ifd(ExifTags.IFD.Exif)
        xmp_packet = picture.info.get("xmp", b"")
        width_px, height_px = picture.size
    orientation = exif.get(ExifTags.Base.Orientation, 1)
    if orientation != 1:
        raise ImageError(
            f"{path}: EXIF Orientation is {orientation}: the pixels are stored turned or mirrored, "
            "and the gimbal angles refer to the picture as taken; save it upright (Orientation 1)"
        )
    xmp = _xmp_values(xmp_packet, path)
    return Photo(
        path,
        Pose(_position(gps, path), _height_m(xmp, path), _attitude(xmp, path)),
        _taken_s(detail, path),
        width_px,
        height_px,
        _hfov_rad(detail, path),
    )


def _position(gps: Mapping[int, Any], path: Path) -> LatLon:
    """Latitude and longitude of the EXIF GPS directory."""
    found = []
    for value_tag, ref_tag, letters in (
        (ExifTags.GPS.GPSLatitude, ExifTags.GPS.GPSLatitudeRef, "NS"),
        (ExifTags.GPS.GPSLongitude, ExifTags.GPS.GPSLongitudeRef, "EW"),
    ):
        for tag in (value_tag, ref_tag):
            if tag not in gps:
                raise ImageError(f"{path}: no geotag: EXIF {tag.name} is missing")
        letter = str(gps[ref_tag]).strip("\0 ").upper()
        try:
            degrees, minutes, seconds = (float(part) for part in gps[value_tag])
        except (TypeError, ValueError, ZeroDivisionError) as error:
            raise ImageError(f"{path}: EXIF {value_tag.name} is unreadable ({error})") from error
        size = degrees + minutes / 60.0 + seconds / 3600.0
        if letter not in tuple(letters) or not 0.0 <= size <= (90.0 if "N" in letters else 180.0):
            raise ImageError(f"{path}: EXIF {value_tag.name} is {size:g} {letter!r}: not a place")
        found.append(-size if letter in "SW" else size)
    return LatLon(*found)


def _height_m(xmp: Mapping[str, str], path: Path) -> float:
    height_m = _number(xmp, f"{_DJI}RelativeAltitude", path)
    if height_m is None:
        raise ImageError(
            f"{path}: XMP drone-dji:RelativeAltitude is missing; EXIF altitude is above sea level "
            "and does not tell the height above ground: write the tag, for example with "
            'exiftool -xmp-drone-dji:RelativeAltitude="+40.0"'
        )
    return height_m


def _attitude(xmp: Mapping[str, str], path: Path) -> Quaternion:
    """Camera axes to NED from gimbal angles.

    The angles are the camera's yaw, pitch and roll in NED, applied in this order: pitch -90 looks
    straight down, and yaw is then the true bearing of the picture's upper edge.
    """
    camera = next((k[: k.index("}") + 1] for k in xmp if k.endswith("}Yaw")), "")
    sets = [
        [f"{_DJI}{name}" for name in names]
        for names in (
            ("GimbalYawDegree", "GimbalPitchDegree", "GimbalRollDegree"),
            ("FlightYawDegree", "GimbalPitchDegree", "GimbalRollDegree"),
        )
    ]
    if camera:
        sets.append([f"{camera}{name}" for name in ("Yaw", "Pitch", "Roll")])
    for keys in sets:
        angles = [_number(xmp, key, path) for key in keys]
        yaw_deg, pitch_deg, roll_deg = angles
        if yaw_deg is not None and pitch_deg is not None:
            # cameras that cannot roll leave the roll out
            roll_rad = math.radians(roll_deg or 0.0)
            return Quaternion.from_euler(roll_rad, math.radians(pitch_deg), math.radians(yaw_deg))
    raise ImageError(
        f"{path}: no camera angles: XMP drone-dji:GimbalYawDegree and GimbalPitchDegree (or "
        "Camera:Yaw and Camera:Pitch) are missing"
    )


def _hfov_rad(detail: Mapping[int, Any], path: Path) -> float | None:
    film_mm = detail.get(ExifTags.Base.FocalLengthIn35mmFilm)
    if film_mm is None or film_mm == 0:  # EXIF 2.32: 0 is "unknown"
        return None
    try:
        hfov_rad = 2.0 * math.atan(_FILM_WIDTH_MM / 2.0 / float(film_mm))
    except (TypeError, ValueError, ZeroDivisionError) as error:
        raise ImageError(f"{path}: EXIF FocalLengthIn35mmFilm is unreadable ({error})") from error
    if not 0.0 < hfov_rad < math.pi:
        raise ImageError(f"{path}: EXIF FocalLengthIn35mmFilm is {film_mm}: not a focal length")
    return hfov_rad


def _taken_s(detail: Mapping[int, Any], path: Path) -> float:
    text = str(detail.get(ExifTags.Base.DateTimeOriginal, "")).strip("\0 ")
    if not text:
        raise ImageError(f"{path}: EXIF DateTimeOriginal is missing: when was it taken?")
    try:
        # a camera's clock has no zone; only differences are used
        whole = datetime.strptime(text, "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC).timestamp()
    except ValueError as error:
        raise ImageError(f"{path}: EXIF DateTimeOriginal is {text!r}: unreadable") from error
    fraction = str(detail.get(ExifTags.Base.SubsecTimeOriginal, "")).strip("\0 ")
    return whole + (float(f"0.{fraction}") if fraction.isdigit() else 0.0)


# --- XMP -------------------------------------------------------------------------------------
def _xmp_values(packet: bytes | str, path: Path) -> dict[str, str]:
    """Attributes and text elements of an XMP packet by their "{namespace}name"."""
    if not packet:
        return {}
    try:
        root = ET.fromstring(packet.strip(b"\0 \n") if isinstance(packet, bytes) else packet)
    except (ET.ParseError, LookupError, ValueError) as error:
        raise ImageError(f"{path}: XMP is not well-formed XML ({error})") from error
    values: dict[str, str] = {}
    for element in root.iter():
        values.update(element.attrib)
        if element.text and element.text.strip():
            values[element.tag] = element.text.strip()
    return values


def _number(xmp: Mapping[str, str], key: str, path: Path) -> float | None:
    """The number under a key; None where it is absent."""
    if key not in xmp:
        return None
    try:
        value = float(xmp[key])
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ImageError(f"{path}: XMP {key.rpartition('}')[2]} is {xmp[key]!r}: not a number")
    return value
