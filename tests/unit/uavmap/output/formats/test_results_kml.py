"""map.kml, read back with an XML parser."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable

import pytest

from uavmap.output.drawing.palette import STATES
from uavmap.output.facts.map_model import MapData
from uavmap.output.formats import kml_encoder as kml

MapMaker = Callable[..., MapData]

NS = {"k": kml.NAMESPACE}


def read(data: MapData) -> ET.Element:
    return ET.fromstring(kml.encode_map(data))


def folder(root: ET.Element, name: str) -> ET.Element:
    (found,) = [f for f in root.iter(f"{{{kml.NAMESPACE}}}Folder") if f[0].text == name]
    return found


def places(element: ET.Element) -> list[tuple[float, ...]]:
    text = element.findtext(".//k:coordinates", namespaces=NS) or ""
    return [tuple(map(float, place.split(","))) for place in text.split()]


def test_the_name_is_escaped(make_map: MapMaker) -> None:
    assert read(make_map()).findtext("k:Document/k:name", namespaces=NS) == "test <map> & more"


def test_a_folder_for_every_state_that_occurs(make_map: MapMaker) -> None:
    cells = folder(read(make_map()), "Cells")
    counts = {f[0].text: len(f.findall("k:Placemark", NS)) for f in cells.findall("k:Folder", NS)}
    assert counts == {
        "explored": 22,
        "under exploration": 1,
        "unexplored": 1,
        "non-roi": 5,
    }


def test_every_style_is_defined(make_map: MapMaker) -> None:
    root = read(make_map())
    used = {e.text for e in root.iter(f"{{{kml.NAMESPACE}}}styleUrl")}
    defined = {"#" + e.attrib["id"] for e in root.iter(f"{{{kml.NAMESPACE}}}Style")}
    assert used <= defined


def test_colours_are_written_backwards(make_map: MapMaker) -> None:
    root = read(make_map())
    (style,) = root.findall(".//k:Style[@id='explored']", NS)
    red, green, blue = STATES["explored"]
    assert style.findtext("k:LineStyle/k:color", namespaces=NS) == (
        f"ff{blue:02x}{green:02x}{red:02x}"
    )


def test_the_outline_has_a_hole_and_closed_rings(make_map: MapMaker) -> None:
    outline = folder(read(make_map()), "Outline")
    assert len(outline.findall(".//k:Polygon", NS)) == 2
    assert len(outline.findall(".//k:innerBoundaryIs", NS)) == 1
    for ring in outline.iter(f"{{{kml.NAMESPACE}}}LinearRing"):
        corners = places(ring)
        assert corners[0] == corners[-1]
        assert all(lon == pytest.approx(9.53, abs=0.001) for lon, _ in corners)


def test_tracks_fly_above_the_ground(make_map: MapMaker) -> None:
    tracks = folder(read(make_map()), "Tracks")
    assert tracks.findtext(".//k:altitudeMode", namespaces=NS) == "relativeToGround"
    assert [height_m for _, _, height_m in places(tracks)] == [12, 13, 14, 15, 16]


def test_a_map_of_nothing_is_still_a_document(empty_map: MapData) -> None:
    root = read(empty_map)
    assert len(root.findall(".//k:Folder", NS)) == 3
    assert not root.findall(".//k:Placemark", NS)
