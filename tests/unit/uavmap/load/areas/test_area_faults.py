"""Wrong, hostile or absurd areas: one line that names the file, and little memory."""

from __future__ import annotations

import contextlib
import io
import json
import sqlite3
import struct
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import shapefile
from shapely.geometry import Polygon

from missions.errors import AreaError
from missions.mission.checks import parse_mission
from missions.units import LatLon
from tests.support.areas import area_files as files
from tests.support.areas.area_files import FIELD, collection, feature, kml, placemark, saved
from tests.unit.uavmap.load.areas.test_area_kinds import SIM
from uavmap.load.areas.layout import LayoutOptions, lay_out
from uavmap.load.areas.mission_text import FlightChoices, compose
from uavmap.load.areas.reading import read_area_file
from uavmap.load.areas.shp import read_shapefile

Maker = Callable[[Path], Path]

OUTSIDE = (
    '<?xml version="1.0"?><!DOCTYPE kml [<!ENTITY x SYSTEM "file:///etc/passwd">]>'
    "<kml><Placemark><name>&x;</name></Placemark></kml>"
)


def text(name: str, content: str | bytes) -> Maker:
    return lambda folder: saved(folder, name, content)


def drawn(*corners: tuple[Any, Any]) -> Maker:
    return text("a.kml", kml(placemark("a", files.kml_polygon(corners))))


def geometry(kind: str, coordinates: object) -> Maker:
    value = json.dumps({"type": kind, "coordinates": coordinates})
    return text("a.geojson", value)


def ring(*corners: tuple[object, object]) -> Maker:
    return geometry("Polygon", [[*map(list, corners)]])


def parts(change: Callable[[bytes], bytes]) -> Maker:
    """Return the parts of a Shapefile with a changed .shp."""

    def make(folder: Path) -> Path:
        made = files.shapefile()
        return files.beside(folder, "a", made | {"shp": change(made["shp"])})

    return make


def in_metres() -> dict[str, bytes]:
    """Return a Shapefile that does not name its coordinate system."""
    made = files.shapefile("arcgis_shapefile_in_utm")
    return {suffix: data for suffix, data in made.items() if suffix != "prj"}


def gpkg(change: str) -> Maker:
    """Return a GeoPackage that was changed with SQL."""

    def make(folder: Path) -> Path:
        path = files.KINDS["qgis_geopackage"](folder)
        file = sqlite3.connect(path)
        file.executescript(change)
        file.close()
        return path

    return make


def plan(**sections: object) -> Maker:
    return text("a.plan", files.plan(**sections))


