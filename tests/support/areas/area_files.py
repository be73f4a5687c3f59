"""Areas as files, written as the tools that people draw with write them."""

from __future__ import annotations

import io
import json
import sqlite3
import struct
import zipfile
from collections.abc import Callable, Sequence
from functools import partial
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


def kinds(**written: tuple[str, str | bytes]) -> None:
    """Add kinds that are one file each: its name and its content."""
    for key, (name, content) in written.items():
        KINDS[key] = partial(saved, name=name, content=content)


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


_PLACEMARK = placemark("Field", kml_polygon())
kinds(
    google_earth_pro=(
        "Untitled Polygon.kml",
        kml(
            '<Document><name>Untitled Polygon.kml</name><StyleMap id="s"><Pair><key>normal</key>'
            '<styleUrl>#n</styleUrl></Pair></StyleMap><Style id="n"><LineStyle><color>ff0000ff'
            "</color></LineStyle></Style><Placemark><name>Untitled Polygon</name><LookAt>"
            "<longitude>13.3</longitude><latitude>52.4</latitude><gx:fovy>30</gx:fovy></LookAt>"
            f"<styleUrl>#s</styleUrl>{kml_polygon()}</Placemark></Document>",
            _EARTH,
        ),
    ),
    google_earth_kmz=(
        "field.kmz",
        zipped(
            {
                "doc.kml": kml(f"<Document>{_PLACEMARK}</Document>", _EARTH),
                "files/icon.png": b"\x89PNG",
            }
        ),
    ),
    google_earth_web=(
        "Project.kml",
        kml(
            '<Document id="1"><name>Project</name><gx:CascadingStyle kml:id="m"/><Folder><name>'
            f"Folder</name>{_PLACEMARK}</Folder></Document>",
            _EARTH,
        ),
    ),
    google_my_maps=(
        "map.kml",
        kml(
            "<Document><name>Map</name><description/><Folder><name>Layer</name><Placemark><name>"
            "Field</name><description><![CDATA[a <b>field</b>]]></description><ExtendedData><Data "
            "name='x'><value>1</value></Data></ExtendedData><Polygon><outerBoundaryIs><LinearRing>"
            "<tessellate>1</tessellate><coordinates>\n            "
            f"{kml_ring(FIELD, between=chr(10) + 12 * ' ')}\n          </coordinates></LinearRing>"
            "</outerBoundaryIs></Polygon></Placemark></Folder></Document>"
        ),
    ),
    qgis_kml=(
        "qgis.kml",
        kml(
            '<Document id="root_doc"><Schema name="field" id="field"><SimpleField name="id" '
            'type="int"/></Schema><Folder><name>field</name><Placemark><ExtendedData><SchemaData '
            'schemaUrl="#field"><SimpleData name="id">1</SimpleData></SchemaData></ExtendedData>'
            "<MultiGeometry><Polygon><outerBoundaryIs><LinearRing><coordinates>"
            f"{kml_ring(FIELD, height='')}</coordinates></LinearRing></outerBoundaryIs></Polygon>"
            "</MultiGeometry></Placemark></Folder></Document>"
        ),
    ),
    arcgis_kmz=(
        "Field.kmz",
        zipped(
            {
                "doc.kml": kml(
                    '<Document id="Field"><name>Field</name><Snippet></Snippet><Folder '
                    "id=\"FeatureLayer0\"><name>Field</name><Placemark id='ID_00000'><name>0</name>"
                    f"<MultiGeometry>{kml_polygon()}</MultiGeometry></Placemark></Folder></Document>"
                ),
                "Legend0.png": b"x",
            }
        ),
    ),
    google_earth_of_2006=(
        "old.kml", kml(_PLACEMARK, ' xmlns="http://earth.google.com/kml/2.1"'),
    ),
    # no namespace, spaces after the commas, upper-case suffix
    kml_by_hand=("HAND.KML", kml(_PLACEMARK.replace(",", ", "), "")),
    kml_closed_path=(
        "path.kml",
        kml(
            placemark(
                "Way around the field",
                f"<LineString><coordinates>{kml_ring(FIELD)}</coordinates></LineString>",
            )
        ),
    ),
    kml_in_utf16=("utf16.kml", kml(_PLACEMARK).replace("UTF-8", "UTF-16").encode("utf-16")),
    # area, fence, no-fly zone and home, told by their names
    kml_with_roles=(
        "roles.kml",
        kml(
            f"<Document>{placemark('Meadow', kml_polygon())}"
            f"{placemark('Geofence', kml_polygon(AROUND))}"
            f"{placemark('No-fly pond', kml_polygon(POND))}"
            f"{placemark('Take-off', point(HOME))}"
            f"{placemark('Car park', point((13.30, 52.45)))}</Document>"
        ),
    ),
    kml_with_hole=("hole.kml", kml(placemark("Field", kml_polygon(FIELD, [POND])))),
)  # fmt: skip


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


def crs(name: str) -> dict[str, Any]:
    return {"type": "name", "properties": {"name": name}}


