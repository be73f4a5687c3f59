"""The tags of a photograph: EXIF, and XMP in the forms of drone makers.

No value is guessed. An unreadable tag is a note, and its value stays absent.

DJI, Autel, Parrot and Pix4D use the same words (RelativeAltitude, GimbalYawDegree, Yaw) under
namespaces that change from model to model. Each word that is read here has one meaning.

The lens comes from the best tag, in this order:

* the maker's calibration (XMP DewarpData, CalibratedFocalLength);
* EXIF FocalLength on the pixels' pitch (FocalPlaneXResolution);
* FocalLength on a known sensor;
* the 35 mm equivalent: the focal length with the same angle of view across the *diagonal* of a
  36 x 24 mm frame.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from datetime import UTC, datetime, timedelta
from typing import Any, Final
from xml.etree.ElementTree import ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring
from PIL import ExifTags, Image

from missions.errors import ImageError
from missions.units import LatLon
from uavmap.base.printable import printable
from vision.camera import Lens
from vision.registration.views import Measured

LARGEST_PACKET = 2 * 2**20

Values = Mapping[str, str]


def values_of(packet: bytes | str) -> dict[str, str]:
    """Return attributes and text elements by their local names; the first of a name counts.

    Raises `ValueError` for a packet that is not well-formed, too long, or declares entities.

    >>> values_of('<a xmlns:d="http://d/" d:Yaw="4"><d:Pitch> -90 </d:Pitch></a>')
    {'Yaw': '4', 'Pitch': '-90'}
    """
    if len(packet) > LARGEST_PACKET:
        raise ValueError(f"{len(packet)} bytes are too many")
    text = packet.decode("utf-8", "replace") if isinstance(packet, bytes) else packet
    text = text.strip("\0 \r\n\t\ufeff")
    if not text:
        return {}
    try:
        root = fromstring(text, forbid_dtd=True)
    except DefusedXmlException:
        raise ValueError("it declares entities") from None
    except (ParseError, LookupError) as error:
        raise ValueError(str(error)) from None
    values: dict[str, str] = {}
    for element in root.iter():
        for key, value in element.attrib.items():
            values.setdefault(key.rpartition("}")[2], value.strip())
        if element.text and element.text.strip():
            values.setdefault(element.tag.rpartition("}")[2], element.text.strip())
    return values


def number(values: Values, key: str) -> float | None:
    """Return the number under a key, None if absent. Raises `ValueError` for another value.

    >>> number({"RelativeAltitude": "+39.80"}, "RelativeAltitude")
    39.8
    """
    if key not in values:
        return None
    text = values[key]
    try:
        # rationals, as EXIF in XMP has them
        over, _, under = text.partition("/")
        value = float(over) / float(under) if under else float(over)
    except (ValueError, ZeroDivisionError):
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"XMP {key} is {text[:40]!r}: not a number")
    return value


# --- the lens ------------------------------------------------------------------------------------
_FILM_DIAGONAL_MM = math.hypot(36.0, 24.0)
_WIDE = 1.6
"""Widest uncut picture, width / height: a wider one is cut from a 4:3 sensor; the tags
stay.
"""
_UNIT_MM = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
_NARROWEST_RAD, _WIDEST_RAD = math.radians(2.0), math.radians(170.0)

Exif = Mapping[int, Any]


def lens_of(
    width_px: int, height_px: int, model: str, detail: Exif, xmp: Values
) -> tuple[Lens | None, str, tuple[str, ...]]:
    """Return the lens (None if no tag gives a focal length), its tag, and unreadable tags.

    Args:
        model: EXIF Model.
        detail: The Exif directory.
        xmp: Values by local name.
    """
    notes: list[str] = []
    size = width_px, height_px
    if not all(size):
        return None, "", ()
    rules: dict[str, Callable[[], Lens | None]] = {
        "XMP DewarpData": lambda: _dewarp(*size, xmp),
        "XMP CalibratedFocalLength": lambda: _calibrated(*size, xmp),
        "EXIF FocalLength and FocalPlaneXResolution": lambda: _on_plane(*size, detail),
        "EXIF FocalLength on the sensor of this model": lambda: _on_sensor(*size, model, detail),
        "EXIF FocalLengthIn35mmFilm": lambda: _film(*size, detail),
    }
    for name, rule in rules.items():
        try:
            lens = rule()
        except (TypeError, ValueError, ZeroDivisionError, OverflowError) as error:
            notes.append(f"focal length unreadable ({error})")
            continue
        if lens is None:
            continue
        if not _NARROWEST_RAD < lens.hfov_rad < _WIDEST_RAD:
            notes.append(
                f"the tags give an angle of view of {math.degrees(lens.hfov_rad):.0f} deg: not used"
            )
            continue
        return lens, name, tuple(notes)
    return None, "", tuple(notes)


def _dewarp(width_px: int, height_px: int, xmp: Values) -> Lens | None:
    """Read DJI's date;fx,fy,cx,cy,k1,k2,p1,p2,k3, the centre from the middle of the picture.

    The camera has already corrected a picture with DewarpFlag 1.
    """
    text = xmp.get("DewarpData", "").partition(";")[2]
    if not text or xmp.get("DewarpFlag", "0").strip() == "1":
        return None
    found = [float(part) for part in text.split(",")]
    if len(found) != 9:
        raise ValueError(f"XMP DewarpData has {len(found)} numbers, expected 9")
    if not any(found):
        return None  # not calibrated
    fx, fy, cx, cy, *distortion = found
    middle = ((width_px - 1) / 2.0 + cx, (height_px - 1) / 2.0 + cy)
    return Lens(width_px, height_px, fx, fy, *middle, distortion=tuple(distortion))


def _calibrated(width_px: int, height_px: int, xmp: Values) -> Lens | None:
    focal_px = number(xmp, "CalibratedFocalLength")
    if not focal_px:
        return None
    x = number(xmp, "CalibratedOpticalCenterX")
    y = number(xmp, "CalibratedOpticalCenterY")
    # DJI counts from the upper left corner of the picture, not from a pixel's centre
    cx = (width_px - 1) / 2.0 if not x else x - 0.5
    cy = (height_px - 1) / 2.0 if not y else y - 0.5
    return Lens(width_px, height_px, focal_px, focal_px, cx, cy)


def _on_plane(width_px: int, height_px: int, detail: Exif) -> Lens | None:
    """Read FocalPlaneXResolution, which counts the sensor's pixels: the picture may be reduced."""
    focal_mm = _positive(detail, ExifTags.Base.FocalLength)
    pixels = _positive(detail, ExifTags.Base.FocalPlaneXResolution)
    unit_mm = _UNIT_MM.get(int(detail.get(ExifTags.Base.FocalPlaneResolutionUnit, 2)))
    if focal_mm is None or pixels is None or unit_mm is None:
        return None
    taken_px = _positive(detail, ExifTags.Base.ExifImageWidth) or width_px
    return Lens.square(focal_mm * pixels / unit_mm * width_px / taken_px, width_px, height_px)