ENDLESS = (
    "DROP TABLE fields; CREATE VIEW fields AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT "
    "i + 1 FROM n) SELECT i AS fid, x'' AS geom, 'a' AS name FROM n WHERE i < 0;"
)
CRS = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::99999"}}
LINK = {"type": "link", "properties": {"href": "http://127.0.0.1:9/crs"}}
FAULTS: dict[str, tuple[Maker, str]] = {
    "no file": (lambda folder: folder / "gone.kml", "cannot be read"),
    "a folder": (lambda folder: folder, "cannot be read"),
    "a device": (lambda _: Path("/dev/zero"), "not an ordinary file"),
    "an empty file": (text("a.kml", " \n"), "is empty"),
    "a picture": (text("a.png", b"\x89PNG\r\n\x1a\n" + bytes(range(256))), "unknown kind of file"),
    "a spreadsheet": (text("a.csv", "a,b\n1,2\n"), "unknown kind of file"),
    "XML that reads a file": (text("a.kml", OUTSIDE), "document type or entities"),
    "XML of an unknown encoding": (
        text("a.kml", '<?xml version="1.0" encoding="klingon"?><kml/>'), "not well-formed",
    ),
    "XML that ends early": (text("a.kml", kml("x")[:-5]), "not well-formed"),
    "XML that is nested deeply": (
        text("a.kml", "<kml>" + "<Folder>" * 100_000), "not well-formed",
    ),
    "KML with placemarks in one another": (
        text("a.kml", kml("<Placemark>" * 20_000 + "</Placemark>" * 20_000)), "in a placemark",
    ),
    "a zip of a hundred Shapefiles and more": (
        lambda folder: saved(
            folder,
            "a.zip",
            files.zipped({f"{i}.shp": files.shapefile()["shp"] for i in range(102)}),
        ),
        "more than 100 layers",
    ),
    "an empty GPX": (text("a.gpx", "<gpx version='1.1'/>"), "holds no polygon"),
    "XML of something else": (text("a.kml", "<html/>"), "not KML"),
    "KML without a polygon": (
        text("a.kml", kml(placemark("here", files.point(FIELD[0])))), "holds no polygon",
    ),
    "KML with a network link": (
        text("a.kml", kml("<NetworkLink><Link><href>http://x/</href></Link></NetworkLink>")),
        "a link to another file",
    ),
    "KML with words for numbers": (drawn(("x", 1.0), *FIELD[1:]), "is not longitude,latitude"),
    "KML with NaN": (drawn((float("nan"), 1.0), *FIELD[1:]), "not a finite number"),
    "KML of a polygon with two corners": (drawn(*FIELD[:2]), "a polygon needs three"),
    "KML with latitude first": (
        drawn((-33, 151), (-33, 151.1), (-33.1, 151.1)), "they are swapped; give --swap",
    ),
    "a KMZ without KML": (text("a.kmz", files.zipped({"a.txt": "x"})), "without a .kml"),
    "a zip that ends early": (text("a.zip", files.zipped({"a.shp": b"x" * 500})[:-30]), "damaged"),
    "a zip bomb": (
        text("a.kmz", files.zipped({"doc.kml": b"\0" * 21_000_000})), "unpacks to more than 20 MB",
    ),
    "a zip with a directory of 2 GB": (
        text("a.kmz", b"PK\3\4PK\5\6" + struct.pack("<4H2IH", 0, 0, 9, 9, 2**31, 0, 0)),
        "too many files",
    ),
    "a zip named KMZ that is none": (text("a.kmz", "<kml/>"), "not of the kind .kmz"),
    "a Shapefile without its .shp": (text("a.dbf", b"\x03"), "a part of a Shapefile"),
    "a Shapefile that ends early": (parts(lambda shp: shp[:150]), "not a Shapefile, or"),
    "a Shapefile of billions of points": (
        parts(lambda shp: shp[:144] + struct.pack("<2i", 1, 2**31 - 1) + shp[152:]),
        "not a Shapefile, or a damaged one",
    ),
    "a Shapefile with NaN": (
        parts(lambda shp: shp[:156] + struct.pack("<d", float("nan")) + shp[164:]), "finite",
    ),
    "a Shapefile without projection, in metres": (
        lambda folder: files.beside(folder, "a", in_metres()),
        "give --crs EPSG",
    ),
    "a Shapefile with a projection of nonsense": (
        lambda folder: files.beside(
            folder, "a", files.shapefile() | {"prj": b"+proj=longlat +nadgrids=/etc/x"}
        ),
        "is not known; save the area in WGS84",
    ),
    "a GeoPackage that is none": (text("a.gpkg", b"SQLite format 3\0" + b"\1" * 600), "GeoPackage"),
    "a GeoPackage named so": (text("a.gpkg", "x"), "not of the kind .gpkg"),
    "an SQLite file without tables": (gpkg("DROP TABLE gpkg_contents"), "not a readable"),
    "a GeoPackage whose view never ends": (gpkg(ENDLESS), "not a readable"),
    "a GeoPackage with text for a geometry": (gpkg("UPDATE fields SET geom = 'x'"), "geometry"),
    "a GeoPackage with billions of points": (
        gpkg("UPDATE fields SET geom = x'4750000100000000010300000001000000ffffffff'"), "geometry",
    ),
    "a GeoPackage of an unknown system": (
        gpkg("UPDATE gpkg_spatial_ref_sys SET organization_coordsys_id = 99999 WHERE srs_id > 0"),
        "EPSG:99999 is not known",
    ),
    "JSON that is none": (text("a.geojson", '{"type": '), "not JSON"),
    "JSON that is nested deeply": (text("a.geojson", '{"a":' * 200_000), "not JSON"),
    "JSON of something else": (text("a.json", '{"name": "x"}'), "no GeoJSON"),
    "a list": (text("a.json", "[1, 2]"), "no GeoJSON"),
    "TopoJSON": (text("a.json", '{"type": "Topology", "arcs": []}'), "TopoJSON is not read"),
    "the JSON of ESRI": (
        text("a.json", '{"rings": [[[1, 2]]], "spatialReference": {"wkid": 4326}}'), "ESRI",
    ),
    "GeoJSON without features": (text("a.geojson", collection()), "holds no polygon"),
    "GeoJSON with features that are no list": (
        text("a.geojson", '{"type": "FeatureCollection", "features": 7}'), "without features",
    ),
    "GeoJSON with a number for a ring": (geometry("Polygon", 7), "list of positions"),
    "GeoJSON with an empty polygon": (geometry("Polygon", []), "without a ring"),
    "GeoJSON with text for a number": (ring(("1", 2), (2, 3), (3, 1)), "is no coordinate"),
    "GeoJSON with true for a number": (ring((True, 2), (2, 3), (3, 1)), "is no coordinate"),
    "GeoJSON with NaN": (ring((float("nan"), 2), (2, 3), (3, 1)), "is no coordinate"),
    "GeoJSON with a number of 400 digits": (ring((10**400, 2), (2, 3), (3, 1)), "coordinate"),
    "GeoJSON with one number": (geometry("Polygon", [[[1], [2], [3]]]), "longitude and latitude"),
    "GeoJSON in metres": (
        ring((390_000, 5_812_000), (390_100, 5_812_000), (390_100, 5_812_100)), "metres",
    ),
    "GeoJSON of an unknown system": (
        text("a.geojson", collection(feature(), crs=CRS)), "EPSG:99999 is not known",
    ),
    "GeoJSON with a link to a system": (
        text("a.geojson", collection(feature(), crs=LINK)), "not a system by name",
    ),
    "GeoJSON of too many polygons": (
        text("a.geojson", collection(*[feature()] * 1001)), "more than 1000 shapes",
    ),
    "GeoJSON of too many corners": (
        geometry("Polygon", [[[i % 7, i % 5] for i in range(100_002)]]), "corners",
    ),
    "a plan of another program": (text("a.plan", "{}"), "not a plan of QGroundControl"),
    "a plan without anything": (plan(), "holds no polygon"),
    "a plan with a list for a mission": (
        text("a.plan", '{"fileType": "Plan", "mission": [1]}'), "is not a table",
    ),
    "a plan with text for a corner": (
        plan(mission={"items": [files.SURVEY | {"polygon": [["a", 1]] * 3}]}), "is no coordinate",
    ),
    "a plan with a circle around the earth": (
        plan(geoFence={"circles": [{"circle": {"center": [1, 2], "radius": 1e9}}]}), "a circle of",
    ),
    "waypoints of three columns": (text("a.waypoints", "QGC WPL 110\n0 1 2\n"), "12 columns"),
    "waypoints with NaN": (
        text("a.waypoints", files.wpl((16, 0.0, float("nan"), 1.0), (16, 0.0, 1.0, 1.0))),
        "is no coordinate",
    ),
    "a fence that lacks corners": (
        text("a.waypoints", files.wpl((16, 0.0, 1.0, 1.0), (5001, 4.0, 1.0, 1.0))), "lacks corners",
    ),
    "a polygon file with words": (text("a.poly", "here and there\n"), "latitude and longitude"),
    "a polygon file of one line": (text("a.poly", "52.4 13.3\n"), "a polygon needs three"),
    "an empty fence file": (text("a.fen", "#saved by APM Planner\n"), "a polygon needs three"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_faulty_file_is_refused_in_a_line(fault, tmp_path):
    assert_refused(*FAULTS[fault], tmp_path)


def assert_refused(make: Maker, expected: str, folder: Path) -> None:
    """Assert that reading a file is an error of one line that names the file."""
    path = make(folder)
    with pytest.raises(AreaError) as error:
        read_area_file(str(path))
    said = str(error.value)
    assert expected in said
    assert path.name in said
    assert "\n" not in said
    assert len(said) < 500 + len(str(path))


@pytest.mark.parametrize(
    "fault", [name for name in FAULTS if "billions" in name or "bomb" in name or "2 GB" in name]
)
def test_faulty_file_takes_little_memory(fault, tmp_path):
    path = FAULTS[fault][0](tmp_path)
    tracemalloc.start()
    try:
        with pytest.raises(AreaError):
            read_area_file(str(path))
        assert tracemalloc.get_traced_memory()[1] < 80_000_000
    finally:
        tracemalloc.stop()


def laid_out(folder: Path, *features: object, **wishes: object) -> str:
    path = saved(folder, "a.geojson", collection(*features))
    with pytest.raises(AreaError) as error:
        lay_out(read_area_file(str(path)), LayoutOptions(**wishes))
    return str(error.value)


def moved(east_deg: float, north_deg: float = 0.0, scale: float = 1.0) -> list[tuple[float, float]]:
    x0, y0 = FIELD[0]
    return [(x0 + east_deg + scale * (x - x0), y0 + north_deg + scale * (y - y0)) for x, y in FIELD]


A, B, C, D = FIELD
AROUND = moved(-0.0005, -0.0005, 2.0)
BAD_LAYOUTS: dict[str, tuple[list[object], dict[str, object], str]] = {
    "crosses itself": ([feature([A, C, B, D])], {}, "crosses or touches itself near 52.4565"),
    "without an inside": ([feature([(1, 1), (1.001, 1), (1.002, 1)])], {}, "a.geojson"),
    "15 km": ([feature(moved(0, scale=150.0))], {}, "at most 10 km"),
    "300 km": ([feature(moved(0, scale=3000.0))], {}, "degrees wide"),
    "a metre": ([feature(moved(0, scale=0.01))], {}, "smaller than a cell"),
    "at a pole": ([feature(moved(0, north_deg=35.0))], {}, "polar missions"),
    "a fence on another continent": (
        [feature(name="field"), feature(moved(-80.0, 0.0, 3.0), name="fence")], {},
        "km from the area",
    ),
    "all kept out of": (
        [feature(name="field"), feature(AROUND, name="no-fly zone")], {}, "keep-out polygons",
    ),
    "a home outside of the fence": (
        [feature(name="field"), feature(AROUND, name="fence")],
        {"home": LatLon(52.45, 13.303)}, "lies outside of the fence",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_LAYOUTS)
def test_area_that_makes_no_mission_is_refused(case, tmp_path):
    features, wishes, expected = BAD_LAYOUTS[case]
    assert expected in laid_out(tmp_path, *features, **wishes)


def test_several_areas_need_a_choice(tmp_path):
    two = feature(name="North"), feature(moved(0.003), name="South")
    said = laid_out(tmp_path, *two)
    assert "'North', 'South'; choose one with --area NAME, or give --together" in said
    assert "there are 'North', 'South'" in laid_out(tmp_path, *two, area="East")
    assert "several areas of this name" in laid_out(tmp_path, two[0], two[0], area="north")


def test_one_of_several_areas_is_chosen_and_all_are_enclosed(tmp_path):
    two = feature(name="North"), feature(moved(0.003), name="South")
    path = saved(tmp_path, "a.geojson", collection(*two))
    drawing = read_area_file(str(path))
    south = lay_out(drawing, LayoutOptions(area="south"))
    assert south.name == "South"
    assert min(place.lon_deg for place in south.box) == pytest.approx(13.306)
    both = lay_out(drawing, LayoutOptions(together=True))
    assert min(place.lon_deg for place in both.box) == pytest.approx(13.303)
    assert max(place.lon_deg for place in both.box) == pytest.approx(13.3075)


def test_keep_out_zone_is_cut_to_the_fence(tmp_path):
    road = [(x + 0.001, y) for x, y in files.POND[:2]] + [(13.31, 52.4566), (13.31, 52.4563)]
    shapes = feature(name="field"), feature(road, name="keep-out road")
    drawing = read_area_file(str(saved(tmp_path, "a.geojson", collection(*shapes))))
    layout = lay_out(drawing, LayoutOptions())
    text = compose("a", "a\n[flight]\n", layout, SIM, FlightChoices())
    (hole,) = parse_mission(text, "a").fence.holes
    fence = Polygon([(place.lon_deg, place.lat_deg) for place in layout.fence])
    assert fence.contains(Polygon([(lon, lat) for lat, lon in hole]))


def test_area_over_the_antimeridian_is_laid_out(tmp_path):
    ring = [(179.9995, -17.0), (-179.9995, -17.0), (-179.9995, -16.999), (179.9995, -16.999)]
    path = saved(tmp_path, "fiji.geojson", collection(feature(ring)))
    layout = lay_out(read_area_file(str(path)), LayoutOptions())
    assert abs(layout.home.lon_deg) > 179.99


def test_coast_line_is_simplified(tmp_path):
    x0, y0 = FIELD[0]
    coast = [(x0 + i * 1e-6, y0 + 1e-6 * (i % 3)) for i in range(1500)]
    path = saved(tmp_path, "coast.geojson", collection(feature([*coast, *FIELD[2:]])))
    layout = lay_out(read_area_file(str(path)), LayoutOptions())
    assert len(layout.box) <= 300
    assert any("corners of the area" in notice for notice in layout.notices)


def test_swapped_coordinates_are_turned_round(tmp_path):
    path = saved(tmp_path, "a.geojson", collection(feature([(y, x) for x, y in FIELD])))
    turned = read_area_file(str(path), swap=True).areas[0].ring
    assert [(p.lon_deg, p.lat_deg) for p in turned] == list(FIELD)


def test_file_without_a_coordinate_system_is_read_by_its_epsg(tmp_path):
    path = files.beside(tmp_path, "a", in_metres())
    ring = read_area_file(str(path), epsg=32633).areas[0].ring
    assert ring[0].lat_deg == pytest.approx(52.456, abs=0.002)
    with pytest.raises(AreaError, match="leave --crs out"):
        read_area_file(str(files.KINDS["qgis_shapefile"](tmp_path)), epsg=25833)


def test_geopackage_open_in_another_program_is_refused(tmp_path):
    path = files.KINDS["qgis_geopackage"](tmp_path)
    saved(tmp_path, "qgis_geopackage.gpkg-wal", b"x")
    with pytest.raises(AreaError, match="another program has it open"):
        read_area_file(str(path))


def test_shapefile_with_reversed_rings_is_read(tmp_path, capfd, caplog):
    buffer = {suffix: io.BytesIO() for suffix in ("shp", "shx", "dbf")}
    with shapefile.Writer(**buffer, shapeType=5) as writer:
        writer.field("Name", "C", 40)
        writer.poly([[list(corner) for corner in files.closed(FIELD)]])
        writer.record("Field")
    path = files.beside(tmp_path, "a", {k: file.getvalue() for k, file in buffer.items()})
    assert len(read_area_file(str(path)).areas) == 1
    assert capfd.readouterr().err == ""
    assert caplog.records == []


def test_damaged_shapefile_is_read_or_an_area_error():
    parts = files.shapefile("shapefile_with_hole")
    for suffix in ("shp", "dbf"):
        for place in range(0, len(parts[suffix]), 5):
            data = bytearray(parts[suffix])
            data[place] ^= 0xFF
            with contextlib.suppress(AreaError):
                read_shapefile(parts | {suffix: bytes(data)}, "a", "a.shp")
