"""GPX: a track or route around a field. One that comes back to where it began is an outline."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Final
from xml.etree.ElementTree import Element

import pyproj
import shapely
from shapely import STRtree
from shapely.geometry import LinearRing, LineString, Polygon
from shapely.geometry.base import BaseGeometry

from missions.errors import AreaError
from uavmap.base.printable import printable
from uavmap.load.areas import crs
from uavmap.load.areas.drawing import Layer, Point, Shape, layer_of, number, shapes_of, shown_name
from uavmap.load.areas.markup import local, text_of

_GEOD: Final = pyproj.Geod(ellps="WGS84")
_CLOSED: Final = 0.05
"""Of its length: as far from each other the ends of the way around a field may be."""
_LOOPS: Final = 0.05
"""Of the area: as much a walker may enclose beside the field, where the way crosses itself."""
_MOST_MENDED: Final = 3000
"""Points of all ways of a file whose crossings are looked for: every two lines may cross."""
_MOST_CROSSINGS: Final = 100
_FINE_DEG: Final = 1e-6
"""A tenth of a metre, less than a receiver knows."""


def read_gpx(root: Element, source: str) -> Layer:
    """The outlines and the home of a GPX document. Raises `AreaError`."""
    notices: list[str] = []
    return layer_of(_shapes(root, source, notices), crs.WGS84, source, notices)


def _shapes(root: Element, source: str, notices: list[str]) -> Iterator[Shape]:
    open_ones, looked_at = 0, 0
    for name, points in _ways(root, source):
        if len(points) < 3 or not _comes_back(points):
            open_ones += 1
            continue
        looked_at += len(points)
        if looked_at <= _MOST_MENDED:
            points = _without_loops(points, name, notices)
        yield from shapes_of(name, f"{source}: {name}", notices, [[points]])
    for element in root:
        if local(element) == "wpt":
            name = shown_name(text_of(element, "name"), "")
            yield from shapes_of(name, source, notices, [], points=[_place(element, source)])
    if open_ones:
        notices.append(
            f"{open_ones} tracks or routes are left out, for they do not come back to where they "
            "began"
        )


def _ways(root: Element, source: str) -> Iterator[tuple[str, list[Point]]]:
    """Name and points of each segment of a track, and of each route."""
    count = 0
    for way in root:
        if local(way) not in ("trk", "rte"):
            continue
        count += 1
        name = shown_name(text_of(way, "name"), f"track {count}")
        segments = [part for part in way if local(part) == "trkseg"] or [way]
        for k, segment in enumerate(segments):
            points = [
                _place(point, source) for point in segment if local(point) in ("trkpt", "rtept")
            ]
            yield f"{name} ({k + 1})" if len(segments) > 1 else name, points


def _place(point: Element, source: str) -> Point:
    lat, lon = point.get("lat", ""), point.get("lon", "")
    try:
        return number(float(lon), source), number(float(lat), source)
    except ValueError:
        raise AreaError(
            f"{source}: lat={printable(lat, 20)!r} lon={printable(lon, 20)!r} of a point are no "
            "degrees; save the track anew"
        ) from None


def _comes_back(points: list[Point]) -> bool:
    """Whether the ends of a way are near each other, for its length."""
    lons, lats = zip(*points, strict=True)
    gap_m = _GEOD.inv(*points[-1], *points[0])[2]
    return bool(gap_m <= _CLOSED * _GEOD.line_length(lons, lats))


def _without_loops(points: list[Point], name: str, notices: list[str]) -> list[Point]:
    """Return the outline without small loops, as walkers make them, mostly at the end.

    One that crosses itself in earnest, as a figure of eight, stays; it is refused later.
    """
    ring = LinearRing(points).simplify(_FINE_DEG)
    if ring.is_simple or _crossings(ring) > _MOST_CROSSINGS:
        return points
    faces = shapely.get_parts(shapely.polygonize([shapely.unary_union(ring)]))
    largest = max(faces, key=shapely.area, default=Polygon())
    if not largest.area >= (1.0 - _LOOPS) * sum(map(shapely.area, faces)):
        return points
    notices.append(f"{name} crosses itself; small loops of it are left out")
    return [(float(x), float(y)) for x, y in largest.exterior.coords]


def _crossings(ring: BaseGeometry) -> int:
    corners = shapely.get_coordinates(ring)
    lines = [LineString(ends) for ends in pairwise(corners)]
    return int(STRtree(lines).query(lines, predicate="crosses").shape[1]) // 2
