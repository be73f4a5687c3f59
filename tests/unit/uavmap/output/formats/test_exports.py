"""Files for other programs, read back by libraries of others."""

import contextlib
import csv
import io
import json
import sqlite3
import xml.etree.ElementTree as ET
from pathlib import Path

import fastkml
import gpxpy
import lxml.etree
import pyogrio
import pytest
import shapefile
import shapely
from shapely.geometry import shape

from missions.units import LatLon
from tests.golden.recording import STOPS
from tests.unit.uavmap.output.flown_folders import PLAN, folder_of, keep_frames, named
from tests.unit.uavmap.output.maps import empty_map, make_map, written
from uavmap.base.version import __version__
from uavmap.output.documents import FORMATS, files_of
from uavmap.output.drawing.palette import STATES
from uavmap.output.facts.flight_log import FlightLog
from uavmap.output.facts.flown_mission import Calendar, FlownMission
from uavmap.output.formats import geojson_encoder as geojson
from uavmap.output.formats import kml_encoder as kml
from uavmap.output.formats.geopackage_layers import APPLICATION_ID
from uavmap.output.formats.map_layers import layers
from uavmap.output.report.page import encode
from uavmap.output.results import flown_of
from uavmap.ui.cli import main

AREA_M2 = 96.0
SCALE = 0.9996
LAYERS = ["region", "cells", "tracks", "track_points", "frames", "fence", "places"]
UTC = "2020-01-01T00:02:"
"""Date of the map, without its seconds."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return folder_of(tmp_path_factory.mktemp("exports"), plan=named("R&D 'x' é"))


@pytest.fixture(scope="module")
def flown(folder):
    return flown_of(folder)


def export_as(folder, kind, out):
    assert main(["export", str(folder), "--to", kind, "--out", str(out)]) == 0
    return out


def flown_at(data, tmp):
    values = {"completed": True, "finding": "a ring"}
    setting = STOPS.setting()
    log, calendar = FlightLog(), Calendar(0.0)
    return FlownMission(tmp, PLAN, setting, data, values, log, calendar, recorded=True)


# --- GeoPackage ----------------------------------------------------------------------------------
def test_gdal_reads_the_geopackage_in_utm_with_its_areas(folder, tmp_path):
    file = export_as(folder, "gpkg", tmp_path / "map.gpkg")
    names = dict(pyogrio.list_layers(file).tolist())
    assert list(names) == [*LAYERS, "layer_styles"]
    assert (names["region"], names["tracks"]) == ("MultiPolygon", "LineString Z")
    for name in LAYERS:
        assert pyogrio.read_info(file, layer=name)["crs"] == "EPSG:32632"
    assert pyogrio.read_info(file, layer="cells")["features"] == 21
    _, _, (region,), values = read(file, "region")
    scale = flown_of(folder).data.grid.scale
    assert shapely.area(region) / scale**2 == pytest.approx(AREA_M2, abs=0.01)
    assert values["area_m2"][0] == AREA_M2
    assert (values["crs"][0], values["version"][0]) == ("EPSG:32632", __version__)
    assert str(values["utc"][0]).startswith("2020-01-01T00:02:")
    _, _, tracks, values = read(file, "tracks")
    assert list(values["sortie"]) == [1, 2]
    assert shapely.get_coordinates(tracks, include_z=True)[:, 2].max() == pytest.approx(12, abs=0.5)
    _, _, shapes, values = read(file, "fence")
    assert list(values["kind"]) == ["fence", "box"]
    assert all(shapely.is_valid(shapes))


def read(file, layer):
    meta, fids, binary, columns = pyogrio.raw.read(file, layer=layer)
    values = dict(zip(meta["fields"].tolist(), columns, strict=True))
    return meta, fids, list(shapely.from_wkb(binary)), values


def test_geopackage_follows_the_standard(folder, tmp_path):
    file = export_as(folder, "gpkg", tmp_path / "map.gpkg")
    with contextlib.closing(sqlite3.connect(file)) as database:
        ask = database.execute
        assert ask("PRAGMA application_id").fetchone() == (APPLICATION_ID,)
        assert ask("PRAGMA user_version").fetchone() == (10300,)
        assert ask("PRAGMA integrity_check").fetchone() == ("ok",)
        assert ask("PRAGMA foreign_key_check").fetchall() == []
        systems = {row[0] for row in ask("SELECT srs_id FROM gpkg_spatial_ref_sys")}
        assert systems == {-1, 0, 4326, 32632}
        for name, *box, when in ask(
            "SELECT table_name, min_x, min_y, max_x, max_y, last_change FROM gpkg_contents "
            "WHERE data_type = 'features'"
        ):
            _, _, shapes, _ = read(file, name)
            assert box == pytest.approx(shapely.total_bounds(shapes))
            assert when.startswith(UTC)  # no clock of this computer


def test_styles_are_in_the_colours_of_the_picture(folder, tmp_path):
    file = export_as(folder, "gpkg", tmp_path / "map.gpkg")
    with contextlib.closing(sqlite3.connect(file)) as database:
        rows = database.execute(
            "SELECT f_table_name, f_geometry_column, styleQML, useAsDefault FROM layer_styles"
        ).fetchall()
    assert [row[0] for row in rows] == LAYERS
    meta, _, _, columns = pyogrio.raw.read(file, layer="layer_styles")  # as QGIS does, by GDAL
    by_gdal = dict(zip(meta["fields"].tolist(), columns, strict=True))
    assert list(by_gdal["f_table_name"]) == LAYERS
    assert all(by_gdal["useAsDefault"])
    assert [ET.fromstring(qml).tag for qml in by_gdal["styleQML"]] == ["qgis"] * len(LAYERS)
    assert {(column, default) for _, column, _, default in rows} == {("geom", 1)}
    styles = {name: ET.fromstring(qml) for name, _, qml, _ in rows}
    renderers = {name: style.find("renderer-v2") for name, style in styles.items()}
    assert None not in renderers.values()
    renderer = renderers["cells"]
    assert renderer is not None
    assert (renderer.get("type"), renderer.get("attr")) == ("categorizedSymbol", "state")
    fills = [
        option.get("value")
        for symbol in renderer.iter("symbol")
        for option in symbol.iter("Option")
        if option.get("name") == "color"
    ]
    shown = [c.get("value") for c in renderer.iter("category")]
    assert shown == ["explored", "non-roi"]
    for state, fill in zip(shown, fills, strict=True):
        assert fill is not None
        assert fill.startswith(",".join(map(str, STATES[state])))
    assert {n.get("type") for s in styles.values() for n in s.iter("symbol")} == {
        "fill", "line", "marker",
    }  # fmt: skip


@pytest.mark.parametrize("kind", FORMATS)
def test_same_flight_gives_the_same_bytes(kind, folder, flown):
    assert files_of(flown, kind) == files_of(flown_of(folder), kind)
    assert all(len(field.name) <= 10 for layer in layers(flown) for field in layer.fields)


def frames_in(flown):
    (frames,) = (layer for layer in layers(flown) if layer.name == "frames")
    return frames


def test_kept_frames_have_names_and_places_but_for_places_that_are_none(tmp_path):
    folder = folder_of(tmp_path)
    keep_frames(folder)
    frames, bare = frames_in(flown_of(folder)), frames_in(flown_of(folder_of(tmp_path / "without")))
    assert set(frames.column("place_by")) == {"pose"}
    assert frames.column("picture")[0] == "1-000018.650.jpg"
    assert set(bare.column("place_by")) == {"telemetry"}
    assert len(list(bare.rows)) == len(list(frames.rows)) == 34
    poses = folder / "frames" / "poses.csv"
    for bad in ("nan", "inf", "-1e300", "91"):
        poses.write_text(poses.read_text("utf-8").replace("47.30011000", bad, 3), "utf-8")
    flown = flown_of(folder)
    assert frames_in(flown).column("place_by").count("telemetry") == 12
    for kind in FORMATS:
        files_of(flown, kind)
    assert encode(flown)


# --- KML -----------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def schema():
    file = Path(fastkml.__file__).parent / "schema" / "kml22gx.xsd"
    return lxml.etree.XMLSchema(lxml.etree.parse(str(file)))


def test_kml_is_valid_against_the_schema_of_the_ogc(folder, tmp_path, schema):
    file = export_as(folder, "kml", tmp_path / "flight.kml")
    schema.assertValid(lxml.etree.parse(str(file)))
    assert fastkml.KML.parse(file).features


def test_map_of_a_flight_is_valid_kml(schema):
    schema.assertValid(lxml.etree.fromstring(written(kml.write, make_map()).encode()))


def test_tracks_run_in_time(folder, tmp_path):
    root = ET.parse(export_as(folder, "kml", tmp_path / "flight.kml")).getroot()
    ns = {"k": "http://www.opengis.net/kml/2.2", "gx": "http://www.google.com/kml/ext/2.2"}
    tracks = root.findall(".//gx:Track", ns)
    assert len(tracks) == 2
    for track in tracks:
        whens = [when.text or "" for when in track.findall("k:when", ns)]
        assert len(whens) == len(track.findall("gx:coord", ns)) > 20
        assert whens == sorted(whens)
        assert whens[0].startswith("2020-01-01T00:0")
    data = {d.get("name"): d.findtext("k:value", None, ns) for d in root.iter(f"{{{ns['k']}}}Data")}
    assert data["computed_in"] == "EPSG:32632"
    assert data["version"] == __version__


# --- GeoJSON -------------------------------------------------------------------------------------
def positions(coordinates):
    if isinstance(coordinates[0], float | int):
        yield coordinates
    else:
        for one in coordinates:
            yield from positions(one)


def assert_rfc_7946(text):
    """Assert the rules of RFC 7946 that a file can break."""
    found = json.loads(text)
    assert found["type"] == "FeatureCollection"
    assert "crs" not in found  # section 4
    lows, highs = [], []
    for feature in found["features"]:
        assert set(feature) >= {"type", "geometry", "properties"}
        geometry = feature["geometry"]
        if geometry is None:
            continue
        for place in positions(geometry["coordinates"]):
            assert len(place) in (2, 3)
            assert -90.0 <= place[1] <= 90.0
        box = shape(geometry).bounds
        lows.append(box[:2])
        highs.append(box[2:])
        areas = {"Polygon": [geometry["coordinates"]], "MultiPolygon": geometry["coordinates"]}
        for rings in areas.get(geometry["type"], []):
            for number, ring in enumerate(rings):
                assert ring[0] == ring[-1]
                assert len(ring) >= 4
                assert shapely.LinearRing(ring).is_ccw is (number == 0)  # section 3.1.6
    if lows:
        half = len(found["bbox"]) // 2
        west, south = map(min, zip(*lows, strict=True))
        east, north = map(max, zip(*highs, strict=True))
        assert [*found["bbox"][:2], *found["bbox"][half : half + 2]] == [west, south, east, north]
    return found


def test_geojson_has_a_file_a_layer_by_the_rfc(folder, tmp_path):
    out = export_as(folder, "geojson", tmp_path / "layers")
    assert {path.name for path in out.iterdir()} == {f"{name}.geojson" for name in LAYERS}
    for path in out.iterdir():
        found = assert_rfc_7946(path.read_text("utf-8"))
        assert (found["computed_in"], found["version"]) == ("EPSG:32632", __version__)
        assert found["map_utc"].startswith(UTC)
        assert found["area_m2"] == AREA_M2
        names, shapes = pyogrio.read_info(path)["fields"], read(path, path.stem)[2]
        assert len(shapes) == len(found["features"])
        assert len(names)


def test_holes_the_south_and_the_date_line_keep_the_rules(tmp_path, schema):
    data = make_map(start=LatLon(-17.0, 179.9994), drift_m_s=0.5)
    there = flown_at(data, tmp_path)
    for text in files_of(there, "geojson").values():
        assert_rfc_7946(text.decode())
    assert_rfc_7946(written(geojson.write, data))
    region = json.loads(files_of(there, "geojson")["region.geojson"])["features"][0]
    outer, *holes = region["geometry"]["coordinates"][0]
    assert len(holes) == 1
    lons = [lon for lon, _ in outer]
    assert max(lons) - min(lons) < 0.001  # it does not span the globe
    assert max(lons) > 180.0
    (document,) = files_of(there, "kml").values()
    schema.assertValid(lxml.etree.fromstring(document))
    (package,) = files_of(there, "gpkg").values()
    file = tmp_path / "south.gpkg"
    file.write_bytes(package)
    meta, _, (shape_of,), values = read(file, "region")
    assert meta["crs"] == "EPSG:32760"
    assert shapely.area(shape_of) / data.grid.scale**2 == pytest.approx(384.0, rel=1e-4)
    assert values["area_m2"][0] == 384.0
    (tracks,) = files_of(there, "gpx").values()
    points = [p for t in gpxpy.parse(tracks.decode()).tracks for s in t.segments for p in s.points]
    assert all(-180.0 <= point.longitude < 180.0 for point in points)
    assert len({point.longitude > 0.0 for point in points}) == 2


@pytest.mark.parametrize("kind", [kind for kind in FORMATS if kind != "wpml"])
def test_map_of_nothing_has_all_files(kind, tmp_path):
    files = files_of(flown_at(empty_map(), tmp_path), kind)
    assert all(files.values())
    if kind == "gpkg":
        (tmp_path / "nothing.gpkg").write_bytes(files["map.gpkg"])
        assert read(tmp_path / "nothing.gpkg", "region")[2] == [None]
    if kind == "geojson":
        (feature,) = assert_rfc_7946(files["region.geojson"].decode())["features"]
        assert feature["geometry"] is None


# --- Shapefile, GPX, CSV -------------------------------------------------------------------------
def test_shapefiles_are_read_with_their_system_their_letters_and_their_areas(folder, tmp_path):
    out = export_as(folder, "shp", tmp_path / "shp")
    assert {p.suffix for p in out.glob("region.*")} == {".shp", ".shx", ".dbf", ".prj", ".cpg"}
    assert (out / "region.cpg").read_text() == "UTF-8"
    info = pyogrio.read_info(out / "region.shp")
    assert (info["crs"], info["encoding"]) == ("EPSG:32632", "UTF-8")
    with shapefile.Reader(str(out / "region.shp")) as region:
        record = region.record(0).as_dict()
        area = shape(region.shape(0).__geo_interface__)
    assert record["mission"] == "R&D 'x' é"
    assert record["area_m2"] == AREA_M2
    assert record["utc"].startswith(UTC)
    scale = flown_of(folder).data.grid.scale
    assert area.area / scale**2 == pytest.approx(AREA_M2, abs=0.01)
    with shapefile.Reader(str(out / "track_points.shp")) as points:
        assert points.shapeTypeName == "POINTZ"
        assert len(points) > 50
    data = (out / "region.dbf").read_bytes()
    assert data[1:4] == bytes((120, 1, 1))  # the date of the mission, not of today


def test_gpx_has_a_segment_a_sortie_with_times(folder, tmp_path):
    file = gpxpy.parse(export_as(folder, "gpx", tmp_path / "flight.gpx").read_text("utf-8"))
    track, outline = file.tracks
    assert [len(segment.points) > 20 for segment in track.segments] == [True, True]
    first = track.segments[0].points[0]
    assert first.time is not None
    assert first.time.isoformat() == "2020-01-01T00:00:08.600000+00:00"
    assert first.elevation is not None
    assert outline.segments[0].points[0].latitude == outline.segments[0].points[-1].latitude
    assert file.creator == f"uavmap {__version__}"
    assert "computed_in EPSG:32632" in (file.description or "")
    assert [point.name for point in file.waypoints] == ["home of vehicle 1"]


def test_csv_has_a_row_a_cell_with_degrees(folder, tmp_path):
    out = export_as(folder, "csv", tmp_path / "csv")
    rows = list(csv.DictReader(io.StringIO((out / "cells.csv").read_text("utf-8"), newline="")))
    assert len(rows) == 21
    grid = flown_of(folder).data.grid
    for row in rows:
        place = LatLon(float(row["lat_deg"]), float(row["lon_deg"]))
        cell = grid.cell_at(place, 0.0)
        assert cell == (int(row["column"]), int(row["row"]))
        assert shapely.from_wkt(row["wkt"]).is_valid
    about = dict(csv.reader(io.StringIO((out / "about.csv").read_text("utf-8"))))
    assert (about["computed_in"], about["area_m2"]) == ("EPSG:32632", "96.0")


# --- what is refused ------------------------------------------------------------------------------
def test_export_of_options_that_do_not_fit_is_refused_in_a_line(folder, tmp_path, refused):
    there = tmp_path / "there.kml"
    there.write_text("mine")
    for options, expected in (
        (["--to", "kml", "--out", there], "already exists"),
        (["--to", "shp", "--out", there], "is a file; give a folder"),
        (["--to", "shp", "--out", there / "below"], "below: cannot be written"),
        (["--to", "kml", "--out", tmp_path / "no" / "x.kml"], "there is no folder"),
        (["--to", "kml", "--plan", there], "--plan is for a plan"),
        (["--to", "kml", "--above-sea"], "--above-sea is for a plan"),
        (["--out", there], "--out needs --to FORMAT"),
    ):
        assert expected in refused("export", folder, *options)
    assert "which --to needs" in refused("export", "runway", "--to", "gpkg")
    assert there.read_text() == "mine"