def _on_sensor(width_px: int, height_px: int, model: str, detail: Exif) -> Lens | None:
    focal_mm = _positive(detail, ExifTags.Base.FocalLength)
    width_mm = _WIDTH_MM.get(model)
    if focal_mm is None or width_mm is None or height_px > width_px:
        return None
    return Lens.square(focal_mm / width_mm * width_px, width_px, height_px)


def _film(width_px: int, height_px: int, detail: Exif) -> Lens | None:
    film_mm = _positive(detail, ExifTags.Base.FocalLengthIn35mmFilm)  # EXIF 2.32: 0 is "unknown"
    return None if film_mm is None else film_lens(film_mm, width_px, height_px)


def film_lens(film_mm: float, width_px: int, height_px: int) -> Lens:
    """Return the lens of a 35 mm equivalent, above 0.

    >>> round(film_lens(24.0, 4000, 3000).hfov_deg, 1)
    71.6
    """
    longer, shorter = max(width_px, height_px), min(width_px, height_px)
    uncut = longer * 0.75 if longer > _WIDE * shorter else shorter
    return Lens.square(film_mm * math.hypot(longer, uncut) / _FILM_DIAGONAL_MM, width_px, height_px)


def _positive(detail: Exif, tag: ExifTags.Base) -> float | None:
    value = detail.get(tag)
    if value is None:
        return None
    number = float(value)
    return number if math.isfinite(number) and number > 0.0 else None


