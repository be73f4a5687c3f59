"""More areas as files: by the tools' own writers (GDAL, pymavlink, gpxpy, fastkml) where there are
any, and after their documents where there are none. Importing this adds them to `KINDS`."""

from __future__ import annotations

import json
import math
import xml.etree.ElementTree as ET
from functools import partial
from pathlib import Path
from typing import Any

import fastkml
import gpxpy.gpx
import numpy as np
import pygeoif
import pyogrio
import shapely
from pymavlink import mavwp
from pymavlink.dialects.v20 import ardupilotmega as mav
from shapely.geometry import Polygon

from tests.support.areas import area_files as files
from tests.support.areas.area_files import FIELD, HOME, HOME_INSIDE, POND, Ring, closed, kind, saved

METRE_DEG = 1.0 / 111_320.0


# --- GDAL, which QGIS, ArcGIS Pro, R and most others write with ---------------------------------
def by_gdal(path: Path, driver: str, ring: Ring = FIELD, epsg: int = 4326, **options: Any) -> Path:
    """One polygon with a name and two columns that say nothing of places."""
    wkb = np.array([shapely.to_wkb(Polygon(ring))], dtype=object)
    pyogrio.raw.write(
        path,
        geometry=wkb,
        field_data=[np.array([7]), np.array(["Feld"], dtype=object)],
        fields=["id", "Name" if driver in ("KML", "LIBKML", "GPX") else "name"],
        driver=driver,
        geometry_type="Polygon",
        crs=f"EPSG:{epsg}",
        layer=path.stem,
        **options,
    )
    return path


GDAL: dict[str, tuple[str, str, int, dict[str, str]]] = {
    # with the spatial index, the triggers and the extensions of a real one
    "gdal_geopackage": ("g.gpkg", "GPKG", 4326, {}),
    "gdal_geopackage_of_europe": ("e.gpkg", "GPKG", 3035, {}),
    "gdal_shapefile_in_utm": ("u.shp", "ESRI Shapefile", 25833, {}),
    "gdal_shapefile_of_berlin": ("b.shp", "ESRI Shapefile", 3068, {}),  # Soldner's system
    "gdal_kml": ("k.kml", "KML", 4326, {}),
    "gdal_libkml_archive": ("l.kmz", "LIBKML", 4326, {}),
    "gdal_geojson": ("j.geojson", "GeoJSON", 4326, {"RFC7946": "YES", "WRITE_BBOX": "YES"}),
    "gdal_geojson_sequence_by_the_rfc": ("s.geojsonl", "GeoJSONSeq", 4326, {"RS": "YES"}),
    "gdal_geojson_in_national_grid": ("n.geojson", "GeoJSON", 25832, {}),
    "gdal_kml_by_libkml": ("lib.kml", "LIBKML", 4326, {}),
    # as QGIS saves a layer as CSV with its geometry
    "gdal_csv_with_wkt": ("w.csv", "CSV", 4326, {"GEOMETRY": "AS_WKT", "SEPARATOR": "SEMICOLON"}),
}
"""File, driver, coordinate system and options of each kind."""


def _written(row: tuple[str, str, int, dict[str, str]], folder: Path) -> Path:
    name, driver, epsg, options = row
    ring = FIELD if epsg == 4326 else files.in_crs(FIELD, epsg)
    return by_gdal(folder / name, driver, ring, epsg, **options)


files.KINDS.update({name: partial(_written, row) for name, row in GDAL.items()})


# --- ground stations ----------------------------------------------------------------------------
@kind
def qgc_of_3_2(folder: Path) -> Path:
    """Version 3 of a survey: grid and camera in tables of their own."""
    survey = {
        "type": "ComplexItem", "complexItemType": "survey", "version": 3, "cameraTrigger": True,
        "cameraTriggerDistance": 25, "fixedValueIsAltitude": True, "hoverAndCapture": False,
        "manualGrid": True, "refly90Degrees": False, "polygon": files.lat_lon(FIELD),
        "grid": {"altitude": 50, "angle": 0, "relativeAltitude": True, "spacing": 30,
                 "turnAroundDistance": 0},
    }  # fmt: skip
    return saved(folder, "old.plan", files.plan(mission={"items": [survey]}))


@kind
def qgc_fence_alone(folder: Path) -> Path:
    fence = {"version": 1, "inclusion": True, "polygon": files.lat_lon(FIELD)}
    text = files.plan(
        mission={"plannedHomePosition": [HOME_INSIDE[1], HOME_INSIDE[0], 36]},
        geoFence={"polygons": [fence]},
    )
    return saved(folder, "fence.plan", text)


