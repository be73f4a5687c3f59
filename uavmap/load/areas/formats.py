"""The formats of files with areas. To read another one, add a row to `FORMATS`."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final, NamedTuple
from xml.etree.ElementTree import Element

from missions.errors import AreaError
from uavmap.base.text_files import read_bytes
from uavmap.load.areas.archive import check_archive
from uavmap.load.areas.drawing import MAX_BYTES, Layer
from uavmap.load.areas.geojson import read_geojson
from uavmap.load.areas.geopackage import read_geopackage
from uavmap.load.areas.ground_station import is_pairs, read_plan, read_polygon, read_waypoints
from uavmap.load.areas.markup import local, read_gpx, read_kml, read_kmz, root_of, unsupported_xml
from uavmap.load.areas.shp import read_shapefile, read_zipped
from uavmap.load.areas.table import is_table, read_table

_ZIP: Final = b"PK\x03\x04"
_SQLITE: Final = b"SQLite format 3\x00"
_SHAPEFILE: Final = b"\x00\x00\x27\x0a"
_BESIDE: Final = ("dbf", "prj", "cpg")
"""Suffixes of the files beside a Shapefile that are read."""


@dataclass(frozen=True)
class AreaFile:
    """A file that may hold an area. Its properties raise `AreaError` for damaged content."""

    path: Path
    data: bytes
    name: str
    """Name of the file in messages."""

    @property
    def suffix(self) -> str:
        """Suffix of the file, in lower case with its dot."""
        return self.path.suffix.lower()

    @property
    def head(self) -> bytes:
        """First bytes, without those before a text."""
        return self.data[:200].lstrip(b"\xef\xbb\xbf\xff\xfe\x00 \t\r\n")

    @cached_property
    def members(self) -> frozenset[str]:
        """Suffixes of the files in an archive; empty for another file."""
        if not self.data.startswith(_ZIP):
            return frozenset()
        check_archive(self.data, self.name)
        with zipfile.ZipFile(io.BytesIO(self.data)) as archive:
            return frozenset(Path(member).suffix.lower() for member in archive.namelist())

    @property
    def element(self) -> str:
        """Name of the root of an XML document; empty for another file."""
        is_xml = self.suffix in (".kml", ".gpx") or self.head.startswith(b"<")
        return local(self.root) if is_xml else ""

    @cached_property
    def root(self) -> Element:
        """Root of an XML document."""
        return root_of(self.data, self.name)

    @cached_property
    def text(self) -> str:
        """Text of a file that is not XML."""
        if self.element:
            raise unsupported_xml(self.root, self.name)
        utf_16 = self.data[:2] in (b"\xff\xfe", b"\xfe\xff")
        try:
            return self.data.decode("utf-16" if utf_16 else "utf-8-sig")
        except UnicodeDecodeError:
            raise unknown_kind(self.name) from None


class AreaFormat(NamedTuple):
    """A format of files with areas."""

    title: str
    """Name of the format in help and messages."""
    suffixes: tuple[str, ...]
    """Suffixes by which the app and other commands recognize a drawing."""
    fits: Callable[[AreaFile], bool]
    """Return whether a file has this format. The first format that fits reads it."""
    read: Callable[[AreaFile], Iterable[Layer]]
    """Read the layers of a file. Raises `AreaError`."""


def _shapefile(file: AreaFile) -> Iterable[Layer]:
    if file.members:
        return read_zipped(file.data, file.name)
    return [read_shapefile({"shp": file.data, **_beside(file)}, file.path.stem, file.name)]


def _beside(file: AreaFile) -> dict[str, bytes]:
    found: dict[str, bytes] = {}
    for suffix in _BESIDE:
        for one in (file.path.with_suffix(f".{case}") for case in (suffix, suffix.upper())):
            if one.is_file():
                try:
                    found[suffix] = read_bytes(one, MAX_BYTES)
                except OSError as error:
                    raise AreaError(
                        f"{file.name}: {one.name} cannot be read ({error.strerror})"
                    ) from None
                break
    return found


def _polygon(file: AreaFile) -> list[Layer]:
    if file.text.startswith("RALLY"):
        raise AreaError(
            f"{file.name}: rally points alone; give the file of the fence or the polygon"
        )
    fence = {".fen": True, ".poly": False}.get(file.suffix)
    return [read_polygon(file.text, file.name, fence=fence)]


FORMATS: Final = (
    AreaFormat(
        "GeoPackage", (".gpkg",),
        lambda file: file.data.startswith(_SQLITE),
        lambda file: read_geopackage(file.path, file.name),
    ),
    AreaFormat(
        "Shapefile", (".shp", ".zip"),
        lambda file: ".shp" in file.members
        or (not file.members and (file.data.startswith(_SHAPEFILE) or file.suffix == ".shp")),
        _shapefile,
    ),
    AreaFormat(
        "KMZ", (".kmz",),
        lambda file: file.data.startswith(_ZIP),
        lambda file: read_kmz(file.data, file.name),
    ),
    AreaFormat(
        "KML", (".kml",),
        lambda file: file.element == "kml",
        lambda file: [read_kml(file.root, file.name)],
    ),
    AreaFormat(
        "GPX", (".gpx",),
        lambda file: file.element == "gpx",
        lambda file: [read_gpx(file.root, file.name)],
    ),
    AreaFormat(
        "Mission Planner waypoints", (".waypoints",),
        lambda file: file.head.startswith((b"QGC WPL", b"Q\x00G\x00C\x00")),
        lambda file: [read_waypoints(file.text, file.name)],
    ),
    AreaFormat(
        "QGroundControl plan", (".plan",),
        lambda file: file.suffix == ".plan"
        or ('"fileType"' in file.text[:100_000] and file.suffix != ".geojson"),
        lambda file: [read_plan(file.text, file.name)],
    ),
    AreaFormat(
        "Mission Planner polygon or fence", (".poly", ".fen"),
        lambda file: file.suffix in (".poly", ".fen") or file.text.startswith("RALLY"),
        _polygon,
    ),
    AreaFormat(
        "GeoJSON", (".geojson", ".geojsonl", ".geojsons", ".json"),
        lambda file: file.head.startswith((b"{", b"[", b"\x1e"))
        or file.suffix in (".geojson", ".geojsonl", ".json"),
        lambda file: [read_geojson(file.text, file.name)],
    ),
    AreaFormat(
        "CSV", (".csv", ".txt"),
        lambda file: is_table(file.text),
        lambda file: [read_table(file.text, file.name)],
    ),
    AreaFormat(
        "MAVProxy fence", (),
        lambda file: is_pairs(file.text),
        _polygon,
    ),
)  # fmt: skip
"""All formats, in the order in which they are tried: binary ones, XML, other texts."""
SUFFIXES: Final = tuple(suffix for each in FORMATS for suffix in each.suffixes)
"""Suffixes of the files from which `uavmap new` makes missions."""
TITLES: Final = ", ".join(each.title for each in FORMATS)
"""All formats, for help and messages."""


def layers_of(file: AreaFile) -> Iterable[Layer]:
    """Return the layers of a file in the format of its content. Raises `AreaError`."""
    suffix, name = file.suffix, file.name
    if not file.data.startswith((_SQLITE, _ZIP, _SHAPEFILE)):
        if suffix in (".dbf", ".shx", ".prj"):
            shp = file.path.with_suffix(".shp").name
            raise AreaError(f"{name}: a part of a Shapefile; give {shp}")
        if suffix in (".gpkg", ".zip", ".kmz"):
            raise AreaError(f"{name}: its content is not of the kind {suffix}; export it anew")
    for each in FORMATS:
        if each.fits(file):
            return each.read(file)
    raise unknown_kind(name)


def unknown_kind(name: str) -> AreaError:
    """Return the error for a file that has none of the formats."""
    return AreaError(f"{name}: unknown kind of file; export the area as one of these: {TITLES}")
