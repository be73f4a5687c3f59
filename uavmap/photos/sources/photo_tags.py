"""The tags of a photograph: EXIF, and XMP as makers of drones write it.

Nothing is guessed. An unreadable tag is a note; its value stays absent.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any, Literal

from PIL import ExifTags, Image

from missions.errors import ImageError
from missions.units import LatLon
from uavmap.base.printable import printable
from uavmap.photos.sources.focal_length import lens_of
from uavmap.photos.sources.xmp import Values, number, values_of
from vision.lens import Lens
from vision.registration.views import Measured

POSITION_SIGMA_M = 3.0
"""Of a GNSS receiver without corrections."""
_RTK_FIXED = 50
_HEIGHT_SIGMA_M = 2.0  # a barometer, and home that is not level with the ground below
_AMSL_SIGMA_M = 10.0  # the level is unknown: the geoid and the ellipsoid are 30 m apart
_GIMBAL_SIGMA_DEG = 5.0
_AIRFRAME_SIGMA_DEG = 10.0
_COMPASS_SIGMA_DEG = 20.0
_TILT_SIGMA_DEG = 1.0

Exif = Mapping[int, Any]
_ANGLES: tuple[tuple[tuple[str, str, str], float], ...] = (
    (("GimbalYawDegree", "GimbalPitchDegree", "GimbalRollDegree"), _GIMBAL_SIGMA_DEG),
    (("CameraYawDegree", "CameraPitchDegree", "CameraRollDegree"), _GIMBAL_SIGMA_DEG),
    (("FlightYawDegree", "GimbalPitchDegree", "GimbalRollDegree"), _AIRFRAME_SIGMA_DEG),
    (("Yaw", "Pitch", "Roll"), _GIMBAL_SIGMA_DEG),
)


@dataclass
class Tags:
    """The tags of one photograph, named as in `uavmap.photos.sources.picture_record.Picture`."""

    taken_s: float | None = None
    clock: Literal["utc", "camera"] = "camera"
    position: LatLon | None = None
    position_sigma_m: float = POSITION_SIGMA_M
    height_m: Measured | None = None
    amsl_m: Measured | None = None
    yaw_deg: Measured | None = None
    pitch_deg: Measured | None = None
    roll_deg: Measured | None = None
    lens: Lens | None = None
    lens_from: str = ""
    notes: list[str] = field(default_factory=list)

    def take(self, read: Callable[[], None]) -> None:
        """Read something; note what cannot be read."""
        try:
            read()
        except (TypeError, ValueError, KeyError, ZeroDivisionError, OverflowError) as error:
            self.notes.append(printable(str(error))[:200] or "a tag is unreadable")


def tags_of(picture: Image.Image) -> Tags:
    """Return the tags of an opened picture. Raises `ImageError` for one stored mirrored."""
    exif = picture.getexif()
    gps: Exif = exif.get_ifd(ExifTags.IFD.GPSInfo)
    detail: Exif = exif.get_ifd(ExifTags.IFD.Exif)
    tags = Tags()
    xmp: Values = {}
    try:
        xmp = values_of(picture.info.get("xmp") or exif.get(ExifTags.Base.XMLPacket) or b"")
    except (TypeError, ValueError) as error:
        tags.notes.append(f"XMP is not well-formed ({printable(str(error))[:80]})")
    model = str(exif.get(ExifTags.Base.Model, "")).strip("\0 ")
    tags.take(lambda: _time(tags, exif, detail, gps))
    tags.take(lambda: _place(tags, gps, xmp))
    tags.take(lambda: _heights(tags, gps, xmp))
    tags.take(lambda: _attitude(tags, gps, xmp))
    tags.take(lambda: _orientation(tags, exif.get(ExifTags.Base.Orientation, 1)))
    tags.lens, tags.lens_from, notes = lens_of(*picture.size, model, detail, xmp)
    tags.notes.extend(notes)
    return tags


# --- time ----------------------------------------------------------------------------------------
def _time(tags: Tags, exif: Exif, detail: Exif, gps: Exif) -> None:
    text = str(
        detail.get(ExifTags.Base.DateTimeOriginal) or exif.get(ExifTags.Base.DateTime) or ""
    ).strip("\0 ")
    if not text:
        _gps_time(tags, gps)
        return
    try:
        whole = datetime.strptime(text, "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC)
        seconds = whole.timestamp()
    except ValueError:
        raise ValueError(f"EXIF DateTimeOriginal is {text[:40]!r}: unreadable") from None
    fraction = str(detail.get(ExifTags.Base.SubsecTimeOriginal, "")).strip("\0 ")
    tags.taken_s = seconds + (float(f"0.{fraction}") if fraction.isdecimal() else 0.0)
    zone = str(detail.get(ExifTags.Base.OffsetTimeOriginal, "")).strip("\0 ")
    if len(zone) == 6 and zone[0] in "+-" and zone[1:3].isdecimal() and zone[4:].isdecimal():
        ahead_s = (int(zone[1:3]) * 60 + int(zone[4:])) * 60.0
        tags.taken_s -= -ahead_s if zone[0] == "-" else ahead_s
        tags.clock = "utc"


def _gps_time(tags: Tags, gps: Exif) -> None:
    if ExifTags.GPS.GPSDateStamp not in gps or ExifTags.GPS.GPSTimeStamp not in gps:
        return
    stamp = str(gps[ExifTags.GPS.GPSDateStamp]).strip("\0 ")
    day = datetime.strptime(stamp, "%Y:%m:%d").replace(tzinfo=UTC)
    hours, minutes, seconds = (float(part) for part in gps[ExifTags.GPS.GPSTimeStamp])
    since = day + timedelta(hours=hours, minutes=minutes, seconds=seconds)
    tags.taken_s, tags.clock = since.timestamp(), "utc"


# --- place ---------------------------------------------------------------------------------------
def _place(tags: Tags, gps: Exif, xmp: Values) -> None:
    found = []
    for value_tag, ref_tag, letters in (
        (ExifTags.GPS.GPSLatitude, ExifTags.GPS.GPSLatitudeRef, "NS"),
        (ExifTags.GPS.GPSLongitude, ExifTags.GPS.GPSLongitudeRef, "EW"),
    ):
        missing = [tag.name for tag in (value_tag, ref_tag) if tag not in gps]
        if missing:
            if _place_of_xmp(tags, xmp):
                return
            raise ValueError(f"no geotag: EXIF {missing[0]} is missing")
        found.append(_degrees(gps, value_tag, str(gps[ref_tag]).strip("\0 ").upper(), letters))
    tags.position = LatLon(*found)
    _place_sigma(tags, gps, xmp)


def _degrees(gps: Exif, tag: ExifTags.GPS, letter: str, letters: str) -> float:
    try:
        degrees, minutes, seconds = (float(part) for part in gps[tag])
    except (TypeError, ValueError, ZeroDivisionError) as error:
        raise ValueError(f"EXIF {tag.name} is unreadable ({error})") from None
    size = degrees + minutes / 60.0 + seconds / 3600.0
    most = 90.0 if "N" in letters else 180.0
    if letter not in tuple(letters) or not 0.0 <= size <= most:
        raise ValueError(f"EXIF {tag.name} is {size:g} {letter[:4]!r}: not a place")
    return -size if letter in "SW" else size


def _place_of_xmp(tags: Tags, xmp: Values) -> bool:
    lat = number(xmp, "GpsLatitude") if "GpsLatitude" in xmp else number(xmp, "Latitude")
    # the misspelling is DJI's
    keys = ("GpsLongitude", "GpsLongtitude", "Longitude")
    lon = next((number(xmp, key) for key in keys if key in xmp), None)
    if lat is None or lon is None or abs(lat) > 90.0 or abs(lon) > 180.0:
        return False
    tags.position = LatLon(lat, lon)
    return True


def _place_sigma(tags: Tags, gps: Exif, xmp: Values) -> None:
    stated = gps.get(ExifTags.GPS.GPSHPositioningError)
    if stated is not None and 0.0 < float(stated) < 1000.0:
        tags.position_sigma_m = float(stated)
    if number(xmp, "RtkFlag") == _RTK_FIXED:
        sigmas = [number(xmp, key) for key in ("RtkStdLat", "RtkStdLon")]
        known = [sigma for sigma in sigmas if sigma is not None and sigma > 0.0]
        tags.position_sigma_m = max(known, default=0.05)


# --- height --------------------------------------------------------------------------------------
def _heights(tags: Tags, gps: Exif, xmp: Values) -> None:
    amsl = number(xmp, "AbsoluteAltitude")
    exif_m = gps.get(ExifTags.GPS.GPSAltitude)
    if amsl is None and exif_m is not None and math.isfinite(float(exif_m)):
        below = gps.get(ExifTags.GPS.GPSAltitudeRef) in (1, b"\x01")
        amsl = -float(exif_m) if below else float(exif_m)
    if amsl is not None:
        tags.amsl_m = Measured(amsl, _AMSL_SIGMA_M)
    for key in ("AboveGroundAltitude", "RelativeAltitude"):
        height = number(xmp, key)
        if height is not None:
            tags.height_m = Measured(height, _HEIGHT_SIGMA_M)
            return


# --- attitude ------------------------------------------------------------------------------------
def _attitude(tags: Tags, gps: Exif, xmp: Values) -> None:
    for keys, sigma in _ANGLES:
        yaw, pitch, roll = (number(xmp, key) for key in keys)
        if pitch is not None and tags.pitch_deg is None:
            tags.pitch_deg = Measured(pitch, _TILT_SIGMA_DEG)
            # cameras that cannot roll leave the roll out
            tags.roll_deg = Measured(roll or 0.0, _TILT_SIGMA_DEG)
        if yaw is not None and tags.yaw_deg is None:
            tags.yaw_deg = Measured(yaw % 360.0, sigma)
        if tags.yaw_deg is not None and tags.pitch_deg is not None:
            return
    bearing = gps.get(ExifTags.GPS.GPSImgDirection) if tags.yaw_deg is None else None
    if bearing is not None and str(gps.get(ExifTags.GPS.GPSImgDirectionRef, "T")).startswith("T"):
        yaw = float(bearing)
        if math.isfinite(yaw):
            tags.yaw_deg = Measured(yaw % 360.0, _COMPASS_SIGMA_DEG)


def _orientation(tags: Tags, orientation: Any) -> None:
    if orientation in (1, 0, None):
        return
    tags.yaw_deg = None
    fault = (
        f"EXIF Orientation is {orientation}: the pixels are stored turned or mirrored, and the "
        "heading refers to the picture as taken; save it upright (Orientation 1)"
    )
    raise ImageError(fault) if orientation in (2, 4, 5, 7) else ValueError(fault)