@kind
def qgc_corridor(folder: Path) -> Path:
    """A corridor along the middle of the field, as wide as it is."""
    (west, south), (east, _), (_, north), _ = FIELD
    width_m = (east - west) / METRE_DEG * math.cos(math.radians((south + north) / 2.0))
    middle = (west + east) / 2.0
    item = {
        "type": "ComplexItem", "complexItemType": "CorridorScan", "version": 3, "EntryPoint": 0,
        "CorridorWidth": round(width_m * 0.99886, 2),  # a degree of longitude is 111,447 m here
        "TransectStyleComplexItem": files.TRANSECTS,
        "polyline": files.lat_lon([(middle, south), (middle, north)]),
    }  # fmt: skip
    return saved(folder, "corridor.plan", files.plan(mission={"items": [item]}))


STRUCTURE = {
    "type": "ComplexItem", "complexItemType": "StructureScan", "version": 2, "Altitude": 50,
    "CameraCalc": files.TRANSECTS["CameraCalc"], "Layers": 1, "StructureHeight": 25,
    "altitudeRelative": True, "polygon": files.lat_lon(POND),
}  # fmt: skip


@kind
def qgc_survey_and_structure(folder: Path) -> Path:
    return saved(folder, "s.plan", files.plan(mission={"items": [files.SURVEY, STRUCTURE]}))


@kind
def mission_planner_splines(folder: Path) -> Path:
    rows = [(16, 0.0, *HOME), (22, 0.0, 0.0, 0.0), *((82, 0.0, x, y) for x, y in FIELD)]
    return saved(folder, "spline.waypoints", files.wpl(*rows, (20, 0.0, 0.0, 0.0)))


@kind
def mission_planner_fence_with_circle(folder: Path) -> Path:
    centre = ((POND[0][0] + POND[2][0]) / 2.0, (POND[0][1] + POND[1][1]) / 2.0)
    rows = [(16, 0.0, *HOME_INSIDE), *((5001, 4.0, x, y) for x, y in FIELD), (5004, 10.0, *centre)]
    return saved(folder, "circle.waypoints", files.wpl(*rows))


@kind
def mavproxy_waypoints(folder: Path) -> Path:
    loader = mavwp.MAVWPLoader()
    for x, y in (HOME, *FIELD):
        loader.add(
            mav.MAVLink_mission_item_message(1, 0, 0, 3, 16, 0, 1, 0, 0, 0, 0, y, x, 30.0)
        )  # fmt: skip
    path = folder / "way.txt"
    loader.save(str(path))
    return path


@kind
def corners_by_hand(folder: Path) -> Path:
    """Latitude and longitude, a comma between, and a word about it."""
    rows = [f"{y}, {x}" for x, y in FIELD]
    return saved(folder, "corners.txt", "\n".join(["# the north field", *rows]))


@kind
def mavproxy_fence(folder: Path) -> Path:
    """Return point, corners, the first corner again; no suffix that says so."""
    loader = mavwp.MAVFenceLoader()
    for x, y in (HOME_INSIDE, *closed(FIELD)):
        loader.add_latlon(y, x)
    path = folder / "fence.txt"
    loader.save(str(path))
    return path


# --- other planners -----------------------------------------------------------------------------
@kind
def dji_pilot_2_mapping(folder: Path) -> Path:
    """WPML: a template in a KMZ, and the lines that were computed from it beside it."""
    config = (
        "<wpml:missionConfig><wpml:flyToWaylineMode>safely</wpml:flyToWaylineMode>"
        "<wpml:takeOffSecurityHeight>20</wpml:takeOffSecurityHeight></wpml:missionConfig>"
    )
    area = (
        "<Placemark><wpml:caliFlightEnable>0</wpml:caliFlightEnable><wpml:direction>0"
        "</wpml:direction><wpml:margin>0</wpml:margin><Polygon><outerBoundaryIs><LinearRing>"
        f"<coordinates>\n{files.kml_ring(FIELD, between=chr(10))}\n</coordinates></LinearRing>"
        "</outerBoundaryIs></Polygon><wpml:ellipsoidHeight>100</wpml:ellipsoidHeight></Placemark>"
    )
    template = (
        f"<Document><wpml:author>pilot</wpml:author>{config}<Folder><wpml:templateType>mapping2d"
        f"</wpml:templateType><wpml:templateId>0</wpml:templateId>{area}</Folder></Document>"
    )
    space = ' xmlns="http://www.opengis.net/kml/2.2" xmlns:wpml="http://www.dji.com/wpmz/1.0.2"'
    lines = f"<Document>{config}<Folder><wpml:waylineId>0</wpml:waylineId></Folder></Document>"
    archive = {
        "wpmz/res/": "",
        "wpmz/waylines.wpml": files.kml(lines, space),
        "wpmz/template.kml": files.kml(template, space),
    }
    return saved(folder, "Mapping1.kmz", files.zipped(archive))