_NOTHING = {"type": "Feature", "properties": {}, "geometry": None}
_GEOMETRY = feature()["geometry"]
_MULTI = {"type": "MultiPolygon", "coordinates": [[[[x, y, 36.0] for x, y in closed(FIELD)]]]}
_IN_ANOTHER = {"type": "GeometryCollection", "geometries": [_GEOMETRY]}
kinds(
    geojson_io=("map.geojson", collection(feature())),
    qgis_geojson=(
        "q.geojson", collection(feature(id=1), name="q", crs=crs("urn:ogc:def:crs:OGC:1.3:CRS84")),
    ),
    qgis_geojson_in_utm=(
        "utm.geojson",
        collection(
            feature(in_crs(FIELD, 25833), name="Field"),
            name="q", crs=crs("urn:ogc:def:crs:EPSG::25833"),
        ),
    ),
    geojson_of_2008_in_mercator=(
        "m.json", collection(feature(in_crs(FIELD, 3857)), crs=crs("EPSG:3857")),
    ),
    gdal_geojson_lines=("q.geojsonl", f"{json.dumps(feature())}\n{json.dumps(_NOTHING)}\n"),
    gdal_geojson_sequence=(
        "q.geojsons", f"\x1e{json.dumps(feature())}\n\x1e{json.dumps(_NOTHING)}\n",
    ),
    bare_geometry=("polygon.json", json.dumps(_GEOMETRY)),
    bare_feature=("feature.geojson", json.dumps(feature(name="Field"))),
    # a MultiPolygon of one part, with heights, and an ESRI-like id
    arcgis_online_geojson=(
        "arcgis.geojson",
        collection(feature(OBJECTID=1, Shape__Area=11346.4) | {"id": 1, "geometry": _MULTI}),
    ),
    geometry_collection=(
        "gc.geojson", json.dumps(feature(name="Field") | {"geometry": _IN_ANOTHER}),
    ),
    # UTF-8 with a byte order mark, as some editors on Windows save it
    geojson_with_mark=("bom.geojson", b"\xef\xbb\xbf" + collection(feature()).encode()),
    overpass_turbo=(
        "export.geojson",
        collection(
            feature(**{"@id": "way/1", "landuse": "meadow", "name": "Wiese"}) | {"id": "way/1"},
            generator="overpass-turbo", copyright="ODbL", timestamp="2024-01-01T00:00:00Z",
        ),
    ),
)  # fmt: skip


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


kinds(
    qgc_survey_with_fence=(
        "survey.plan",
        plan(
            mission={"items": [waypoint_item(*HOME, command=22), SURVEY]},
            geoFence={
                "polygons": [
                    INCLUSION, {"version": 1, "inclusion": False, "polygon": lat_lon(POND)},
                ]
            },
            rallyPoints={"points": [[HOME[1], HOME[0], 20]]},
        ),
    ),
    # never near a vehicle: no planned home
    qgc_survey_alone=(
        "alone.plan", plan(mission={"items": [SURVEY], "plannedHomePosition": [0, 0, 0]}),
    ),
    qgc_waypoints=(
        "ways.plan",
        plan(
            mission={
                "items": [waypoint_item(*HOME, 22), *(waypoint_item(x, y) for x, y in FIELD)]
            }
        ),
    ),
    qgc_survey_with_circles=(
        "c.plan",
        plan(
            mission={"items": [SURVEY]},
            geoFence={
                "circles": [
                    {
                        "circle": {"center": [lat, lon], "radius": radius_m},
                        "inclusion": inside, "version": 1,
                    }
                    for lat, lon, radius_m, inside in (
                        (52.4565, 13.30375, 150, True), (52.45645, 13.3037, 10, False),
                    )
                ]
            },
        ),
    ),
    # version 1 of the geofence: one polygon, not in a list of them
    qgc_of_2017=(
        "old.plan",
        plan(mission={"items": [SURVEY]}, geoFence={"version": 1, "polygon": lat_lon(AROUND)}),
    ),
)  # fmt: skip


# --- Mission Planner ----------------------------------------------------------------------------
def wpl(*rows: tuple[int, float, float, float]) -> str:
    """A QGC WPL 110 file: command, its first parameter, longitude, latitude."""
    lines = ["QGC WPL 110"]
    for i, (command, first, x, y) in enumerate(rows):
        values = "\t".join(f"{v:.8f}" for v in (first, 0, 0, 0, y, x, 100))
        lines.append(f"{i}\t{int(i == 0)}\t{0 if i == 0 else 3}\t{command}\t{values}\t1")
    return "\r\n".join(lines) + "\r\n"


def corners(command: int, first: float, ring: Ring) -> list[tuple[int, float, float, float]]:
    return [(command, first, x, y) for x, y in ring]


def lines(head: str, ring: Ring) -> list[str]:
    """A head, and latitude and longitude a line."""
    return [head, *(f"{y} {x}" for x, y in ring)]


_TAKEOFF = ((16, 0.0, *HOME), (22, 0.0, 0.0, 0.0))
_RETURN = (20, 0.0, 0.0, 0.0)
kinds(
    mission_planner_waypoints=(
        "mp.waypoints", wpl(*_TAKEOFF, *corners(16, 0.0, FIELD), _RETURN),
    ),
    # the fence and a hole in it, as items (since 2020), and a rally point
    mission_planner_fence=(
        "fence.waypoints",
        wpl(
            (16, 0.0, 0.0, 0.0), *corners(5001, 4.0, FIELD), *corners(5002, 4.0, POND),
            (5100, 0.0, *HOME_INSIDE),
        ),
    ),
    mission_planner_polygon=(
        "a.poly", "\r\n".join(lines("#saved by Mission Planner 1.3.80", FIELD)),
    ),
    # since 2012: the return point, the polygon, its first corner again
    mission_planner_old_fence=(
        "a.fen", "\r\n".join([*lines("#saved by APM Planner", (HOME_INSIDE, *closed(FIELD))), ""]),
    ),
)  # fmt: skip


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
