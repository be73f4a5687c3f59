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
from tests.support.areas.area_files import (
    FIELD,
    HOME,
    HOME_INSIDE,
    KINDS,
    POND,
    Ring,
    closed,
    kind,
    kinds,
    saved,
)  # fmt: skip

METRE_DEG = 1.0 / 111_320.0


# --- GDAL, which QGIS, ArcGIS Pro, R and most others write with ---------------------------------
def by_gdal(folder: Path, name: str, driver: str, epsg: int = 4326, **options: Any) -> Path:
    """The field with a name and two columns that say nothing of places."""
    path, ring = folder / name, FIELD if epsg == 4326 else files.in_crs(FIELD, epsg)
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
    # Soldner's system, which only this city had
    "gdal_shapefile_of_berlin": ("b.shp", "ESRI Shapefile", 3068, {}),
    "gdal_kml": ("k.kml", "KML", 4326, {}),
    "gdal_libkml_archive": ("l.kmz", "LIBKML", 4326, {}),
    "gdal_geojson": ("j.geojson", "GeoJSON", 4326, {"RFC7946": "YES", "WRITE_BBOX": "YES"}),
    "gdal_geojson_sequence_by_the_rfc": ("s.geojsonl", "GeoJSONSeq", 4326, {"RS": "YES"}),
    "gdal_geojson_in_national_grid": ("n.geojson", "GeoJSON", 25832, {}),
    "gdal_kml_by_libkml": ("lib.kml", "LIBKML", 4326, {}),
    # as QGIS saves a layer as CSV with its geometry
    "gdal_csv_with_wkt": ("w.csv", "CSV", 4326, {"GEOMETRY": "AS_WKT", "SEPARATOR": "SEMICOLON"}),
}
for key, (name, driver, epsg, options) in GDAL.items():
    KINDS[key] = partial(by_gdal, name=name, driver=driver, epsg=epsg, **options)


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


kinds(
    qgc_survey_and_structure=("s.plan", files.plan(mission={"items": [files.SURVEY, STRUCTURE]})),
    qgc_fence_alone=(
        "fence.plan",
        files.plan(
            mission={"plannedHomePosition": [HOME_INSIDE[1], HOME_INSIDE[0], 36]},
            geoFence={"polygons": [files.INCLUSION | {"polygon": files.lat_lon(FIELD)}]},
        ),
    ),
    mission_planner_splines=(
        "spline.waypoints",
        files.wpl(*files._TAKEOFF, *files.corners(82, 0.0, FIELD), files._RETURN),
    ),
    mission_planner_fence_with_circle=(
        "circle.waypoints",
        files.wpl(
            (16, 0.0, *HOME_INSIDE), *files.corners(5001, 4.0, FIELD),
            (5004, 10.0, (POND[0][0] + POND[2][0]) / 2.0, (POND[0][1] + POND[1][1]) / 2.0),
        ),
    ),
)  # fmt: skip


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


def csv(head: str, row: str, between: str = "\n") -> str:
    """A head, and a row a corner, with its number, longitude and latitude."""
    rows = [row.format(k=k, x=x, y=y) for k, (x, y) in enumerate(FIELD)]
    return between.join([head, *rows])


LITCHI = "latitude,longitude,altitude(m),heading(deg),curvesize(m),rotationdir"
WAY = {"type": "LineString", "coordinates": [list(c) for c in closed(FIELD)]}
kinds(
    litchi_mission=(
        "litchi.csv", csv(f"{LITCHI},gimbalmode", "{y:.8f},{x:.8f},30,0,0.2,0,0", "\r\n") + "\r\n",
    ),
    litchi_mission_in_feet=(
        "feet.csv", csv(LITCHI.replace("(m)", "(ft)"), "{y:.8f},{x:.8f},98.4,360,0.7,0"),
    ),
    sentera_boundary=("boundary.csv", csv("lon,lat", "{x},{y}")),
    # semicolons between, and a comma for a decimal point
    german_spreadsheet=(
        "Punkte.csv", "\ufeff" + csv("Nr;Lat;Lon", "{k};{y};{x}", "\r\n").replace(".", ","),
    ),
    # latitude and longitude, a comma between, and a word about it
    corners_by_hand=("corners.txt", csv("# the north field", "{y}, {x}")),
    opendronemap_boundary=(
        "boundary.json", json.dumps(json.loads(files.collection(files.feature()))),
    ),
    josm_closed_way=(
        "josm.geojson",
        files.collection(files.feature(name="Weg") | {"geometry": WAY}, generator="JOSM"),
    ),
    mapbox_without_properties=(
        "mapbox.geojson", files.collection(files.feature() | {"properties": None, "id": "a1b2"}),
    ),
)  # fmt: skip


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


kinds(
    kml_linear_ring=(
        "ring.kml",
        files.kml(
            files.placemark(
                "Field",
                f"<LinearRing><coordinates>{files.kml_ring(FIELD)}</coordinates></LinearRing>",
            )
        ),
    ),
    kml_in_latin_1=(
        "l1.kml",
        files.kml(files.placemark("Grünfläche", files.kml_polygon()))
        .replace("UTF-8", "ISO-8859-1").encode("latin-1"),
    ),
)  # fmt: skip


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