_SENSORS: Final = (
    (6.16, "FC300C FC300S FC300X FC300XW FC330 FC350 FC220"),  # 1/2.3 inch
    (13.2, "FC6310 FC6310R FC6310S L1D-20c FC3411 XT705"),  # 1 inch
    (17.3, "FC550 FC6520 L2D-20c M3E"),  # four thirds
    (35.9, "ZenmuseP1"),  # full frame
)
_WIDTH_MM: Final = {model: width_mm for width_mm, models in _SENSORS for model in models.split()}
"""Width of the sensor by EXIF Model, mm."""


# --- all of them ---------------------------------------------------------------------------------
POSITION_SIGMA_M = 3.0
"""Error of a GNSS receiver without corrections, m."""
_RTK_FIXED = 50
_HEIGHT_SIGMA_M = 2.0  # of a barometer, and of a pad that is not level with the ground below
_AMSL_SIGMA_M = 10.0  # the reference is unknown: the geoid and the ellipsoid are 30 m apart
_GIMBAL_SIGMA_DEG = 5.0
_AIRFRAME_SIGMA_DEG = 10.0
_COMPASS_SIGMA_DEG = 20.0
_TILT_SIGMA_DEG = 1.0

_ANGLES: tuple[tuple[tuple[str, str, str], float], ...] = (
    (("GimbalYawDegree", "GimbalPitchDegree", "GimbalRollDegree"), _GIMBAL_SIGMA_DEG),
    (("CameraYawDegree", "CameraPitchDegree", "CameraRollDegree"), _GIMBAL_SIGMA_DEG),
    (("FlightYawDegree", "GimbalPitchDegree", "GimbalRollDegree"), _AIRFRAME_SIGMA_DEG),
    (("Yaw", "Pitch", "Roll"), _GIMBAL_SIGMA_DEG),
)


Tags = dict[str, Any]
"""The tags of one photograph, by the fields of `uavmap.photos.sources.picture_record.Picture`."""


def tags_of(picture: Image.Image) -> Tags:
    """Return the tags of an opened picture. Raises `ImageError` for one stored mirrored."""
    exif = picture.getexif()
    gps: Exif = exif.get_ifd(ExifTags.IFD.GPSInfo)
    detail: Exif = exif.get_ifd(ExifTags.IFD.Exif)
    tags: Tags = {"position_sigma_m": POSITION_SIGMA_M}
    notes: list[str] = []
    xmp: Values = {}
    try:
        xmp = values_of(picture.info.get("xmp") or exif.get(ExifTags.Base.XMLPacket) or b"")
    except (TypeError, ValueError) as error:
        notes.append(f"XMP is not well-formed ({printable(str(error))[:80]})")
    readers: tuple[Callable[[], None], ...] = (
        lambda: _time(tags, exif, detail, gps),
        lambda: _place(tags, gps, xmp),
        lambda: _heights(tags, gps, xmp),
        lambda: _attitude(tags, gps, xmp),
        lambda: _orientation(tags, exif.get(ExifTags.Base.Orientation, 1)),
    )
    for read in readers:
        try:
            read()
        except (TypeError, ValueError, KeyError, ZeroDivisionError, OverflowError) as error:
            notes.append(printable(str(error))[:200] or "a tag is unreadable")
    model = str(exif.get(ExifTags.Base.Model, "")).strip("\0 ")
    tags["lens"], tags["lens_from"], unreadable = lens_of(*picture.size, model, detail, xmp)
    return tags | {"notes": (*notes, *unreadable)}


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
    tags["taken_s"] = seconds + (float(f"0.{fraction}") if fraction.isdecimal() else 0.0)
    zone = str(detail.get(ExifTags.Base.OffsetTimeOriginal, "")).strip("\0 ")
    if len(zone) == 6 and zone[0] in "+-" and zone[1:3].isdecimal() and zone[4:].isdecimal():
        ahead_s = (int(zone[1:3]) * 60 + int(zone[4:])) * 60.0
        tags["taken_s"] -= -ahead_s if zone[0] == "-" else ahead_s
        tags["clock"] = "utc"