@kind
def litchi_mission(folder: Path) -> Path:
    head = "latitude,longitude,altitude(m),heading(deg),curvesize(m),rotationdir,gimbalmode"
    rows = [f"{y:.8f},{x:.8f},30,0,0.2,0,0" for x, y in FIELD]
    return saved(folder, "litchi.csv", "\r\n".join([head, *rows, ""]))


@kind
def litchi_mission_in_feet(folder: Path) -> Path:
    head = "latitude,longitude,altitude(ft),heading(deg),curvesize(ft),rotationdir"
    rows = [f"{y:.8f},{x:.8f},98.4,360,0.7,0" for x, y in FIELD]
    return saved(folder, "feet.csv", "\n".join([head, *rows]))


@kind
def sentera_boundary(folder: Path) -> Path:
    rows = [f"{x},{y}" for x, y in FIELD]
    return saved(folder, "boundary.csv", "\n".join(["lon,lat", *rows]))


@kind
def german_spreadsheet(folder: Path) -> Path:
    """Semicolons between, and a comma for a decimal point."""
    rows = [f"{k};{y};{x}".replace(".", ",") for k, (x, y) in enumerate(FIELD)]
    return saved(folder, "Punkte.csv", "\ufeff" + "\r\n".join(["Nr;Lat;Lon", *rows]))


@kind
def opendronemap_boundary(folder: Path) -> Path:
    return saved(folder, "boundary.json", json.dumps(json.loads(files.collection(files.feature()))))


@kind
def josm_closed_way(folder: Path) -> Path:
    line = {"type": "LineString", "coordinates": [list(c) for c in closed(FIELD)]}
    made = {"type": "Feature", "properties": {"name": "Weg"}, "geometry": line}
    return saved(folder, "josm.geojson", files.collection(made, generator="JOSM"))


@kind
def mapbox_without_properties(folder: Path) -> Path:
    made = files.feature() | {"properties": None, "id": "a1b2"}
    return saved(folder, "mapbox.geojson", files.collection(made))


# --- GPS receivers and phones -------------------------------------------------------------------
def gpx(*, tracks: dict[str, Ring], home: tuple[float, float] | None = None) -> str:
    file = gpxpy.gpx.GPX()
    file.creator = "OsmAnd"
    for name, ring in tracks.items():
        segment = gpxpy.gpx.GPXTrackSegment(
            [gpxpy.gpx.GPXTrackPoint(y, x, elevation=36.0) for x, y in ring]
        )
        file.tracks.append(gpxpy.gpx.GPXTrack(name=name))
        file.tracks[-1].segments.append(segment)
    if home is not None:
        file.waypoints.append(gpxpy.gpx.GPXWaypoint(home[1], home[0], name="Home"))
    return file.to_xml("1.1")


def walked(ring: Ring) -> list[tuple[float, float]]:
    """A fix each few metres, and over the beginning once more, a step aside of it."""
    line = shapely.LineString(closed(ring))
    points = [line.interpolate(k / 80.0, normalized=True) for k in range(81)]
    aside = [(p.x + 2e-6, p.y - 2e-6 * (1 if k % 2 else -1)) for k, p in enumerate(points[1:4])]
    return [*((p.x, p.y) for p in points), *aside]


@kind
def osmand_walk(folder: Path) -> Path:
    """A way around the field that crosses itself where it ends, and the way to it."""
    text = gpx(tracks={"Feld": walked(FIELD), "the way here": [HOME, (13.31, 52.45)]}, home=HOME)
    return saved(folder, "2024-05-01_10-30.gpx", text)


@kind
def garmin_route(folder: Path) -> Path:
    file = gpxpy.gpx.GPX()
    file.routes.append(gpxpy.gpx.GPXRoute(name="Field"))
    for x, y in closed(FIELD):
        file.routes[0].points.append(gpxpy.gpx.GPXRoutePoint(y, x))
    return saved(folder, "Route.GPX", file.to_xml("1.1"))


