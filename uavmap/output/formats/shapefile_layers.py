"""A Shapefile per layer, in the UTM zone of the grid, with the date of the map.

Times are text, because a .dbf has no hours. A text is cut at 254 bytes.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from datetime import date
from typing import Any, Final

import pyproj
import shapefile
import shapely

from uavmap.output.facts.flown_mission import FlownMission
from uavmap.output.formats.layers import Layer

_MAX_BYTES: Final = 254
_NO_DATE: Final = date(1970, 1, 1)
_TYPES: Final = {
    "text": ("C", _MAX_BYTES, 0), "time": ("C", 24, 0), "whole": ("N", 18, 0),
    "number": ("N", 24, 6), "yes or no": ("L", 1, 0),
}  # fmt: skip
_SHAPES: Final = {
    ("Point", False): shapefile.POINT, ("Point", True): shapefile.POINTZ,
    ("LineString", False): shapefile.POLYLINE, ("LineString", True): shapefile.POLYLINEZ,
    ("Polygon", False): shapefile.POLYGON, ("MultiPolygon", False): shapefile.POLYGON,
}  # fmt: skip


def encode(flown: FlownMission, layers: Sequence[Layer]) -> dict[str, bytes]:
    """Encode the files by name."""
    prj = pyproj.CRS.from_epsg(flown.data.grid.zone.epsg).to_wkt("WKT1_ESRI").encode()
    when = flown.calendar.date(flown.data.t_s)
    files: dict[str, bytes] = {}
    for layer in layers:
        files |= _family(layer, _NO_DATE if when is None else when.date())
        files |= {f"{layer.name}.prj": prj, f"{layer.name}.cpg": b"UTF-8"}
    return files


def _family(layer: Layer, when: date) -> dict[str, bytes]:
    parts = {suffix: io.BytesIO() for suffix in ("shp", "shx", "dbf")}
    kind = _SHAPES[layer.geometry, layer.heights]
    with shapefile.Writer(**parts, shapeType=kind, encoding="utf-8") as writer:
        for field in layer.fields:
            writer.field(field.name, *_TYPES[field.kind])
        for shape, row in zip(layer.shapes, layer.rows, strict=True):
            _put(writer, layer, shape)
            writer.record(*(
                value.encode()[:_MAX_BYTES].decode(errors="ignore")
                if isinstance(value, str)
                else value
                for value in row
            ))  # fmt: skip
    files = {f"{layer.name}.{suffix}": part.getvalue() for suffix, part in parts.items()}
    table = bytearray(files[f"{layer.name}.dbf"])
    table[1:4] = bytes((max(when.year - 1900, 0) % 256, when.month, when.day))
    return {**files, f"{layer.name}.dbf": bytes(table)}


def _put(writer: Any, layer: Layer, shape: Any) -> None:
    if shape is None:
        writer.null()
    elif layer.geometry == "Point":
        place = shapely.get_coordinates(shape, include_z=layer.heights)[0].tolist()
        writer.pointz(*place) if layer.heights else writer.point(*place)
    elif layer.geometry == "LineString":
        line = shapely.get_coordinates(shape, include_z=layer.heights).tolist()
        writer.linez([line]) if layer.heights else writer.line([line])
    else:
        # in a Shapefile, outer rings of areas run clockwise and holes counter-clockwise
        areas = shapely.orient_polygons(shapely.get_parts(shape), exterior_cw=True)
        rings = [ring for area in areas for ring in (area.exterior, *area.interiors)]
        writer.poly([shapely.get_coordinates(ring).tolist() for ring in rings])
