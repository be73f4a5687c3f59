"""pictures.csv: the fate of each picture of a replay."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from pathlib import Path
from typing import Final, NamedTuple

from uavmap.base.atomic_write import write_text
from uavmap.base.printable import printable
from uavmap.photos.sources.picture_record import Picture
from vision.registration.views import Measured

FILE: Final = "pictures.csv"
_POSE: Final = ("lat_deg", "lon_deg", "height_m", "yaw_deg", "pitch_deg", "roll_deg")
_REFINED: Final = tuple(f"refined_{column}" for column in _POSE)
COLUMNS: Final = (
    "picture", "used", "reason", "cells", "upside_down", "taken_s", "lat_deg", "lon_deg",
    "height_m", "amsl_m", "yaw_deg", "pitch_deg", "roll_deg", "hfov_deg", *_REFINED,
    "refined_sigma_m", "notes",
)  # fmt: skip
"""The pose as tagged; the refined one is empty where none was estimated."""


class PictureRow(NamedTuple):
    """A picture as tagged and as refined, or a file that is none, and why it is not used."""

    picture: Picture | None
    name: str
    reason: str
    cells: int
    turned: bool
    refined: Picture | None = None


def write_pictures(rows: Iterable[PictureRow], path: Path) -> None:
    """Write a line for each picture."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, COLUMNS, restval="", lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow(_values(row))
    write_text(path, text.getvalue())


def _values(row: PictureRow) -> dict[str, str | int]:
    values: dict[str, str | int] = {
        "picture": _cell(row.name),
        "used": "no" if row.reason else "yes",
        "reason": _cell(row.reason),
        "cells": row.cells,
        "upside_down": "yes" if row.turned else "",
    }
    picture = row.picture
    if picture is None:
        return values
    values |= {
        "taken_s": "" if picture.taken_s is None else f"{picture.taken_s:.3f}",
        **dict(zip(_POSE, _pose(picture), strict=True)),
        "amsl_m": _number(picture.amsl_m),
        "hfov_deg": "" if picture.lens is None else f"{picture.lens.hfov_deg:.2f}",
        "notes": _cell("; ".join(picture.notes)),
    }
    if row.refined is not None and row.refined.position is not None:
        values |= dict(zip(_REFINED, _pose(row.refined), strict=True))
        values["refined_sigma_m"] = f"{row.refined.position_sigma_m:.2f}"
    return values


def _pose(picture: Picture) -> tuple[str, ...]:
    place = picture.position
    angles = picture.height_m, picture.yaw_deg, picture.pitch_deg, picture.roll_deg
    lat_lon = ("", "") if place is None else (f"{place.lat_deg:.8f}", f"{place.lon_deg:.8f}")
    return (*lat_lon, *map(_number, angles))


def _number(measured: Measured | None) -> str:
    return "" if measured is None else f"{measured.value:.2f}"


def _cell(text: str) -> str:
    """Return text from outside, harmless also where a spreadsheet takes it for a formula."""
    clean = printable(text)
    return f"'{clean}" if clean[:1] in ("=", "+", "-", "@") else clean