def _gps_time(tags: Tags, gps: Exif) -> None:
    if ExifTags.GPS.GPSDateStamp not in gps or ExifTags.GPS.GPSTimeStamp not in gps:
        return
    stamp = str(gps[ExifTags.GPS.GPSDateStamp]).strip("\0 ")
    day = datetime.strptime(stamp, "%Y:%m:%d").replace(tzinfo=UTC)
    hours, minutes, seconds = (float(part) for part in gps[ExifTags.GPS.GPSTimeStamp])
    since = day + timedelta(hours=hours, minutes=minutes, seconds=seconds)
    tags["taken_s"], tags["clock"] = since.timestamp(), "utc"


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
    tags["position"] = LatLon(*found)
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
    # DJI misspells it
    keys = ("GpsLongitude", "GpsLongtitude", "Longitude")
    lon = next((number(xmp, key) for key in keys if key in xmp), None)
    if lat is None or lon is None or abs(lat) > 90.0 or abs(lon) > 180.0:
        return False
    tags["position"] = LatLon(lat, lon)
    return True


def _place_sigma(tags: Tags, gps: Exif, xmp: Values) -> None:
    stated = gps.get(ExifTags.GPS.GPSHPositioningError)
    if stated is not None and 0.0 < float(stated) < 1000.0:
        tags["position_sigma_m"] = float(stated)
    if number(xmp, "RtkFlag") == _RTK_FIXED:
        sigmas = [number(xmp, key) for key in ("RtkStdLat", "RtkStdLon")]
        known = [sigma for sigma in sigmas if sigma is not None and sigma > 0.0]
        tags["position_sigma_m"] = max(known, default=0.05)


# --- height --------------------------------------------------------------------------------------
def _heights(tags: Tags, gps: Exif, xmp: Values) -> None:
    amsl = number(xmp, "AbsoluteAltitude")
    exif_m = gps.get(ExifTags.GPS.GPSAltitude)
    if amsl is None and exif_m is not None and math.isfinite(float(exif_m)):
        below = gps.get(ExifTags.GPS.GPSAltitudeRef) in (1, b"\x01")
        amsl = -float(exif_m) if below else float(exif_m)
    if amsl is not None:
        tags["amsl_m"] = Measured(amsl, _AMSL_SIGMA_M)
    for key in ("AboveGroundAltitude", "RelativeAltitude"):
        height = number(xmp, key)
        if height is not None:
            tags["height_m"] = Measured(height, _HEIGHT_SIGMA_M)
            return


# --- attitude ------------------------------------------------------------------------------------
def _attitude(tags: Tags, gps: Exif, xmp: Values) -> None:
    for keys, sigma in _ANGLES:
        yaw, pitch, roll = (number(xmp, key) for key in keys)
        if pitch is not None and "pitch_deg" not in tags:
            tags["pitch_deg"] = Measured(pitch, _TILT_SIGMA_DEG)
            # cameras that cannot roll omit the roll
            tags["roll_deg"] = Measured(roll or 0.0, _TILT_SIGMA_DEG)
        if yaw is not None and "yaw_deg" not in tags:
            tags["yaw_deg"] = Measured(yaw % 360.0, sigma)
        if "yaw_deg" in tags and "pitch_deg" in tags:
            return
    bearing = None if "yaw_deg" in tags else gps.get(ExifTags.GPS.GPSImgDirection)
    if bearing is not None and str(gps.get(ExifTags.GPS.GPSImgDirectionRef, "T")).startswith("T"):
        yaw = float(bearing)
        if math.isfinite(yaw):
            tags["yaw_deg"] = Measured(yaw % 360.0, _COMPASS_SIGMA_DEG)


def _orientation(tags: Tags, orientation: Any) -> None:
    if orientation in (1, 0, None):
        return
    tags["yaw_deg"] = None
    fault = (
        f"EXIF Orientation is {orientation}: the pixels are stored turned or mirrored, and the "
        "heading refers to the picture as taken; save it upright (Orientation 1)"
    )
    raise ImageError(fault) if orientation in (2, 4, 5, 7) else ValueError(fault)
