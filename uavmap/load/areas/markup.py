"""KML, KMZ (KML in a zip archive) and GPX, as of Google Earth, QGIS, ArcGIS and others.

Their XML is parsed without document types, entities and external files. A GPX track or route that
returns to its beginning is the outline of a field.
"""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Iterator
from itertools import chain, pairwise
from typing import Final
from xml.etree.ElementTree import Element, ParseError

import pyproj
import shapely
from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring
from shapely import STRtree
from shapely.geometry import LinearRing, LineString, Polygon
from shapely.geometry.base import BaseGeometry

from missions.errors import AreaError
from uavmap.base.printable import printable
from uavmap.load.areas.archive import read_member
from uavmap.load.areas.drawing import (
    MAX_BYTES,
    WGS84,
    Layer,
    Point,
    Role,
    Shape,
    layer_of,
    number,
    shapes_of,
    shown_name,
)

_ELSEWHERE: Final = {
    "osm": "data of OpenStreetMap; export it as GeoJSON, as overpass turbo does",
    "FeatureCollection": "GML; export it as GeoJSON",
    "TrainingCenterDatabase": "a training of Garmin; export it as GPX",
    "qgis": "a project of QGIS, which holds no shapes; export the layer as GeoJSON",
    "ugcs-Transfer": "a mission of UgCS; export its route as KML",
}
"""Other common kinds of XML and their remedies, by the root element."""


def root_of(data: bytes, source: str) -> Element:
    """Parse an XML document and return its root. Raises `AreaError`."""
    try:
        root = fromstring(data, forbid_dtd=True)
    except DefusedXmlException:
        raise AreaError(
            f"{source}: XML with a document type or entities, which no KML has; save it anew"
        ) from None
    except (ParseError, ValueError, LookupError) as error:
        raise AreaError(
            f"{source}: not well-formed XML ({printable(str(error), 80)}); save it anew as KML"
        ) from None
    if not isinstance(root, Element):
        raise AreaError(f"{source}: XML without an element; save it anew as KML")
    return root


def local(element: Element) -> str:
    """Return the name of an element without its namespace, which differs from tool to tool."""
    tag = element.tag
    return tag.rpartition("}")[2] if isinstance(tag, str) else ""


def text_of(element: Element, name: str) -> str | None:
    """Return the text of the first child of this name; None without one."""
    return next((child.text for child in element if local(child) == name), None)


def unsupported_xml(root: Element, source: str) -> AreaError:
    """Return the error for XML that is neither KML nor GPX."""
    name = local(root)
    if name in _ELSEWHERE:
        return AreaError(f"{source}: {_ELSEWHERE[name]}")
    return AreaError(
        f"{source}: XML, but not KML or GPX: its root is {printable(name, 40)!r}; save the "
        "polygon as KML"
    )


# --- KML and KMZ ----------------------------------------------------------------------------------
_AROUND_COMMA: Final = re.compile(r"\s*,\s*")


def read_kml(root: Element, source: str) -> Layer:
    """Read the polygons and the closed paths of a KML document. Raises `AreaError`."""
    layer = _layer(root, source)
    if not _areas(layer) and next(_links(root), None) is not None:
        raise _elsewhere(source)
    return layer


def read_kmz(data: bytes, source: str) -> Iterator[Layer]:
    """Read the first KML file of a KMZ, and those in the archive that it links to (GDAL's form).

    It reads no file outside of the archive. Raises `AreaError`.
    """
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        names = [name for name in archive.namelist() if name.lower().endswith(".kml")]
        if not names:
            raise AreaError(f"{source}: a zip archive without a .kml; save the polygon as KML")
        first = _root_in(archive, names[0], source)
        hrefs = list(dict.fromkeys(_links(first)))
        linked = [name for name in hrefs if name in names[1:]]
        if sum(archive.getinfo(name).file_size for name in linked) > MAX_BYTES:
            raise AreaError(
                f"{source}: its files unpack to more than {MAX_BYTES // 1_000_000} MB; save the "
                "area alone"
            )
        areas = False
        for root in chain([first], (_root_in(archive, name, source) for name in linked)):
            layer = _layer(root, source)
            areas = areas or _areas(layer)
            yield layer
    if not areas and len(linked) < len(hrefs):
        raise _elsewhere(source)


def _root_in(archive: zipfile.ZipFile, name: str, source: str) -> Element:
    root = root_of(read_member(archive, name, source), source)
    if local(root) != "kml":
        raise unsupported_xml(root, source)
    return root


def _layer(root: Element, source: str) -> Layer:
    notices: list[str] = []
    return layer_of(_kml_shapes(root, source, notices), WGS84, source, notices)


def _areas(layer: Layer) -> bool:
    return any(shape.role is Role.AREA for shape in layer.shapes)


def _links(root: Element) -> Iterator[str]:
    for link in root.iter():
        if local(link) == "NetworkLink":
            inside = (text_of(part, "href") for part in link if local(part) in ("Link", "Url"))
            yield next((href for href in inside if href), "").strip()


