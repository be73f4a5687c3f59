"""KML, and KMZ, which is KML in a zip archive: as of Google Earth, QGIS, ArcGIS and others."""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Iterator
from typing import Final
from xml.etree.ElementTree import Element, ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from missions.errors import AreaError
from uavmap.areas import crs
from uavmap.areas.archive import read_member
from uavmap.areas.drawing import (
    Layer,
    Point,
    Role,
    Shape,
    bounded,
    names_home,
    polygon,
    shown_name,
)
from uavmap.printable import printable

_AROUND_COMMA: Final = re.compile(r"\s*,\s*")


def read_kml(data: bytes, source: str) -> Layer:
    """The polygons of a KML file, closed paths among them. Raises `AreaError`."""
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
    if _local(root) != "kml":
        raise AreaError(f"{source}: XML, but no KML: its root is {_local(root)[:40]!r}")
    notices: list[str] = []
    shapes = bounded(_shapes(root, source, notices), source)
    if not any(shape.role is Role.AREA for shape in shapes) and _has(root, "NetworkLink"):
        raise AreaError(f"{source}: holds a link to another file; save the polygon itself as KML")
    return Layer(shapes, crs.WGS84, tuple(notices))


def read_kmz(data: bytes, source: str) -> Layer:
    """The first KML file of a KMZ, as Google Earth takes it. Raises `AreaError`."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        names = [name for name in archive.namelist() if name.lower().endswith(".kml")]
        if not names:
            raise AreaError(f"{source}: a zip archive without a .kml; save the polygon as KML")
        return read_kml(read_member(archive, names[0], source), source)


def _local(element: Element) -> str:
    """The name of an element without its namespace, which differs from tool to tool."""
    tag = element.tag
    return tag.rpartition("}")[2] if isinstance(tag, str) else ""


def _has(root: Element, name: str) -> bool:
    return any(_local(element) == name for element in root.iter())


def _text(element: Element, name: str) -> str | None:
    return next((child.text for child in element if _local(child) == name), None)


def _shapes(root: Element, source: str, notices: list[str]) -> Iterator[Shape]:
    number, paths = 0, 0
    for placemark in root.iter():
        if _local(placemark) != "Placemark":
            continue
        inside = [part for part in placemark.iter() if part is not placemark]
        if any(_local(part) == "Placemark" for part in inside):
            # no KML has that, and nested deeply it would be looked through over and over
            raise AreaError(f"{source}: a placemark in a placemark; save it anew as KML")
        parts = [part for part in inside if _local(part) in _KINDS]
        polygons = [part for part in parts if _local(part) == "Polygon"]
        title = _text(placemark, "name")
        for i, part in enumerate(polygons):
            number += 1
            name = shown_name(title, f"polygon {number}")
            name += f" ({i + 1})" if len(polygons) > 1 else ""
            yield polygon(name, list(_rings(part, source, name)), f"{source}: {name}")
        for part in parts:
            kind, name = _local(part), shown_name(title, "path")
            if kind == "Point" and names_home(name):
                for point in _points(part, source, name)[:1]:
                    yield Shape(name, Role.HOME, (point,))
            elif kind == "LineString":
                points = _points(part, source, name)
                if len(points) > 3 and points[0] == points[-1]:
                    yield polygon(name, [points], f"{source}: {name}")
                else:
                    paths += 1
    if paths:
        notices.append(f"{paths} open paths are left out; an area is a polygon")


_KINDS: Final = ("Polygon", "Point", "LineString")


def _rings(part: Element, source: str, name: str) -> Iterator[list[Point]]:
    for kind in ("outerBoundaryIs", "innerBoundaryIs"):
        for boundary in part:
            if _local(boundary) == kind:
                # old files have several rings in one inner boundary
                for ring in boundary:
                    yield _points(ring, source, name)


def _points(part: Element, source: str, name: str) -> list[Point]:
    """The coordinates of an element: longitude, latitude and perhaps a height, commas between."""
    text = next((e.text or "" for e in part.iter() if _local(e) == "coordinates"), "")
    found: list[Point] = []
    for word in _AROUND_COMMA.sub(",", text).split():
        parts = word.split(",")
        try:
            found.append((float(parts[0]), float(parts[1])))
        except (ValueError, IndexError):
            raise AreaError(
                f"{source}: {name}: {printable(word, 40)!r} is not longitude,latitude[,height]"
            ) from None
    return found
