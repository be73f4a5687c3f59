"""A file with an area, from any of the supported tools."""

from __future__ import annotations

import difflib
import io
import zipfile
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Final

from missions.errors import AreaError
from uavmap.base.text_files import read_bytes
from uavmap.load.areas.archive import check_archive
from uavmap.load.areas.drawing import MAX_BYTES, Area, Drawing, Layer, bounded_together, in_wgs84
from uavmap.load.areas.geojson import read_geojson
from uavmap.load.areas.geopackage import read_geopackage
from uavmap.load.areas.ground_station import is_pairs, read_plan, read_polygon, read_waypoints
from uavmap.load.areas.markup import local, read_gpx, read_kml, read_kmz, root_of, unsupported_xml
from uavmap.load.areas.shp import read_shapefile, read_zipped
from uavmap.load.areas.table import is_table, read_table

KINDS: Final = (
    "KML, KMZ, GeoJSON, Shapefile (.shp, .zip), GeoPackage (.gpkg), GPX, CSV, "
    "QGroundControl .plan, Mission Planner .waypoints, .poly, .fen"
)
_ZIP: Final = b"PK\x03\x04"
_SQLITE: Final = b"SQLite format 3\x00"
_SHAPEFILE: Final = b"\x00\x00\x27\x0a"
_BESIDE: Final = ("dbf", "prj", "cpg")


def read_area_file(name: str, *, epsg: int | None = None, swap: bool = False) -> Drawing:
    """Read the drawing in a file, in WGS84.

    The content decides on the kind of file; the suffix decides only between similar kinds.

    Args:
        name: Path of the file.
        epsg: EPSG number for a file that names no coordinate system.
        swap: Exchange latitude and longitude.

    Raises:
        AreaError: The file cannot be read; the message has file, fault and remedy.
    """
    path = Path(name)
    try:
        data = read_bytes(path, MAX_BYTES)
    except OSError as error:
        raise AreaError(f"{name}: cannot be read ({error.strerror}){_guess(path)}") from None
    except ValueError:
        raise AreaError(f"{name!r}: not a name of a file") from None
    if not data.strip():
        raise AreaError(f"{name}: is empty; save the area anew")
    layers: list[Layer] = []
    for layer in _layers(path, data, name):
        layers.append(layer)
        bounded_together(layers, name)
    drawing = in_wgs84(layers, name, given=epsg, swap=swap)
    if drawing.areas:
        return drawing
    if not drawing.fences:
        why = f" ({drawing.notices[0]})" if drawing.notices else ""
        raise AreaError(f"{name}: holds no polygon{why}; draw the area as a closed polygon")
    return replace(
        drawing,
        areas=tuple(Area(f"inside of {one.name}", one.ring) for one in drawing.fences),
        notices=(*drawing.notices, "no area, but a fence: the area is the inside of the fence"),
    )


def _guess(path: Path) -> str:
    try:
        names = [one.name for one in path.parent.iterdir()] if path.parent.is_dir() else []
    except OSError:
        names = []
    near = difflib.get_close_matches(path.name, names, n=1)
    return f"; did you mean {str(path.with_name(near[0]))!r}?" if near else ""


def _layers(path: Path, data: bytes, name: str) -> Iterable[Layer]:
    suffix = path.suffix.lower()
    if data.startswith(_SQLITE):
        return read_geopackage(path, name)
    if data.startswith(_ZIP):
        check_archive(data, name)
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            suffixes = {Path(member).suffix.lower() for member in archive.namelist()}
        return read_zipped(data, name) if ".shp" in suffixes else read_kmz(data, name)
    if data.startswith(_SHAPEFILE) or suffix == ".shp":
        return [read_shapefile({"shp": data, **_beside(path, name)}, path.stem, name)]
    if suffix in (".dbf", ".shx", ".prj"):
        raise AreaError(f"{name}: a part of a Shapefile; give {path.with_suffix('.shp').name}")
    if suffix in (".gpkg", ".zip", ".kmz"):
        raise AreaError(f"{name}: its content is not of the kind {suffix}; export it anew")
    head = data[:200].lstrip(b"\xef\xbb\xbf\xff\xfe\x00 \t\r\n")
    if suffix in (".kml", ".gpx") or head.startswith(b"<"):
        root = root_of(data, name)
        readers = {"kml": read_kml, "gpx": read_gpx}
        if local(root) not in readers:
            raise unsupported_xml(root, name)
        return [readers[local(root)](root, name)]
    return [_of_text(data, suffix, head, name)]


def _of_text(data: bytes, suffix: str, head: bytes, name: str) -> Layer:
    try:
        text = data.decode("utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
    except UnicodeDecodeError:
        raise _unknown(name) from None
    if head.startswith((b"QGC WPL", b"Q\x00G\x00C\x00")):
        return read_waypoints(text, name)
    if suffix == ".plan" or ('"fileType"' in text[:100_000] and suffix not in (".geojson",)):
        return read_plan(text, name)
    if suffix in (".poly", ".fen"):
        return read_polygon(text, name, fence=suffix == ".fen")
    if text.startswith("RALLY"):
        raise AreaError(f"{name}: rally points alone; give the file of the fence or the polygon")
    if head.startswith((b"{", b"[", b"\x1e")) or suffix in (".geojson", ".json", ".geojsonl"):
        return read_geojson(text, name)
    if is_table(text):
        return read_table(text, name)
    if is_pairs(text):
        return read_polygon(text, name, fence=None)
    raise _unknown(name)


def _unknown(name: str) -> AreaError:
    return AreaError(f"{name}: unknown kind of file; export the area as one of these: {KINDS}")


def _beside(path: Path, name: str) -> dict[str, bytes]:
    found: dict[str, bytes] = {}
    for suffix in _BESIDE:
        for one in (path.with_suffix(f".{suffix}"), path.with_suffix(f".{suffix.upper()}")):
            if one.is_file():
                try:
                    found[suffix] = read_bytes(one, MAX_BYTES)
                except OSError as error:
                    raise AreaError(
                        f"{name}: {one.name} cannot be read ({error.strerror})"
                    ) from None
                break
    return found
