"""GeoJSON of RFC 7946, and older files that name a coordinate system in `crs`."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any, Final

import pyproj

from missions.errors import AreaError
from uavmap.base.printable import printable
from uavmap.load.areas.drawing import (
    WGS84,
    Layer,
    Point,
    Shape,
    crs_of_epsg,
    layer_of,
    number,
    shapes_of,
    shown_name,
)

_NAMES: Final = ("name", "title", "label", "kind", "id", "fid", "objectid")
_EPSG: Final = re.compile(r"(?:urn:(?:x-)?ogc:def:crs:)?EPSG:[^:]*:?(\d{4,6})$", re.IGNORECASE)
_CRS84: Final = re.compile(r"(?:urn:ogc:def:crs:)?OGC:[^:]*:?CRS84$", re.IGNORECASE)
_DEEPEST: Final = 20


def read_geojson(text: str, source: str) -> Layer:
    """Read the polygons of a GeoJSON file, or of one with a feature a line. Raises `AreaError`."""
    root = _parsed(text, source)
    if not isinstance(root, dict):
        raise AreaError(f"{source}: JSON, but no GeoJSON; save the polygon as GeoJSON")
    kind = root.get("type")
    if kind == "Topology":
        raise AreaError(f"{source}: TopoJSON is not read; save it as GeoJSON")
    if "rings" in root or "spatialReference" in root or "geometryType" in root:
        raise AreaError(f"{source}: the JSON of ESRI is not read; export it as GeoJSON")
    if not isinstance(kind, str):
        raise AreaError(f"{source}: JSON, but no GeoJSON; save the polygon as GeoJSON")
    notices: list[str] = []
    system = system_of(root.get("crs"), source)
    return layer_of(_shapes(root, source, notices), system, source, notices)


def _parsed(text: str, source: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        lines = [line.strip("\x1e \t\r") for line in text.split("\n")]
        lines = [line for line in lines if line]
        if lines and all(line.startswith("{") for line in lines):
            try:  # GeoJSON text sequences: QGIS and GDAL write a feature a line
                return {"type": "FeatureCollection", "features": [json.loads(s) for s in lines]}
            except (ValueError, RecursionError):
                pass
        reason = "nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise AreaError(f"{source}: not JSON ({printable(reason, 80)})") from None


def system_of(value: object, source: str) -> pyproj.CRS:
    """Return the coordinate system of a member `crs`; WGS84 without one. Raises `AreaError`."""
    if value is None:
        return WGS84
    properties = value.get("properties") if isinstance(value, Mapping) else None
    name = properties.get("name") if isinstance(properties, Mapping) else None
    if isinstance(name, str) and len(name) < 100:
        if _CRS84.match(name):
            return WGS84
        if found := _EPSG.match(name):
            return crs_of_epsg(int(found[1]), source)
    raise AreaError(
        f"{source}: crs = {printable(json.dumps(value)[:200], 60)}: not a system by name such as "
        "urn:ogc:def:crs:EPSG::25832; save the area in WGS84 (EPSG:4326)"
    )


def _shapes(root: Mapping[str, Any], source: str, notices: list[str]) -> Iterator[Shape]:
    features = [root]
    if root.get("type") == "FeatureCollection":
        listed = root.get("features")
        if not isinstance(listed, list):
            raise AreaError(f"{source}: a FeatureCollection without features")
        features = listed
    for i, feature in enumerate(features):
        if not isinstance(feature, Mapping):
            raise AreaError(f"{source}: features[{i}]: no feature; save the polygon as GeoJSON")
        values, geometry = feature, feature
        if feature.get("type") == "Feature":
            geometry = feature.get("geometry") or {}
            values = feature.get("properties") or {}
        name = _name(values, f"polygon {i + 1}")
        where = f"{source}: features[{i}]"
        polygons, lines, points = _Polygons(), _Lines(), list[Point]()
        _collect(geometry, where, _DEEPEST, polygons, lines, points)
        yield from shapes_of(name, where, notices, polygons, lines, points)


def _name(properties: object, otherwise: str) -> str:
    if not isinstance(properties, Mapping):
        return otherwise
    lower = {str(key).lower(): value for key, value in properties.items()}
    for key in _NAMES:
        if (name := shown_name(lower.get(key), "")) != "":
            return name
    return otherwise


_Lines = list[list[Point]]
_Polygons = list[_Lines]


def _collect(
    value: object, where: str, depth: int, polygons: _Polygons, lines: _Lines, points: list[Point]
) -> None:
    if not isinstance(value, Mapping):
        raise AreaError(f"{where}: its geometry is no table")
    kind, inside = value.get("type"), value.get("coordinates")
    if kind == "Polygon":
        polygons.append(_lines(inside, where))
    elif kind == "MultiPolygon":
        polygons += [_lines(part, where) for part in _list(inside, where)]
    elif kind == "Point":
        points.append(_point(inside, where))
    elif kind == "LineString":
        lines.append(_line(inside, where))
    elif kind == "GeometryCollection":
        if depth == 0:
            raise AreaError(f"{where}: collections in collections, more than {_DEEPEST} deep")
        for part in _list(value.get("geometries"), where):
            _collect(part, where, depth - 1, polygons, lines, points)


def _lines(value: object, where: str) -> _Lines:
    return [_line(line, where) for line in _list(value, where)]


def _line(value: object, where: str) -> list[Point]:
    return [_point(point, where) for point in _list(value, where)]


def _list(value: object, where: str) -> list[Any]:
    if not isinstance(value, list):
        raise AreaError(f"{where}: {printable(repr(value), 40)} where a list of positions belongs")
    return value


def _point(value: object, where: str) -> Point:
    values = _list(value, where)
    if len(values) < 2:
        raise AreaError(f"{where}: a position needs longitude and latitude")
    return number(values[0], where), number(values[1], where)
