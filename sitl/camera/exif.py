"""Geotags as a DJI writes them: EXIF and XMP in an encoded JPEG; and pictures of a failing camera.

Two APP1 segments before the first quantization table leave the pixels as they are. EXIF holds
place, date and angle of view, XMP (`drone-dji:*`) the heights and angles.
"""

from __future__ import annotations

import math
import struct
import time
from dataclasses import dataclass

import cv2
import numpy as np

from missions.units import LatLon, Quaternion

EPOCH_UTC_S = 1_577_836_800
"""The world's time 0: 2020-01-01T00:00:00Z. A fixed date, so that bytes repeat."""

_FILM_WIDTH_MM = 36  # FocalLengthIn35mmFilm refers to a frame of this width
_SECOND_PARTS = 100_000  # of arc: a third of a millimetre on the ground
_NEARLY_VERTICAL = 1.0 - 1e-9

_BYTE, _ASCII, _SHORT, _LONG, _RATIONAL, _UNDEFINED = 1, 2, 3, 4, 5, 7
_EXIF_POINTER, _GPS_POINTER = 0x8769, 0x8825
_APP0, _APP1 = b"\xff\xe0", b"\xff\xe1"
_JPEG_QUALITY = 90

_XMP = (
    '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>'
    '<x:xmpmeta xmlns:x="adobe:ns:meta/">'
    '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    '<rdf:Description rdf:about="" xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/"'
    ' drone-dji:AbsoluteAltitude="{:+.2f}" drone-dji:RelativeAltitude="{:+.2f}"'
    ' drone-dji:GimbalRollDegree="{:+.2f}" drone-dji:GimbalYawDegree="{:+.2f}"'
    ' drone-dji:GimbalPitchDegree="{:+.2f}" drone-dji:FlightRollDegree="{:+.2f}"'
    ' drone-dji:FlightYawDegree="{:+.2f}" drone-dji:FlightPitchDegree="{:+.2f}"/>'
    '</rdf:RDF></x:xmpmeta><?xpacket end="w"?>'
)


@dataclass(frozen=True, slots=True)
class Geotag:
    """The metadata of a picture.

    `height_m` is above home. `camera` turns the camera's axes (forward, right, down) to NED.
    `body_rad` is roll, pitch and yaw of the aircraft, `taken_s` the world's time.
    """

    position: LatLon
    amsl_m: float
    height_m: float
    camera: Quaternion
    body_rad: tuple[float, float, float]
    taken_s: float
    hfov_rad: float
    width_px: int


def tagged(jpeg: bytes, tag: Geotag) -> bytes:
    """Return the picture with its geotag; raises `ValueError` if it is no JPEG."""
    if jpeg[:3] != b"\xff\xd8\xff":
        raise ValueError("only a JPEG can be tagged")
    # JFIF wants its APP0 first, EXIF its APP1: readers take APP1 behind APP0, few the reverse
    at = 2
    if jpeg[2:4] == _APP0:
        at = 4 + int.from_bytes(jpeg[4:6], "big")
    return b"".join((jpeg[:at], _segment(_exif(tag)), _segment(_xmp(tag)), jpeg[at:]))


def camera_angles(attitude: Quaternion) -> tuple[float, float, float]:
    """Return yaw, pitch and roll in radians of a camera in NED, applied in this order.

    Straight down, where yaw and roll are one rotation, it is all yaw: the true bearing of the
    picture's upper edge.
    """
    w, x, y, z = attitude
    sine = max(-1.0, min(1.0, 2.0 * (w * y - z * x)))
    if abs(sine) > _NEARLY_VERTICAL:
        yaw = math.atan2(2.0 * (w * z - x * y), 1.0 - 2.0 * (x * x + z * z))
        return yaw, math.copysign(math.pi / 2.0, sine), 0.0
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    return yaw, math.asin(sine), roll


def _segment(payload: bytes) -> bytes:
    return _APP1 + (len(payload) + 2).to_bytes(2, "big") + payload


def _xmp(tag: Geotag) -> bytes:
    yaw, pitch, roll = (math.degrees(angle) for angle in camera_angles(tag.camera))
    body_roll, body_pitch, body_yaw = tag.body_rad
    text = _XMP.format(
        tag.amsl_m, tag.height_m, roll, yaw, pitch, math.degrees(body_roll),
        math.degrees(math.remainder(body_yaw, math.tau)), math.degrees(body_pitch),
    )  # fmt: skip
    return b"http://ns.adobe.com/xap/1.0/\0" + text.encode()


# --- EXIF: a TIFF without pixels ----------------------------------------------------------------
_Entry = tuple[int, int, bytes]


