"""map.geojson and map.kml, read back with json, shapely and an XML parser."""

import json
import xml.etree.ElementTree as ET
from dataclasses import replace

import pytest
import shapely
from pyproj import Geod
from shapely.geometry import MultiPolygon, shape

from missions.units import Cell, GridPoint
from tests.unit.uavmap.output.maps import empty_map, make_map, written
from uavmap.output.drawing.map_scene import map_scene
from uavmap.output.drawing.palette import STATES
from uavmap.output.drawing.sheet import draw_sheet
from uavmap.output.formats import geojson_encoder as geojson
from uavmap.output.formats import kml_encoder as kml

GEOD = Geod(ellps="WGS84")
NS = {"k": kml.NAMESPACE}
DATE = "2024-05-01T10:11:12.000Z"


def read(data, utc=None):
    return json.loads(written(geojson.write, data, utc))


def of_kind(found, kind):
    return [f for f in found["features"] if f["properties"]["kind"] == kind]


def read_kml(data):
    return ET.fromstring(written(kml.write, data))


def folder(root, name):
    (found,) = [f for f in root.iter(f"{{{kml.NAMESPACE}}}Folder") if f[0].text == name]
    return found


def places(element):
    text = element.findtext(".//k:coordinates", namespaces=NS) or ""
    return [tuple(map(float, place.split(","))) for place in text.split()]


# --- GeoJSON -------------------------------------------------------------------------------------
def test_geometries_are_valid_with_longitudes_first_and_seven_decimals():
    found = read(make_map())
    assert found["type"] == "FeatureCollection"
    assert len(found["features"]) == len(make_map().cells) + 2
    for feature in found["features"]:
        assert feature["type"] == "Feature"
        geometry = shape(feature["geometry"])
        assert geometry.is_valid
        assert geometry.bounds == pytest.approx((9.53, 47.6, 9.53, 47.6), abs=0.001)
        for lon, *_ in shapely.get_coordinates(geometry).tolist():
            assert lon == round(lon, 7)


def test_outline_is_the_union_with_its_hole():
    (outline,) = of_kind(read(make_map()), "outline")
    region = shape(outline["geometry"])
    assert isinstance(region, MultiPolygon)
    assert sorted(len(part.interiors) for part in region.geoms) == [0, 1]
    cells = 24
    assert outline["properties"]["area_m2"] == cells * 16.0
    area_m2, _ = GEOD.geometry_area_perimeter(region)
    assert area_m2 == pytest.approx(cells * 16.0, rel=1e-3)


def test_cell_has_its_votes_and_its_place_on_the_grid():
    data = make_map()
    cells = {f["id"]: f for f in of_kind(read(data), "cell")}
    assert cells["cell 5 5"]["properties"] == {
        "kind": "cell", "column": 5, "row": 5, "state": "unexplored", "positive": 4, "votes": 5,
    }  # fmt: skip
    centre = shape(cells["cell 3 1"]["geometry"]).centroid
    place = data.grid.centre(Cell(3, 1), data.t_s)
    assert (centre.x, centre.y) == pytest.approx((place.lon_deg, place.lat_deg), abs=1e-7)


def test_drifting_map_is_drawn_where_the_region_is():
    still, drifting = (read(make_map(drift_m_s=v))["features"][0] for v in (0.0, 0.4))
    a, b = (shape(f["geometry"]).centroid for f in (still, drifting))
    bearing_deg, _, distance_m = GEOD.inv(a.x, a.y, b.x, b.y)
    assert distance_m == pytest.approx(40.0, abs=0.05)
    assert bearing_deg == pytest.approx(90.0, abs=0.1)


def test_tracks_have_heights_and_times():
    found = read(make_map())
    (track,) = of_kind(found, "track")
    assert found["bbox"][2::3] == [12.0, 16.0]
    assert [place[2] for place in track["geometry"]["coordinates"]] == [12, 13, 14, 15, 16]
    assert (track["properties"]["start_s"], track["properties"]["end_s"]) == (0.0, 100.0)