def _elsewhere(source: str) -> AreaError:
    return AreaError(f"{source}: holds a link to another file; save the polygon itself as KML")


def _kml_shapes(root: Element, source: str, notices: list[str]) -> Iterator[Shape]:
    number = 0
    for placemark in root.iter():
        if local(placemark) != "Placemark":
            continue
        inside = [part for part in placemark.iter() if part is not placemark]
        if any(local(part) == "Placemark" for part in inside):
            # KML forbids it, and a deeply nested file would be searched again and again
            raise AreaError(f"{source}: a placemark in a placemark; save it anew as KML")
        of_polygons = {ring for part in inside if local(part) in _BOUNDARIES for ring in part}
        parts = [part for part in inside if local(part) in _KINDS and part not in of_polygons]
        polygons = [part for part in parts if local(part) == "Polygon"]
        number += bool(polygons)
        otherwise = f"polygon {number}" if polygons else "path"
        name = shown_name(text_of(placemark, "name"), otherwise)
        where = f"{source}: {name}"
        yield from shapes_of(
            name,
            where,
            notices,
            [list(_rings(part, where)) for part in polygons],
            [_points(part, where) for part in parts if local(part) in _LINES],
            [p for part in parts if local(part) == "Point" for p in _points(part, where)[:1]],
        )


_LINES: Final = ("LineString", "LinearRing")
_KINDS: Final = ("Polygon", "Point", *_LINES)
_BOUNDARIES: Final = ("outerBoundaryIs", "innerBoundaryIs")


def _rings(part: Element, where: str) -> Iterator[list[Point]]:
    for kind in _BOUNDARIES:
        for boundary in part:
            if local(boundary) == kind:
                # old files have several rings in one inner boundary
                for ring in boundary:
                    yield _points(ring, where)


def _points(part: Element, where: str) -> list[Point]:
    text = next((e.text or "" for e in part.iter() if local(e) == "coordinates"), "")
    found: list[Point] = []
    for word in _AROUND_COMMA.sub(",", text).split():
        parts = word.split(",")
        try:
            found.append((float(parts[0]), float(parts[1])))
        except (ValueError, IndexError):
            raise AreaError(
                f"{where}: {printable(word, 40)!r} is not longitude,latitude[,height]"
            ) from None
    return found


# --- GPX ------------------------------------------------------------------------------------------
_GEOD: Final = pyproj.Geod(ellps="WGS84")
_CLOSED: Final = 0.05
"""Maximum gap between the ends of the track around a field, as a share of its length."""
_LOOPS: Final = 0.05
"""Maximum area of the loops beside the field, where the track crosses itself, as a share."""
_MAX_MENDED: Final = 3000
"""Maximum points of all tracks for a search of crossings: every two lines may cross."""
_MAX_CROSSINGS: Final = 100
_FINE_DEG: Final = 1e-6
"""Tolerance of the outline, degrees: 0.1 m, less than the error of a receiver."""


def read_gpx(root: Element, source: str) -> Layer:
    """The outlines and the home of a GPX document. Raises `AreaError`."""
    notices: list[str] = []
    return layer_of(_gpx_shapes(root, source, notices), WGS84, source, notices)


def _gpx_shapes(root: Element, source: str, notices: list[str]) -> Iterator[Shape]:
    open_ones, looked_at = 0, 0
    for name, points in _tracks(root, source):
        if len(points) < 3 or not _is_closed(points):
            open_ones += 1
            continue
        looked_at += len(points)
        if looked_at <= _MAX_MENDED:
            points = _without_loops(points, name, notices)
        yield from shapes_of(name, f"{source}: {name}", notices, [[points]])
    for element in root:
        if local(element) == "wpt":
            name = shown_name(text_of(element, "name"), "")
            yield from shapes_of(name, source, notices, [], points=[_place(element, source)])
    if open_ones:
        notices.append(
            f"{open_ones} tracks or routes are left out: they do not return to their beginning"
        )


def _tracks(root: Element, source: str) -> Iterator[tuple[str, list[Point]]]:
    count = 0
    for track in root:
        if local(track) not in ("trk", "rte"):
            continue
        count += 1
        name = shown_name(text_of(track, "name"), f"track {count}")
        segments = [part for part in track if local(part) == "trkseg"] or [track]
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
            f"{source}: lat={printable(lat, 20)!r} lon={printable(lon, 20)!r} of a point are not "
            "degrees; save the track anew"
        ) from None


def _is_closed(points: list[Point]) -> bool:
    """Return whether the ends of a track are near each other for its length."""
    lons, lats = zip(*points, strict=True)
    gap_m = _GEOD.inv(*points[-1], *points[0])[2]
    return bool(gap_m <= _CLOSED * _GEOD.line_length(lons, lats))


def _without_loops(points: list[Point], name: str, notices: list[str]) -> list[Point]:
    """Return the outline without small loops, which walkers make, mostly at the end.

    A large loop, as in a figure of eight, stays, and a later check reports it.
    """
    ring = LinearRing(points).simplify(_FINE_DEG)
    if ring.is_simple or _crossings(ring) > _MAX_CROSSINGS:
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
