"""Areas as files, written as the tools that people draw with write them."""

from __future__ import annotations

import io
import json
import sqlite3
import struct
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pyproj
import shapefile
import shapely
from shapely.geometry import Polygon

FIELD = ((13.303, 52.456), (13.3045, 52.456), (13.3045, 52.457), (13.303, 52.457))
"""Longitude and latitude of the corners: 102 m x 111 m."""
POND = ((13.3035, 52.4563), (13.3035, 52.4566), (13.3039, 52.4566), (13.3039, 52.4563))
AROUND = ((13.3025, 52.4556), (13.3050, 52.4556), (13.3050, 52.4574), (13.3025, 52.4574))
HOME = (13.30375, 52.4558)
HOME_INSIDE = (13.30375, 52.4562)

Ring = Sequence[tuple[float, float]]
KINDS: dict[str, Callable[[Path], Path]] = {}
"""A writer for each kind, by name: it writes into a folder, and returns the file to be read."""


def kind(function: Callable[[Path], Path]) -> Callable[[Path], Path]:
    KINDS[function.__name__] = function
    return function


def saved(folder: Path, name: str, content: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def closed(ring: Ring) -> list[tuple[float, float]]:
    return [*ring, ring[0]]


# --- KML ----------------------------------------------------------------------------------------
def kml_ring(ring: Ring, height: str = ",0", between: str = " ") -> str:
    return between.join(f"{x},{y}{height}" for x, y in closed(ring))


def kml_polygon(ring: Ring = FIELD, holes: Sequence[Ring] = ()) -> str:
    inner = "".join(
        f"<innerBoundaryIs><LinearRing><coordinates>{kml_ring(h)}</coordinates></LinearRing>"
        "</innerBoundaryIs>"
        for h in holes
    )
    return (
        "<Polygon><tessellate>1</tessellate><outerBoundaryIs><LinearRing><coordinates>\n\t\t"
        f"{kml_ring(ring)} \n</coordinates></LinearRing></outerBoundaryIs>{inner}</Polygon>"
    )


def placemark(name: str, geometry: str) -> str:
    return f"<Placemark><name>{name}</name><styleUrl>#s</styleUrl>{geometry}</Placemark>"


def point(at: tuple[float, float]) -> str:
    return f"<Point><coordinates>{at[0]},{at[1]},0</coordinates></Point>"


def kml(inside: str, namespace: str = ' xmlns="http://www.opengis.net/kml/2.2"') -> str:
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<kml{namespace}>{inside}</kml>'


def zipped(files: dict[str, str | bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return buffer.getvalue()


_EARTH = (
    ' xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2" '
    'xmlns:kml="http://www.opengis.net/kml/2.2" xmlns:atom="http://www.w3.org/2005/Atom"'
)


@kind
def google_earth_pro(folder: Path) -> Path:
    style = (
        '<StyleMap id="s"><Pair><key>normal</key><styleUrl>#n</styleUrl></Pair></StyleMap>'
        '<Style id="n"><LineStyle><color>ff0000ff</color></LineStyle></Style>'
    )
    look = (
        "<LookAt><longitude>13.3</longitude><latitude>52.4</latitude><gx:fovy>30</gx:fovy></LookAt>"
    )
    return saved(
        folder,
        "Untitled Polygon.kml",
        kml(
            f"<Document><name>Untitled Polygon.kml</name>{style}<Placemark><name>Untitled Polygon"
            f"</name>{look}<styleUrl>#s</styleUrl>{kml_polygon()}</Placemark></Document>",
            _EARTH,
        ),
    )


@kind
def google_earth_kmz(folder: Path) -> Path:
    text = kml(f"<Document>{placemark('Field', kml_polygon())}</Document>", _EARTH)
    return saved(folder, "field.kmz", zipped({"doc.kml": text, "files/icon.png": b"\x89PNG"}))


@kind
def google_earth_web(folder: Path) -> Path:
    inside = (
        '<Document id="1"><name>Project</name><gx:CascadingStyle kml:id="m"/><Folder><name>Folder'
        f"</name>{placemark('Field', kml_polygon())}</Folder></Document>"
    )
    return saved(folder, "Project.kml", kml(inside, _EARTH))


@kind
def google_my_maps(folder: Path) -> Path:
    ring = kml_ring(FIELD, between="\n            ")
    inside = (
        "<Document><name>Map</name><description/><Folder><name>Layer</name><Placemark><name>Field"
        "</name><description><![CDATA[a <b>field</b>]]></description><ExtendedData><Data name='x'>"
        f"<value>1</value></Data></ExtendedData><Polygon><outerBoundaryIs><LinearRing>"
        f"<tessellate>1</tessellate><coordinates>\n            {ring}\n          </coordinates>"
        "</LinearRing></outerBoundaryIs></Polygon></Placemark></Folder></Document>"
    )
    return saved(folder, "map.kml", kml(inside))


@kind
def qgis_kml(folder: Path) -> Path:
    ring = " ".join(f"{x},{y}" for x, y in closed(FIELD))
    inside = (
        '<Document id="root_doc"><Schema name="field" id="field"><SimpleField name="id" '
        'type="int"/></Schema><Folder><name>field</name><Placemark><ExtendedData><SchemaData '
        'schemaUrl="#field"><SimpleData name="id">1</SimpleData></SchemaData></ExtendedData>'
        "<MultiGeometry><Polygon><outerBoundaryIs><LinearRing><coordinates>"
        f"{ring}</coordinates></LinearRing></outerBoundaryIs></Polygon></MultiGeometry></Placemark>"
        "</Folder></Document>"
    )
    return saved(folder, "qgis.kml", kml(inside))


@kind
def arcgis_kmz(folder: Path) -> Path:
    inside = (
        '<Document id="Field"><name>Field</name><Snippet></Snippet><Folder id="FeatureLayer0">'
        f"<name>Field</name><Placemark id='ID_00000'><name>0</name><MultiGeometry>{kml_polygon()}"
        "</MultiGeometry></Placemark></Folder></Document>"
    )
    return saved(folder, "Field.kmz", zipped({"doc.kml": kml(inside), "Legend0.png": b"x"}))


@kind
def google_earth_of_2006(folder: Path) -> Path:
    space = ' xmlns="http://earth.google.com/kml/2.1"'
    return saved(folder, "old.kml", kml(placemark("Field", kml_polygon()), space))


@kind
def kml_by_hand(folder: Path) -> Path:
    """No namespace, spaces after the commas, upper-case suffix."""
    ring = " \n".join(f"{x}, {y}, 0" for x, y in closed(FIELD))
    polygon = (
        "<Polygon><outerBoundaryIs><LinearRing><coordinates>"
        f"{ring}</coordinates></LinearRing></outerBoundaryIs></Polygon>"
    )
    return saved(folder, "HAND.KML", kml(placemark("Field", polygon), ""))


@kind
def kml_closed_path(folder: Path) -> Path:
    line = f"<LineString><coordinates>{kml_ring(FIELD)}</coordinates></LineString>"
    return saved(folder, "path.kml", kml(placemark("Way around the field", line)))


@kind
def kml_in_utf16(folder: Path) -> Path:
    text = kml(placemark("Wiese", kml_polygon())).replace("UTF-8", "UTF-16")
    return saved(folder, "utf16.kml", text.encode("utf-16"))


@kind
def kml_with_roles(folder: Path) -> Path:
    """Area, fence, no-fly zone and home, told by their names."""
    inside = "".join(
        [
            placemark("Meadow", kml_polygon()),
            placemark("Geofence", kml_polygon(AROUND)),
            placemark("No-fly pond", kml_polygon(POND)),
            placemark("Take-off", point(HOME)),
            placemark("Car park", point((13.30, 52.45))),
        ]
    )
    return saved(folder, "roles.kml", kml(f"<Document>{inside}</Document>"))


@kind
def kml_with_hole(folder: Path) -> Path:
    return saved(folder, "hole.kml", kml(placemark("Field", kml_polygon(FIELD, [POND]))))


# --- GeoJSON ------------------------------------------------------------------------------------
def feature(ring: Ring = FIELD, holes: Sequence[Ring] = (), **properties: Any) -> dict[str, Any]:
    rings = [list(map(list, closed(one))) for one in (ring, *holes)]
    geometry = {"type": "Polygon", "coordinates": rings}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def collection(*features: dict[str, Any], **members: Any) -> str:
    return json.dumps(
        {"type": "FeatureCollection", **members, "features": list(features)}, indent=2
    )


def in_crs(ring: Ring, epsg: int) -> list[tuple[float, float]]:
    turn = pyproj.Transformer.from_crs(4326, epsg, always_xy=True)
    return [turn.transform(x, y) for x, y in ring]


@kind
def geojson_io(folder: Path) -> Path:
    return saved(folder, "map.geojson", collection(feature()))


@kind
def qgis_geojson(folder: Path) -> Path:
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}
    return saved(folder, "q.geojson", collection(feature(id=1), name="q", crs=crs))


@kind
def qgis_geojson_in_utm(folder: Path) -> Path:
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25833"}}
    made = feature(in_crs(FIELD, 25833), name="Field")
    return saved(folder, "utm.geojson", collection(made, name="q", crs=crs))


@kind
def geojson_of_2008_in_mercator(folder: Path) -> Path:
    crs = {"type": "name", "properties": {"name": "EPSG:3857"}}
    return saved(folder, "m.json", collection(feature(in_crs(FIELD, 3857)), crs=crs))


@kind
def gdal_geojson_lines(folder: Path) -> Path:
    point_too = {"type": "Feature", "properties": {}, "geometry": None}
    return saved(folder, "q.geojsonl", f"{json.dumps(feature())}\n{json.dumps(point_too)}\n")


@kind
def gdal_geojson_sequence(folder: Path) -> Path:
    lines = "".join(
        f"\x1e{json.dumps(one)}\n" for one in (feature(), feature() | {"geometry": None})
    )
    return saved(folder, "q.geojsons", lines)


@kind
def bare_geometry(folder: Path) -> Path:
    return saved(folder, "polygon.json", json.dumps(feature()["geometry"]))


@kind
def bare_feature(folder: Path) -> Path:
    return saved(folder, "feature.geojson", json.dumps(feature(name="Field")))


@kind
def arcgis_online_geojson(folder: Path) -> Path:
    """A MultiPolygon of one part, with heights, and an ESRI-like id."""
    ring = [[x, y, 36.0] for x, y in closed(FIELD)]
    one = {
        "type": "Feature",
        "id": 1,
        "geometry": {"type": "MultiPolygon", "coordinates": [[ring]]},
        "properties": {"OBJECTID": 1, "Shape__Area": 11346.4},
    }
    return saved(
        folder, "arcgis.geojson", json.dumps({"type": "FeatureCollection", "features": [one]})
    )


@kind
def geometry_collection(folder: Path) -> Path:
    inner = {"type": "GeometryCollection", "geometries": [feature()["geometry"]]}
    value = {"type": "Feature", "properties": {"name": "Field"}, "geometry": inner}
    return saved(folder, "gc.geojson", json.dumps(value))


@kind
def geojson_with_mark(folder: Path) -> Path:
    """UTF-8 with a byte order mark, as some editors on Windows save it."""
    return saved(folder, "bom.geojson", b"\xef\xbb\xbf" + collection(feature()).encode())


@kind
def overpass_turbo(folder: Path) -> Path:
    made = feature(**{"@id": "way/1", "landuse": "meadow", "name": "Wiese"}) | {"id": "way/1"}
    extra = {
        "generator": "overpass-turbo",
        "copyright": "ODbL",
        "timestamp": "2024-01-01T00:00:00Z",
    }
    return saved(folder, "export.geojson", collection(made, **extra))


# --- QGroundControl -----------------------------------------------------------------------------
def lat_lon(ring: Ring) -> list[list[float]]:
    return [[y, x] for x, y in ring]


def plan(**sections: Any) -> str:
    empty: dict[str, Any] = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "mission": {
            "version": 2, "firmwareType": 12, "vehicleType": 2, "cruiseSpeed": 15, "hoverSpeed": 5,
            "globalPlanAltitudeMode": 1, "items": [],
            "plannedHomePosition": [HOME[1], HOME[0], 36],
        },
        "geoFence": {"version": 2, "circles": [], "polygons": []},
        "rallyPoints": {"version": 2, "points": []},
    }  # fmt: skip
    for key, value in sections.items():
        empty[key] |= value
    return json.dumps(empty, indent=4)


TRANSECTS = {
    "version": 1, "CameraShots": 0, "CameraTriggerInTurnAround": True, "FollowTerrain": False,
    "HoverAndCapture": False, "Items": [], "Refly90Degrees": False, "TurnAroundDistance": 10,
    "VisualTransectPoints": lat_lon(FIELD[:2]),
    "CameraCalc": {
        "version": 1, "AdjustedFootprintFrontal": 25, "AdjustedFootprintSide": 25,
        "CameraName": "Manual (no camera specs)", "DistanceToSurface": 50,
        "DistanceToSurfaceRelative": True,
    },
}  # fmt: skip
SURVEY = {
    "type": "ComplexItem", "complexItemType": "survey", "version": 5, "angle": 0,
    "entryLocation": 0, "flyAlternateTransects": False, "splitConcavePolygons": False,
    "polygon": lat_lon(FIELD), "TransectStyleComplexItem": TRANSECTS,
}  # fmt: skip
INCLUSION = {"version": 1, "inclusion": True, "polygon": lat_lon(AROUND)}


def waypoint_item(x: float, y: float, command: int = 16) -> dict[str, Any]:
    return {
        "type": "SimpleItem", "command": command, "frame": 3, "autoContinue": True, "doJumpId": 1,
        "params": [0, 0, 0, None, y, x, 30], "Altitude": 30, "AltitudeMode": 1,
    }  # fmt: skip


@kind
def qgc_survey_with_fence(folder: Path) -> Path:
    exclusion = {"version": 1, "inclusion": False, "polygon": lat_lon(POND)}
    takeoff = waypoint_item(*HOME, command=22)
    text = plan(
        mission={"items": [takeoff, SURVEY]},
        geoFence={"polygons": [INCLUSION, exclusion]},
        rallyPoints={"points": [[HOME[1], HOME[0], 20]]},
    )
    return saved(folder, "survey.plan", text)


@kind
def qgc_survey_alone(folder: Path) -> Path:
    """Never near a vehicle: no planned home."""
    text = plan(mission={"items": [SURVEY], "plannedHomePosition": [0, 0, 0]})
    return saved(folder, "alone.plan", text)


@kind
def qgc_waypoints(folder: Path) -> Path:
    items = [waypoint_item(x, y) for x, y in FIELD]
    return saved(folder, "ways.plan", plan(mission={"items": [waypoint_item(*HOME, 22), *items]}))


@kind
def qgc_survey_with_circles(folder: Path) -> Path:
    circles = [
        {"circle": {"center": [52.4565, 13.30375], "radius": 150}, "inclusion": True, "version": 1},
        {"circle": {"center": [52.45645, 13.3037], "radius": 10}, "inclusion": False, "version": 1},
    ]
    return saved(folder, "c.plan", plan(mission={"items": [SURVEY]}, geoFence={"circles": circles}))


@kind
def qgc_of_2017(folder: Path) -> Path:
    """Version 1 of the geofence: one polygon, not in a list of them."""
    text = plan(mission={"items": [SURVEY]}, geoFence={"version": 1, "polygon": lat_lon(AROUND)})
    return saved(folder, "old.plan", text)


# --- Mission Planner ----------------------------------------------------------------------------
def wpl(*rows: tuple[int, float, float, float]) -> str:
    """A QGC WPL 110 file: command, its first parameter, longitude, latitude."""
    lines = ["QGC WPL 110"]
    for i, (command, first, x, y) in enumerate(rows):
        values = "\t".join(f"{v:.8f}" for v in (first, 0, 0, 0, y, x, 100))
        lines.append(f"{i}\t{int(i == 0)}\t{0 if i == 0 else 3}\t{command}\t{values}\t1")
    return "\r\n".join(lines) + "\r\n"


@kind
def mission_planner_waypoints(folder: Path) -> Path:
    rows = [(16, 0.0, *HOME), (22, 0.0, 0.0, 0.0), *((16, 0.0, x, y) for x, y in FIELD)]
    return saved(folder, "mp.waypoints", wpl(*rows, (20, 0.0, 0.0, 0.0)))


@kind
def mission_planner_fence(folder: Path) -> Path:
    """The fence and a hole in it, as items (since 2020), and a rally point."""
    rows = [
        (16, 0.0, 0.0, 0.0),
        *((5001, 4.0, x, y) for x, y in FIELD),
        *((5002, 4.0, x, y) for x, y in POND),
        (5100, 0.0, *HOME_INSIDE),
    ]
    return saved(folder, "fence.waypoints", wpl(*rows))


@kind
def mission_planner_polygon(folder: Path) -> Path:
    lines = [f"{y} {x}" for x, y in FIELD]
    return saved(folder, "a.poly", "\r\n".join(["#saved by Mission Planner 1.3.80", *lines]))


@kind
def mission_planner_old_fence(folder: Path) -> Path:
    """Since 2012: the return point, the polygon, its first corner again."""
    lines = [f"{y} {x}" for x, y in (HOME_INSIDE, *closed(FIELD))]
    return saved(folder, "a.fen", "\r\n".join(["#saved by APM Planner", *lines, ""]))


# --- Shapefile ----------------------------------------------------------------------------------
def shp(
    rings: Sequence[Sequence[Ring]], names: Sequence[str], epsg: int | None = 4326, z: bool = False
) -> dict[str, bytes]:
    """The files of a Shapefile: outer rings clockwise, holes the other way, as ESRI has it."""
    files = {suffix: io.BytesIO() for suffix in ("shp", "shx", "dbf")}
    with shapefile.Writer(**files, shapeType=15 if z else 5) as writer:
        writer.field("Name", "C", 40)
        for polygon, name in zip(rings, names, strict=True):
            turned = []
            for k, ring in enumerate(polygon):
                points = closed(ring)
                if Polygon(points).exterior.is_ccw == (k == 0):
                    points.reverse()
                turned.append([[x, y, 36.0] if z else [x, y] for x, y in points])
            (writer.polyz if z else writer.poly)(turned)
            writer.record(name)
    parts = {suffix: file.getvalue() for suffix, file in files.items()}
    if epsg is not None:
        parts["prj"] = pyproj.CRS.from_epsg(epsg).to_wkt("WKT1_ESRI").encode()
    return parts


def beside(folder: Path, stem: str, parts: dict[str, bytes], upper: bool = False) -> Path:
    for suffix, data in parts.items():
        saved(folder, f"{stem}.{suffix.upper() if upper else suffix}", data)
    return folder / f"{stem}.{'SHP' if upper else 'shp'}"


@kind
def qgis_shapefile(folder: Path) -> Path:
    return beside(folder, "field", shp([[FIELD]], ["Field"]) | {"cpg": b"UTF-8"})


@kind
def qgis_shapefile_zipped(folder: Path) -> Path:
    parts = shp([[FIELD]], ["Field"])
    return saved(folder, "f.zip", zipped({f"f/field.{s}": data for s, data in parts.items()}))


@kind
def arcgis_shapefile_in_utm(folder: Path) -> Path:
    parts = shp([[in_crs(FIELD, 32633)]], ["Field"], 32633, z=True)
    return beside(folder, "utm", parts | {"cpg": b"UTF-8", "shp.xml": b"<metadata/>"})


@kind
def shapefile_of_a_state(folder: Path) -> Path:
    """Gauss-Krueger, on another ellipsoid, with suffixes in upper case."""
    return beside(folder, "GK", shp([[in_crs(FIELD, 31468)]], ["Flur"], 31468), upper=True)


@kind
def shapefile_without_projection(folder: Path) -> Path:
    return beside(folder, "bare", {"shp": shp([[FIELD]], [""])["shp"]})


@kind
def shapefile_with_hole(folder: Path) -> Path:
    return beside(folder, "hole", shp([[FIELD, POND]], ["Field"]))


# --- GeoPackage ---------------------------------------------------------------------------------
def gpkg_blob(ring: Ring, srs: int, holes: Sequence[Ring] = (), envelope: bool = True) -> bytes:
    polygon = Polygon(ring, holes)
    west, south, east, north = polygon.bounds
    header = struct.pack("<2sBBi", b"GP", 0, 3 if envelope else 1, srs)
    around = struct.pack("<4d", west, east, south, north) if envelope else b""
    return header + around + shapely.to_wkb(polygon)


def gpkg(
    folder: Path, tables: dict[str, list[tuple[str, bytes]]], srs: int = 4326, name: str = "a.gpkg"
) -> Path:
    """A GeoPackage with tables of names and geometries, by the standard's own names."""
    path = folder / name
    file = sqlite3.connect(path)
    file.executescript(
        "PRAGMA application_id = 1196444487; PRAGMA user_version = 10300;"
        "CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT, srs_id INTEGER PRIMARY KEY, organization"
        " TEXT, organization_coordsys_id INTEGER, definition TEXT, description TEXT);"
        "CREATE TABLE gpkg_contents (table_name TEXT PRIMARY KEY, data_type TEXT, identifier TEXT,"
        " description TEXT, last_change TEXT, min_x, min_y, max_x, max_y, srs_id INTEGER);"
        "CREATE TABLE gpkg_geometry_columns (table_name TEXT, column_name TEXT, geometry_type_name"
        " TEXT, srs_id INTEGER, z INTEGER, m INTEGER);"
    )
    for number, organization in ((srs, "EPSG"), (0, "NONE"), (-1, "NONE")):
        wkt = pyproj.CRS.from_epsg(srs).to_wkt("WKT1_GDAL") if number > 0 else "undefined"
        row = (f"EPSG:{number}", number, organization, number, wkt, "")
        file.execute("INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, ?)", row)
    for table, rows in tables.items():
        quoted = '"' + table.replace('"', '""') + '"'
        file.execute(f"CREATE TABLE {quoted} (fid INTEGER PRIMARY KEY, geom BLOB, name TEXT)")
        file.execute(
            "INSERT INTO gpkg_contents VALUES (?, 'features', ?, '', '', 0, 0, 0, 0, ?)",
            (table, table, srs),
        )
        file.execute(
            "INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', 'POLYGON', ?, 0, 0)", (table, srs)
        )
        insert = f"INSERT INTO {quoted} (geom, name) VALUES (?, ?)"
        file.executemany(insert, [(blob, title) for title, blob in rows])
    file.commit()
    file.close()
    return path


@kind
def qgis_geopackage(folder: Path) -> Path:
    return gpkg(folder, {"my fields": [("Field", gpkg_blob(FIELD, 4326))]})


@kind
def geopackage_in_utm(folder: Path) -> Path:
    blob = gpkg_blob(in_crs(FIELD, 25833), 25833, envelope=False)
    return gpkg(folder, {'o"dd': [("Field", blob)]}, 25833, "utm.gpkg")


@kind
def geopackage_with_roles(folder: Path) -> Path:
    return gpkg(
        folder,
        {
            "areas": [("Field", gpkg_blob(FIELD, 4326, [POND]))],
            "limits": [("fence", gpkg_blob(AROUND, 4326))],
        },
        name="roles.gpkg",
    )
