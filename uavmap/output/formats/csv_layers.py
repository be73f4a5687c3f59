"""A CSV file per layer: its columns, longitude and latitude, and WKT of lines and areas.

RFC 4180, UTF-8; a text that a spreadsheet would take for a formula gets an apostrophe in front.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

import shapely

from uavmap.output.facts.flown_mission import FlownMission
from uavmap.output.formats.layers import DECIMALS, Layer, described, in_degrees, text_of

_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def encode(flown: FlownMission, layers: Sequence[Layer]) -> dict[str, bytes]:
    """Encode the files by name; `about.csv` describes the map."""
    about = [("name", "value"), *((name, _cell(v)) for name, v in described(flown).items())]
    return {
        "about.csv": _lines(about),
        **{f"{layer.name}.csv": _table(flown, layer) for layer in layers},
    }


def _table(flown: FlownMission, layer: Layer) -> bytes:
    shapes = in_degrees(layer, flown.data)
    points = shapes if layer.geometry == "Point" else shapely.centroid(shapes)
    lons, lats = shapely.get_x(points).round(DECIMALS), shapely.get_y(points).round(DECIMALS)
    places: list[tuple[object, ...]] = list(zip(lons.tolist(), lats.tolist(), strict=True))
    head = [field.name for field in layer.fields] + ["lon_deg", "lat_deg"]
    if layer.geometry != "Point":
        head.append("wkt")
        texts = shapely.to_wkt(shapes, rounding_precision=DECIMALS)
        places = [(*place, text) for place, text in zip(places, texts, strict=True)]
    rows = (
        [_cell(value) for value in (*row, *place)]
        for row, place in zip(layer.rows, places, strict=True)
    )
    return _lines([head, *rows])


def _cell(value: object) -> str:
    if value is None or value != value:  # NaN: a row without a place
        return ""
    text = text_of(value)
    return f"'{text}" if isinstance(value, str) and text.startswith(_FORMULA) else text


def _lines(rows: Sequence[Sequence[str]]) -> bytes:
    buffer = io.StringIO(newline="")
    csv.writer(buffer).writerows(rows)
    return buffer.getvalue().encode(errors="backslashreplace")
