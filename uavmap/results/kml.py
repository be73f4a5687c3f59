"""map.kml: the map for Google Earth, in folders with styles.

KML 2.2: coordinates are longitude, latitude and, for tracks, the height above the ground, which
is taken to be level with home. Colours are written alpha, blue, green, red.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path

from shapely.geometry import MultiPolygon

from missions.units import GridPoint, LatLon
from uavmap.results.atomic import write_bytes
from uavmap.results.model import NOT_ROI, MapData, State
from uavmap.results.outline import outline
from uavmap.results.palette import OUTLINE, STATES, UNSEARCHED, Colour, track_colour

NAMESPACE = "http://www.opengis.net/kml/2.2"


def write(data: MapData, path: Path) -> None:
    """Write the map to `path`."""
    write_bytes(path, encode(data))


def encode(data: MapData) -> bytes:
    """The map as a KML document in UTF-8: folders Outline, Cells (a folder a state), Tracks,
    and Not searched where ground was left out."""
    kml = ET.Element("kml", xmlns=NAMESPACE)
    document = ET.SubElement(kml, "Document")
    _text(document, "name", data.mission)
    _styles(document, data)
    _outline(document, data)
    _cells(document, data)
    _tracks(document, data)
    _unsearched(document, data)
    ET.indent(kml)
    # as text first, which is twice as fast as through ElementTree's own encoder
    text = ET.tostring(kml, encoding="unicode")
    return f"<?xml version='1.0' encoding='utf-8'?>\n{text}\n".encode()


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
    shape = outline(data.roi_cells, data.grid)
    if shape.is_empty:
        return
    mark = _placemark(folder, "Region", "outline")
    _text(mark, "description", f"{len(data.roi_cells)} cells, {shape.area:.0f} m2")
    many = ET.SubElement(mark, "MultiGeometry")
    for part in shape.geoms if isinstance(shape, MultiPolygon) else [shape]:
        polygon = ET.SubElement(many, "Polygon")
        for tag, ring in [("outerBoundaryIs", part.exterior)] + [
            ("innerBoundaryIs", hole) for hole in part.interiors
        ]:
            _ring(polygon, tag, data, (GridPoint(e, n) for e, n, *_ in ring.coords))


def _cells(document: ET.Element, data: MapData) -> None:
    folder = _folder(document, "Cells")
    for state in STATES:
        rows = [row for row in data.cells if row.state == state]
        if not rows:
            continue
        inner = _folder(folder, state)
        for row in rows:
            mark = _placemark(inner, f"{row.cell.east}, {row.cell.north}", _style_id(state))
            _text(mark, "description", f"{row.positive} of {row.votes} frames positive")
            corners = data.grid.corners_of(row.cell)
            polygon = ET.SubElement(mark, "Polygon")
            _ring(polygon, "outerBoundaryIs", data, [*corners, corners[0]])


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


def _placemark(parent: ET.Element, name: str, style: str) -> ET.Element:
    mark = ET.SubElement(parent, "Placemark")
    _text(mark, "name", name)
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
