"""map.kml: the map for Google Earth, in folders with styles.

KML 2.2: coordinates are longitude, latitude and, for tracks, the height above the ground, which
is taken to be level with home. Colours are written alpha, blue, green, red.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from shapely.geometry import MultiPolygon

from missions.units import GridPoint, LatLon
from uavmap.output.drawing.palette import OUTLINE, STATES, UNSEARCHED, Colour, track_colour
from uavmap.results.atomic import write_parts
from uavmap.results.model import NOT_ROI, MapData, State

NAMESPACE = "http://www.opengis.net/kml/2.2"


def write(data: MapData, path: Path) -> None:
    """Write the map to `path`."""
    write_parts(path, (f"{line}\n".encode() for line in _all_lines(data)))


def encode(data: MapData) -> bytes:
    """The map as a KML document in UTF-8: folders Outline, Cells (a folder a state), Tracks,
    and Not searched where ground was left out."""
    return "".join(f"{line}\n" for line in _all_lines(data)).encode()


def _all_lines(data: MapData) -> Iterator[str]:
    document, after = ET.Element("Document"), ET.Element("Document")
    _text(document, "name", data.mission)
    _styles(document, data)
    _outline(document, data)
    _tracks(after, data)
    _unsearched(after, data)
    yield "<?xml version='1.0' encoding='utf-8'?>"
    yield f'<kml xmlns="{NAMESPACE}">'
    yield "  <Document>"
    yield from _written(document)
    yield from _cells(data)
    yield from _written(after)
    yield "  </Document>"
    yield "</kml>"


def _written(document: ET.Element) -> Iterator[str]:
    """The parts of the document as text, indented as they lie in the file."""
    for part in document:
        ET.indent(part, level=2)
        part.tail = None
        yield f"    {ET.tostring(part, encoding='unicode')}"


# --- styles ----------------------------------------------------------------------------------
def _styles(document: ET.Element, data: MapData) -> None:
    for state, colour in STATES.items():
        style = ET.SubElement(document, "Style", id=_style_id(state))
        _line_style(style, colour, 255, 1)
        poly = ET.SubElement(style, "PolyStyle")
        _text(poly, "color", _abgr(colour, 90 if state in NOT_ROI else 150))
    style = ET.SubElement(document, "Style", id="outline")
    _line_style(style, OUTLINE, 255, 3)
    _text(ET.SubElement(style, "PolyStyle"), "fill", "0")
    if data.unsearched:
        _line_style(ET.SubElement(document, "Style", id="unsearched"), UNSEARCHED, 255, 3)
    for track in data.tracks:
        style = ET.SubElement(document, "Style", id=f"track-{track.vehicle}")
        _line_style(style, track_colour(track.vehicle), 220, 2)


def _line_style(style: ET.Element, colour: Colour, alpha: int, width: int) -> None:
    line = ET.SubElement(style, "LineStyle")
    _text(line, "color", _abgr(colour, alpha))
    _text(line, "width", str(width))


def _style_id(state: State) -> str:
    return state.replace(" ", "-")


def _abgr(colour: Colour, alpha: int) -> str:
    red, green, blue = colour
    return f"{alpha:02x}{blue:02x}{green:02x}{red:02x}"


# --- folders ---------------------------------------------------------------------------------
def _outline(document: ET.Element, data: MapData) -> None:
    folder = _folder(document, "Outline")
    shape = data.outline
    if shape.is_empty:
        return
    told = f"{len(data.roi_cells)} cells, {shape.area:.0f} m2"
    mark = _placemark(folder, "Region", "outline", told)
    many = ET.SubElement(mark, "MultiGeometry")
    for part in shape.geoms if isinstance(shape, MultiPolygon) else [shape]:
        polygon = ET.SubElement(many, "Polygon")
        for tag, ring in [("outerBoundaryIs", part.exterior)] + [
            ("innerBoundaryIs", hole) for hole in part.interiors
        ]:
            _ring(polygon, tag, data, (GridPoint(e, n) for e, n, *_ in ring.coords))


def _cells(data: MapData) -> Iterator[str]:
    """The lines of the folder of cells. There are thousands of these, so they are written without
    a tree of elements: numbers, and names of states that need no quoting."""
    yield "    <Folder>\n      <name>Cells</name>"
    for state in STATES:
        there = data.table.are(state)
        if not there.any():
            continue
        yield f"      <Folder>\n        <name>{state}</name>"
        some, corners = data.table.which(there), data.corners.which(there)
        for table, rings in zip(some.parts(), corners.written(_places), strict=True):
            for ring, row in zip(rings, table.values(), strict=True):
                (east, north), _, positive, votes, _ = row
                closed = " ".join([*ring, ring[0]])
                yield _CELL.format(east, north, _style_id(state), positive, votes, closed)
        yield "      </Folder>"
    yield "    </Folder>"


def _places(lon_deg: NDArray[np.float64], lat_deg: NDArray[np.float64]) -> list[str]:
    """Corners of cells as they are written."""
    both = zip(lon_deg.tolist(), lat_deg.tolist(), strict=True)
    return [f"{lon:.7f},{lat:.7f}" for lon, lat in both]


_CELL: Final = """\
        <Placemark>
          <name>{0}, {1}</name>
          <description>{3} of {4} frames positive</description>
          <styleUrl>#{2}</styleUrl>
          <Polygon>
            <outerBoundaryIs>
              <LinearRing>
                <coordinates>{5}</coordinates>
              </LinearRing>
            </outerBoundaryIs>
          </Polygon>
        </Placemark>"""


def _tracks(document: ET.Element, data: MapData) -> None:
    folder = _folder(document, "Tracks")
    for track in data.tracks:
        if len(track.points) < 2:
            continue
        mark = _placemark(folder, f"Vehicle {track.vehicle}", f"track-{track.vehicle}")
        line = ET.SubElement(mark, "LineString")
        _text(line, "altitudeMode", "relativeToGround")
        _text(
            line,
            "coordinates",
            " ".join(f"{_lon_lat(place)},{height_m:.2f}" for _, place, height_m in track.points),
        )


def _unsearched(document: ET.Element, data: MapData) -> None:
    if not data.unsearched:
        return
    folder = _folder(document, "Not searched")
    for number, lane in enumerate(data.unsearched, start=1):
        mark = _placemark(folder, f"Lane {number}, without a judged frame", "unsearched")
        line = ET.SubElement(mark, "LineString")
        _text(line, "tessellate", "1")
        _text(line, "coordinates", " ".join(_lon_lat(place) for place in lane))


def _folder(parent: ET.Element, name: str) -> ET.Element:
    folder = ET.SubElement(parent, "Folder")
    _text(folder, "name", name)
    return folder


def _placemark(parent: ET.Element, name: str, style: str, description: str = "") -> ET.Element:
    """Its elements stand in the order of the schema."""
    mark = ET.SubElement(parent, "Placemark")
    _text(mark, "name", name)
    if description:
        _text(mark, "description", description)
    _text(mark, "styleUrl", f"#{style}")
    return mark


def _ring(polygon: ET.Element, tag: str, data: MapData, points: Iterable[GridPoint]) -> None:
    ring = ET.SubElement(ET.SubElement(polygon, tag), "LinearRing")
    places = (data.place(point) for point in points)
    _text(ring, "coordinates", " ".join(_lon_lat(place) for place in places))


def _lon_lat(place: LatLon) -> str:
    return f"{place.lon_deg:.7f},{place.lat_deg:.7f}"


def _text(parent: ET.Element, tag: str, text: str) -> None:
    ET.SubElement(parent, tag).text = text