@kind
def gpx_1_0(folder: Path) -> Path:
    points = "".join(f'<trkpt lat="{y}" lon="{x}"><ele>1</ele></trkpt>' for x, y in closed(FIELD))
    space = 'version="1.0" creator="x" xmlns="http://www.topografix.com/GPX/1/0"'
    return saved(folder, "old.gpx", f"<gpx {space}><trk><trkseg>{points}</trkseg></trk></gpx>")


# --- KML ----------------------------------------------------------------------------------------
@kind
def kml_with_prefixes(folder: Path) -> Path:
    """As libraries for XML write it: every element with a prefix."""
    text = files.kml(f"<Document>{files.placemark('Field', files.kml_polygon())}</Document>")
    root = ET.fromstring(text.partition("?>")[2].strip())
    made = ET.tostring(root, encoding="unicode")
    assert "ns0:Polygon" in made
    return saved(folder, "prefix.kml", made)


@kind
def fastkml_document(folder: Path) -> Path:
    ring = pygeoif.geometry.Polygon(closed(FIELD))
    placemark = fastkml.Placemark(name="Field", geometry=ring)
    file = fastkml.KML(features=[fastkml.Document(features=[placemark])])
    return saved(folder, "fast.kml", file.to_string())


@kind
def google_earth_label_and_altitudes(folder: Path) -> Path:
    """A polygon and its label together, with a table of data and heights of Google's own."""
    ring = files.kml_ring(FIELD, height=",36.4")
    inside = (
        "<Document><Schema name='S' id='S'><SimpleField type='string' name='crop'/></Schema>"
        "<Folder><name>F</name><Folder><Placemark><name>Field</name><ExtendedData><SchemaData "
        "schemaUrl='#S'><SimpleData name='crop'>rye</SimpleData></SchemaData></ExtendedData>"
        f"<MultiGeometry>{files.point(FIELD[0])}<Polygon><extrude>1</extrude><gx:altitudeMode>"
        "clampToSeaFloor</gx:altitudeMode><outerBoundaryIs><LinearRing><coordinates>"
        f"{ring}</coordinates></LinearRing></outerBoundaryIs></Polygon></MultiGeometry>"
        "</Placemark></Folder></Folder></Document>"
    )
    return saved(folder, "label.kml", files.kml(inside, files._EARTH))


@kind
def kml_linear_ring(folder: Path) -> Path:
    ring = f"<LinearRing><coordinates>{files.kml_ring(FIELD)}</coordinates></LinearRing>"
    return saved(folder, "ring.kml", files.kml(files.placemark("Field", ring)))


@kind
def kml_in_latin_1(folder: Path) -> Path:
    text = files.kml(files.placemark("Grünfläche", files.kml_polygon()))
    return saved(folder, "l1.kml", text.replace("UTF-8", "ISO-8859-1").encode("latin-1"))


# --- Shapefiles ---------------------------------------------------------------------------------
@kind
def arcgis_shapefile_with_measures(folder: Path) -> Path:
    """PolygonM, and the code page of Windows."""
    parts = files.shp([[FIELD]], ["Field"])
    as_m = _with_measures(parts["shp"])
    return files.beside(folder, "m", {**parts, "shp": as_m, "cpg": b"1252"})


def _with_measures(shp: bytes) -> bytes:
    """The one polygon of a file with a measure at each point, none of which is known."""
    points = len(FIELD) + 1
    no_data = np.array([0.0, 0.0, *[-1e39] * points], dtype="<f8").tobytes()
    content = (25).to_bytes(4, "little") + shp[112:] + no_data
    length = (100 + 8 + len(content)) // 2
    header = shp[:24] + length.to_bytes(4, "big") + shp[28:32] + (25).to_bytes(4, "little")
    record = shp[100:104] + (len(content) // 2).to_bytes(4, "big")
    return header + shp[36:100] + record + content


@kind
def shapefile_zipped_on_a_mac(folder: Path) -> Path:
    parts = files.shp([[FIELD]], ["Field"])
    members: dict[str, str | bytes] = {
        f"Fields/FIELD.{s.upper()}": data for s, data in parts.items()
    }
    members |= {f"__MACOSX/Fields/._FIELD.{s.upper()}": b"\0\5\x16\7" for s in parts}
    return saved(folder, "Archive.zip", files.zipped(members))