def _exif(tag: Geotag) -> bytes:
    milliseconds = round(tag.taken_s * 1000.0)
    date = time.strftime("%Y:%m:%d %H:%M:%S", time.gmtime(EPOCH_UTC_S + milliseconds // 1000))
    film_mm = _FILM_WIDTH_MM / 2.0 / math.tan(tag.hfov_rad / 2.0)
    lat, lon = tag.position.lat_deg, tag.position.lon_deg
    detail: list[_Entry] = [
        (0x9000, _UNDEFINED, b"0232"),  # ExifVersion
        (0x9003, _ASCII, _text(date)),  # DateTimeOriginal
        (0x920A, _RATIONAL, struct.pack("<II", round(film_mm * 10_000.0), 10_000)),  # FocalLength
        (0x9291, _ASCII, _text(f"{milliseconds % 1000:03d}")),  # SubsecTimeOriginal
        # on a sensor as wide as film: whole numbers of millimetres are too coarse to map by
        (0xA20E, _RATIONAL, struct.pack("<II", tag.width_px * 1000, _FILM_WIDTH_MM * 1000)),
        (0xA210, _SHORT, b"\x04\x00"),  # FocalPlaneResolutionUnit: millimetres
        (0xA405, _SHORT, struct.pack("<H", round(film_mm))),  # FocalLengthIn35mmFilm
    ]
    gps: list[_Entry] = [
        (0, _BYTE, b"\x02\x03\x00\x00"),  # GPSVersionID
        (1, _ASCII, _text("S" if lat < 0.0 else "N")),
        (2, _RATIONAL, _sexagesimal(lat)),
        (3, _ASCII, _text("W" if lon < 0.0 else "E")),
        (4, _RATIONAL, _sexagesimal(lon)),
        (5, _BYTE, b"\x01" if tag.amsl_m < 0.0 else b"\x00"),  # below sea level, or above
        (6, _RATIONAL, struct.pack("<II", round(abs(tag.amsl_m) * 1000.0), 1000)),
    ]
    main: list[_Entry] = [
        (0x010F, _ASCII, _text("uavmap")),  # Make
        (0x0110, _ASCII, _text("simulated nadir camera")),  # Model
        (0x0112, _SHORT, b"\x01\x00"),  # Orientation: upright
        (0x0132, _ASCII, _text(date)),  # DateTime
        (_EXIF_POINTER, _LONG, bytes(4)),
        (_GPS_POINTER, _LONG, bytes(4)),
    ]
    # the length of a directory does not depend on where others begin
    at_detail = 8 + len(_directory(main, 8))
    written = _directory(detail, at_detail)
    at_gps = at_detail + len(written)
    main[4] = (_EXIF_POINTER, _LONG, at_detail.to_bytes(4, "little"))
    main[5] = (_GPS_POINTER, _LONG, at_gps.to_bytes(4, "little"))
    head = b"Exif\0\0II*\0\x08\0\0\0"
    return head + _directory(main, 8) + written + _directory(gps, at_gps)


_UNIT_BYTES = {_BYTE: 1, _ASCII: 1, _SHORT: 2, _LONG: 4, _RATIONAL: 8, _UNDEFINED: 1}


def _directory(entries: list[_Entry], at: int) -> bytes:
    """Return an image file directory at an offset, with the values that do not fit behind it."""
    table, values = [len(entries).to_bytes(2, "little")], bytearray()
    behind = at + 2 + 12 * len(entries) + 4
    for number, kind, value in entries:
        table.append(struct.pack("<HHI", number, kind, len(value) // _UNIT_BYTES[kind]))
        if len(value) <= 4:
            table.append(value.ljust(4, b"\0"))
            continue
        table.append((behind + len(values)).to_bytes(4, "little"))
        values += value + bytes(len(value) % 2)  # values begin at even offsets
    return b"".join((*table, bytes(4), values))


def _text(text: str) -> bytes:
    return text.encode("ascii") + b"\0"


def _sexagesimal(degrees: float) -> bytes:
    """Return degrees, minutes and seconds as three rationals, without a sign."""
    parts = round(abs(degrees) * 3600.0 * _SECOND_PARTS)
    minutes, seconds = divmod(parts, 60 * _SECOND_PARTS)
    return struct.pack("<6I", minutes // 60, 1, minutes % 60, 1, seconds, _SECOND_PARTS)


# --- a camera that fails ------------------------------------------------------------------------
def black(jpeg: bytes) -> bytes:
    """Return a black picture of the same size."""
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    quality = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
    return bytes(cv2.imencode(".jpg", np.zeros_like(picture), quality)[1])


def broken(jpeg: bytes) -> bytes:
    """Return the first half, as an interrupted write leaves it."""
    return jpeg[: len(jpeg) // 2]
