"""The lens of a photograph from its tags, by the best of them.

In this order: the maker's calibration (XMP DewarpData, CalibratedFocalLength), EXIF FocalLength on
the pixels' pitch (FocalPlaneXResolution), FocalLength on a known sensor, and the 35 mm equivalent:
the focal length with the same angle of view across the *diagonal* of a 36 x 24 mm frame.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Final

from PIL import ExifTags

from uavmap.photos.sources.xmp import Values, number
from vision.lens import Lens

_FILM_DIAGONAL_MM = math.hypot(36.0, 24.0)
_WIDE = 1.6
"""Widest uncut picture: a wider one is cut from a sensor of 4:3, over its whole width; the tags
stay.
"""
_UNIT_MM = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
_NARROWEST_RAD, _WIDEST_RAD = math.radians(2.0), math.radians(170.0)

Exif = Mapping[int, Any]


def lens_of(
    width_px: int, height_px: int, model: str, detail: Exif, xmp: Values
) -> tuple[Lens | None, str, tuple[str, ...]]:
    """Return the lens, None if no tag gives a focal length; the tag; what is unreadable.

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

    A picture with DewarpFlag 1 was corrected by the camera already.
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
    """FocalPlaneXResolution counts the sensor's pixels; the picture may be a reduction of it."""
    focal_mm = _positive(detail, ExifTags.Base.FocalLength)
    pixels = _positive(detail, ExifTags.Base.FocalPlaneXResolution)
    unit_mm = _UNIT_MM.get(int(detail.get(ExifTags.Base.FocalPlaneResolutionUnit, 2)))
    if focal_mm is None or pixels is None or unit_mm is None:
        return None
    taken_px = _positive(detail, ExifTags.Base.ExifImageWidth) or width_px
    return _square(focal_mm * pixels / unit_mm * width_px / taken_px, width_px, height_px)


def _on_sensor(width_px: int, height_px: int, model: str, detail: Exif) -> Lens | None:
    focal_mm = _positive(detail, ExifTags.Base.FocalLength)
    width_mm = _WIDTH_MM.get(model)
    if focal_mm is None or width_mm is None or height_px > width_px:
        return None
    return _square(focal_mm / width_mm * width_px, width_px, height_px)


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
    return _square(film_mm * math.hypot(longer, uncut) / _FILM_DIAGONAL_MM, width_px, height_px)


def _square(focal_px: float, width_px: int, height_px: int) -> Lens:
    middle = ((width_px - 1) / 2.0, (height_px - 1) / 2.0)
    return Lens(width_px, height_px, focal_px, focal_px, *middle)


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
