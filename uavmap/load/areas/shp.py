"""ESRI Shapefiles: a .shp with its .dbf and .prj beside it, or all of them in a zip archive."""

from __future__ import annotations

import contextlib
import io
import logging
import struct
import warnings
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import PurePosixPath
from typing import Any, Final

import shapefile

from missions.errors import AreaError
from uavmap.load.areas.archive import read_member
from uavmap.load.areas.drawing import (
    MAX_SHAPES,
    NAME_COLUMNS,
    Layer,
    Point,
    Rings,
    Shape,
    crs_of_wkt,
    layer_of,
    row_name,
    shapes_of,
)

_POLYGONS: Final = (shapefile.POLYGON, shapefile.POLYGONZ, shapefile.POLYGONM)
_POINTS: Final = (shapefile.POINT, shapefile.POINTZ, shapefile.POINTM)
_DAMAGED: Final = (
    shapefile.ShapefileException, struct.error, ValueError, KeyError, IndexError, TypeError,
    AttributeError, OverflowError, EOFError, OSError, LookupError, AssertionError,
)  # fmt: skip


def read_shapefile(parts: Mapping[str, bytes], stem: str, source: str) -> Layer:
    """Read the polygons of a Shapefile from its files' bytes by suffix. Raises `AreaError`."""
    text = parts.get("prj", b"").decode("utf-8", errors="replace").strip()
    system = crs_of_wkt(text, f"{source}: its .prj") if text else None
    return layer_of(_shapes(parts, stem, source), system, source)


def read_zipped(data: bytes, source: str) -> Iterator[Layer]:
    """Read every Shapefile of an archive. Raises `AreaError`."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        families: dict[PurePosixPath, dict[str, str]] = {}
        for name in archive.namelist():
            path = PurePosixPath(name)
            if path.name and not name.startswith("__MACOSX/"):
                families.setdefault(path.with_suffix(""), {})[path.suffix.lower()[1:]] = name
        for stem, beside in families.items():
            if "shp" not in beside:
                continue
            parts = {
                suffix: read_member(archive, n, source)
                for suffix, n in beside.items()
                if suffix in ("shp", "dbf", "prj", "cpg")
            }
            yield read_shapefile(parts, stem.name, source)


def _shapes(parts: Mapping[str, bytes], stem: str, source: str) -> Iterator[Shape]:
    try:
        rows = list(_rows(parts))
    except _DAMAGED:
        raise AreaError(
            f"{source}: not a Shapefile, or a damaged one; export it anew, or as GeoJSON or KML"
        ) from None
    for number, (polygons, points, title) in enumerate(rows, start=1):
        name = row_name(title, stem, number, len(rows))
        yield from shapes_of(name, f"{source}: {name}", [], polygons, points=points)


def _rows(parts: Mapping[str, bytes]) -> Iterator[tuple[list[Rings], list[Point], object]]:
    """Yield polygons, points and name of each record; without a readable `.dbf` no names."""
    with contextlib.ExitStack() as stack:
        stack.enter_context(_quiet())
        reader = stack.enter_context(shapefile.Reader(shp=io.BytesIO(parts["shp"])))
        titles = iter(_titles(parts))
        for i, shape in enumerate(reader.iterShapes()):
            if i > MAX_SHAPES:
                return  # the caller counts the shapes and raises the error
            title = next(titles, None)
            if shape.shapeType in _POINTS:
                yield [], [_xy(shape.points[0])], title
            elif shape.shapeType in _POLYGONS:
                geometry = shape.__geo_interface__
                inside = geometry["coordinates"]
                several = inside if geometry["type"] == "MultiPolygon" else [inside]
                yield [[[_xy(p) for p in ring] for ring in one] for one in several], [], title


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Silence pyshp on wrong lengths in headers and on rings that turn the other way."""
    logger = logging.getLogger(shapefile.__name__)
    before = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.setLevel(before)


def _xy(point: Any) -> Point:
    return float(point[0]), float(point[1])


def _titles(parts: Mapping[str, bytes]) -> list[object]:
    if "dbf" not in parts:
        return []
    encoding = parts.get("cpg", b"").decode("ascii", errors="ignore").strip() or "utf-8"
    try:
        with (
            _quiet(),
            shapefile.Reader(
                dbf=io.BytesIO(parts["dbf"]), encoding=encoding, encodingErrors="replace"
            ) as table,
        ):
            fields = {field[0].lower(): field[0] for field in table.fields}
            key = next((fields[name] for name in NAME_COLUMNS if name in fields), None)
            if key is None:
                return []
            titles: list[object] = []
            for record in table.iterRecords():
                titles.append(record[key])
                if len(titles) > MAX_SHAPES:
                    break
            return titles
    except _DAMAGED:
        return []  # shapes without names are areas as well
