"""Photographs with the tags that a DJI drone writes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import ExifTags, Image

DJI = (
    '<x:xmpmeta xmlns:x="adobe:ns:meta/">'
    '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    '<rdf:Description xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/" {attributes}/>'
    "</rdf:RDF></x:xmpmeta>"
)
FULL = {
    "RelativeAltitude": "+39.80",
    "GimbalYawDegree": "+45.00",
    "GimbalPitchDegree": "-90.00",
    "GimbalRollDegree": "+0.00",
    "FlightYawDegree": "+12.00",
}


def dji(**changes: str | None) -> bytes:
    tags = {k: v for k, v in {**FULL, **changes}.items() if v is not None}
    attributes = " ".join(f'drone-dji:{k}="{v}"' for k, v in tags.items())
    return DJI.format(attributes=attributes).encode()


def _blue_sky() -> Image.Image:
    noise = np.random.default_rng(1).normal((10, 120, 240), 4.0, (36, 64, 3))
    return Image.fromarray(np.clip(noise, 0, 255).astype(np.uint8))


def write_photo(
    path: Path,
    *,
    gps: dict[int, object] | None = None,
    taken: str | None = "2016:06:23 16:31:59",
    film_mm: int | None = 20,
    orientation: int | None = None,
    xmp: bytes | None = None,
    image: Image.Image | None = None,
) -> Path:
    exif = Image.Exif()
    if orientation is not None:
        exif[ExifTags.Base.Orientation] = orientation
    place = {1: "N", 2: (46.0, 50.0, 33.3855), 3: "W", 4: (91.0, 59.0, 40.4156)}
    exif.get_ifd(ExifTags.IFD.GPSInfo).update(place if gps is None else gps)
    detail = exif.get_ifd(ExifTags.IFD.Exif)
    if taken is not None:
        detail[ExifTags.Base.DateTimeOriginal] = taken
    if film_mm is not None:
        detail[ExifTags.Base.FocalLengthIn35mmFilm] = film_mm
    (image or _blue_sky()).save(path, "JPEG", exif=exif, xmp=dji() if xmp is None else xmp)
    return path
