"""KML, and KMZ, which is KML in a zip archive: as of Google Earth, QGIS, ArcGIS and others."""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Iterator
from itertools import chain
from typing import Final
from xml.etree.ElementTree import Element

from missions.errors import AreaError
from uavmap.base.printable import printable
from uavmap.load.areas import crs
from uavmap.load.areas.archive import read_member
from uavmap.load.areas.drawing import (
    MOST_BYTES,
    Layer,
    Point,
    Role,
    Shape,
    layer_of,
    shapes_of,
    shown_name,
)
from uavmap.load.areas.markup import local, refused, root_of, text_of

_AROUND_COMMA: Final = re.compile(r"\s*,\s*")


def read_kml(root: Element, source: str) -> Layer:
    """The polygons of a KML document, closed paths among them. Raises `AreaError`."""
    layer = _layer(root, source)
    if not _areas(layer) and next(_links(root), None) is not None:
        raise _elsewhere(source)
    return layer


def read_kmz(data: bytes, source: str) -> Iterator[Layer]:
    """Read the first KML file of a KMZ, as Google Earth does, and those in it that it links to.

    GDAL writes a file a layer, and one that links to them. Nothing outside of the archive is read.
    Raises `AreaError`.
    """
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        names = [name for name in archive.namelist() if name.lower().endswith(".kml")]
        if not names:
            raise AreaError(f"{source}: a zip archive without a .kml; save the polygon as KML")
        first = _root_in(archive, names[0], source)
        hrefs = list(dict.fromkeys(_links(first)))
        linked = [name for name in hrefs if name in names[1:]]
        if sum(archive.getinfo(name).file_size for name in linked) > MOST_BYTES:
            raise AreaError(
                f"{source}: its files unpack to more than {MOST_BYTES // 1_000_000} MB; save the "
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
        raise refused(root, source)
    return root


def _layer(root: Element, source: str) -> Layer:
    notices: list[str] = []
    return layer_of(_shapes(root, source, notices), crs.WGS84, source, notices)


def _areas(layer: Layer) -> bool:
    return any(shape.role is Role.AREA for shape in layer.shapes)


def _links(root: Element) -> Iterator[str]:
    for link in root.iter():
        if local(link) == "NetworkLink":
            inside = (text_of(part, "href") for part in link if local(part) in ("Link", "Url"))
            yield next((href for href in inside if href), "").strip()


def _elsewhere(source: str) -> AreaError:
    return AreaError(f"{source}: holds a link to another file; save the polygon itself as KML")


def _shapes(root: Element, source: str, notices: list[str]) -> Iterator[Shape]:
    number = 0
    for placemark in root.iter():
        if local(placemark) != "Placemark":
            continue
        inside = [part for part in placemark.iter() if part is not placemark]
        if any(local(part) == "Placemark" for part in inside):
            # no KML has that, and nested deeply it would be looked through over and over
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
    """The coordinates of an element: longitude, latitude and perhaps a height, commas between."""
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