def test_map_file_is_written_whole_and_dated_if_the_date_is_known(tmp_path):
    path = tmp_path / "map.geojson"
    path.write_text("old")
    geojson.write(make_map(), path)
    assert path.read_text() == written(geojson.write, make_map())
    assert [p.name for p in tmp_path.iterdir()] == ["map.geojson"]
    assert "utc" not in path.read_text()
    found = read(make_map(), DATE)  # a region that drifts has moved by now
    assert found["utc"] == of_kind(found, "outline")[0]["properties"]["utc"] == DATE


# --- KML -----------------------------------------------------------------------------------------
def test_kml_has_a_folder_for_each_state_that_occurs():
    root = read_kml(make_map())
    assert root.findtext("k:Document/k:name", namespaces=NS) == "test <map> & more"
    states = folder(root, "Cells").findall("k:Folder", NS)
    counts = {f[0].text: len(f.findall("k:Placemark", NS)) for f in states}
    assert counts == {"explored": 22, "under exploration": 1, "unexplored": 1, "not region": 5}


def test_kml_styles_are_defined_with_reversed_colours():
    root = read_kml(make_map())
    used = {e.text for e in root.iter(f"{{{kml.NAMESPACE}}}styleUrl")}
    assert used <= {"#" + e.attrib["id"] for e in root.iter(f"{{{kml.NAMESPACE}}}Style")}
    (style,) = root.findall(".//k:Style[@id='explored']", NS)
    red, green, blue = STATES["explored"]
    colour = style.findtext("k:LineStyle/k:color", namespaces=NS)
    assert colour == f"ff{blue:02x}{green:02x}{red:02x}"


def test_kml_outline_has_a_hole_and_tracks_are_above_ground():
    root = read_kml(make_map())
    outline, tracks = folder(root, "Outline"), folder(root, "Tracks")
    assert len(outline.findall(".//k:Polygon", NS)) == 2
    assert len(outline.findall(".//k:innerBoundaryIs", NS)) == 1
    for ring in outline.iter(f"{{{kml.NAMESPACE}}}LinearRing"):
        corners = places(ring)
        assert corners[0] == corners[-1]
        assert all(lon == pytest.approx(9.53, abs=0.001) for lon, _ in corners)
    assert tracks.findtext(".//k:altitudeMode", namespaces=NS) == "relativeToGround"
    assert [height_m for _, _, height_m in places(tracks)] == [12, 13, 14, 15, 16]


# --- both ----------------------------------------------------------------------------------------
def test_map_of_nothing_has_an_empty_outline():
    found = read(empty_map())
    (outline,) = found["features"]
    assert outline["geometry"] is None
    assert outline["properties"]["area_m2"] == 0
    assert "bbox" not in found
    root = read_kml(empty_map())
    assert len(root.findall(".//k:Folder", NS)) == 3
    assert not root.findall(".//k:Placemark", NS)


def test_unsearched_ground_is_in_each_map_that_has_some():
    full = make_map()
    start, end = (full.grid.position(GridPoint(east_m, 4.0)) for east_m in (0.0, 20.0))
    gap = replace(full, unsearched=((start, end),))
    assert not of_kind(read(full), "unsearched")
    (line,) = of_kind(read(gap), "unsearched")
    assert (line["id"], line["geometry"]["type"]) == ("unsearched 1", "LineString")
    assert line["geometry"]["coordinates"][0] == [round(start.lon_deg, 7), round(start.lat_deg, 7)]
    assert "Not searched" not in written(kml.write, full)
    assert written(kml.write, gap).count("without a judged frame") == 1
    texts = [entry.text for entry in map_scene(gap).legend]
    assert "search lane without a judged frame" in texts
    assert draw_sheet(map_scene(full)) != draw_sheet(map_scene(gap))
