"""Areas as files, as drawing tools write them.

Each file of `tests/data/areas` is a kind; others are written here, by the tools' own writers (GDAL,
pymavlink, fastkml) if there are any.
"""

from __future__ import annotations

import io
import json
import shutil
import zipfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import fastkml
import gpxpy.gpx
import numpy as np
import pygeoif
import pyogrio
import pyproj
import shapely
from pymavlink import mavwp
from pymavlink.dialects.v20 import ardupilotmega as mav
from shapely.geometry import Polygon

FIELD = ((13.303, 52.456), (13.3045, 52.456), (13.3045, 52.457), (13.303, 52.457))
"""Longitude and latitude of the corners: 102 m x 111 m."""
POND = ((13.3035, 52.4563), (13.3035, 52.4566), (13.3039, 52.4566), (13.3039, 52.4563))
AROUND = ((13.3025, 52.4556), (13.3050, 52.4556), (13.3050, 52.4574), (13.3025, 52.4574))
HOME = (13.30375, 52.4558)
HOME_INSIDE = (13.30375, 52.4562)

Ring = Sequence[tuple[float, float]]
SAMPLES = Path(__file__).parents[2] / "data" / "areas"


def copied(folder: Path, sample: Path) -> Path:
    """Copy a sample, for a Shapefile its whole folder; return the file to be read."""
    if sample.is_dir():
        shutil.copytree(sample, folder, dirs_exist_ok=True)
        return next(folder.glob("*.[sS][hH][pP]"))
    return Path(shutil.copy(sample, folder))


KINDS: dict[str, Callable[[Path], Path]] = {
    sample.stem: partial(copied, sample=sample) for sample in sorted(SAMPLES.iterdir())
}
"""Writers for each kind, by name: each writes into a folder, and returns the file to be read."""


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
def kml_polygon(ring: Ring = FIELD) -> str:
    places = " ".join(f"{x},{y},0" for x, y in closed(ring))
    return (
        "<Polygon><outerBoundaryIs><LinearRing><coordinates>\n\t\t"
        f"{places} \n</coordinates></LinearRing></outerBoundaryIs></Polygon>"
    )


def placemark(name: str, geometry: str) -> str:
    return f"<Placemark><name>{name}</name><styleUrl>#s</styleUrl>{geometry}</Placemark>"


def point(at: tuple[float, float]) -> str:
    return f"<Point><coordinates>{at[0]},{at[1]},0</coordinates></Point>"


def kml(inside: str) -> str:
    head = '<?xml version="1.0" encoding="UTF-8"?>'
    return f'{head}\n<kml xmlns="http://www.opengis.net/kml/2.2">{inside}</kml>'


def zipped(files: dict[str, str | bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return buffer.getvalue()


@kind
def fastkml_document(folder: Path) -> Path:
    ring = pygeoif.geometry.Polygon(closed(FIELD))
    placemark = fastkml.Placemark(name="Field", geometry=ring)
    file = fastkml.KML(features=[fastkml.Document(features=[placemark])])
    return saved(folder, "fast.kml", file.to_string())


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


# --- Mission Planner ----------------------------------------------------------------------------
def wpl(*rows: tuple[int, float, float, float]) -> str:
    """Return a QGC WPL 110 file: command, its first parameter, longitude, latitude."""
    lines = ["QGC WPL 110"]
    for i, (command, first, x, y) in enumerate(rows):
        values = "\t".join(f"{v:.8f}" for v in (first, 0, 0, 0, y, x, 100))
        lines.append(f"{i}\t{int(i == 0)}\t{0 if i == 0 else 3}\t{command}\t{values}\t1")
    return "\r\n".join(lines) + "\r\n"


STRUCTURE = {
    "type": "ComplexItem", "complexItemType": "StructureScan", "version": 2, "Altitude": 50,
    "CameraCalc": TRANSECTS["CameraCalc"], "Layers": 1, "StructureHeight": 25,
    "altitudeRelative": True, "polygon": lat_lon(POND),
}  # fmt: skip


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
    """Return the return point, the corners, the first corner again; no suffix names the format."""
    loader = mavwp.MAVFenceLoader()
    for x, y in (HOME_INSIDE, *closed(FIELD)):
        loader.add_latlon(y, x)
    path = folder / "fence.txt"
    loader.save(str(path))
    return path


# --- GPX ------------------------------------------------------------------------------------------
def gpx(*, tracks: dict[str, Ring]) -> str:
    file = gpxpy.gpx.GPX()
    file.creator = "OsmAnd"
    for name, ring in tracks.items():
        segment = gpxpy.gpx.GPXTrackSegment(
            [gpxpy.gpx.GPXTrackPoint(y, x, elevation=36.0) for x, y in ring]
        )
        file.tracks.append(gpxpy.gpx.GPXTrack(name=name))
        file.tracks[-1].segments.append(segment)
    return file.to_xml("1.1")


# --- Shapefile ----------------------------------------------------------------------------------
def shapefile(kind: str = "qgis_shapefile") -> dict[str, bytes]:
    """Return the files of a Shapefile, by their suffixes."""
    return {path.suffix[1:]: path.read_bytes() for path in (SAMPLES / kind).iterdir()}


def beside(folder: Path, stem: str, parts: dict[str, bytes]) -> Path:
    for suffix, data in parts.items():
        saved(folder, f"{stem}.{suffix}", data)
    return folder / f"{stem}.shp"


# --- GDAL, which QGIS, ArcGIS Pro, R and most others write with ---------------------------------
def by_gdal(folder: Path, name: str, driver: str, epsg: int = 4326, **options: Any) -> Path:
    """Write the field with a name and two columns without places."""
    path, ring = folder / name, FIELD if epsg == 4326 else in_crs(FIELD, epsg)
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
