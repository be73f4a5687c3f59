"""GeoPackage: an SQLite file with geometries as well-known binary (OGC 12-128)."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

import pyproj
import shapely
from shapely.geometry.base import BaseGeometry

from missions.errors import AreaError
from uavmap.load.areas.drawing import (
    MAX_BYTES,
    MAX_LAYERS,
    MAX_SHAPES,
    NAME_COLUMNS,
    Layer,
    Shape,
    crs_of_epsg,
    crs_of_wkt,
    layer_of,
    parts_of,
    row_name,
    shapes_of,
    shown_name,
)

_ENVELOPE_BYTES: Final = (0, 32, 48, 48, 64)
_MAX_STEPS: Final = 3000
"""Maximum steps of a query, each of 1000 instructions of SQLite: a view may never end."""


def read_geopackage(path: Path, source: str) -> Iterator[Layer]:
    """Read the polygons of all tables of features, a layer each. Raises `AreaError`."""
    wal = path.with_name(f"{path.name}-wal")
    if wal.exists() and wal.stat().st_size:
        raise AreaError(f"{source}: another program has it open ({wal.name}); close it there first")
    address = f"file:{quote(str(path.absolute()))}?mode=ro&immutable=1"
    try:
        file = sqlite3.connect(address, uri=True)
    except sqlite3.Error as error:
        raise AreaError(f"{source}: cannot be opened ({error})") from None
    try:
        _restrain(file)
        for table in _tables(file):
            yield _layer(file, table, source)
    except (sqlite3.Error, OverflowError, UnicodeError) as error:
        raise AreaError(
            f"{source}: not a readable GeoPackage ({str(error)[:80]}); export it anew"
        ) from None
    finally:
        file.close()


def _restrain(file: sqlite3.Connection) -> None:
    """Forbid functions of the file's own schema and giant values, and limit every query."""
    steps = 0

    def enough() -> int:
        nonlocal steps
        steps += 1
        return int(steps > _MAX_STEPS)

    file.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_BYTES)
    file.set_progress_handler(enough, 1000)
    file.execute("PRAGMA trusted_schema = OFF")


def _tables(file: sqlite3.Connection) -> list[tuple[Any, ...]]:
    return file.execute(
        "SELECT c.table_name, c.identifier, g.column_name, g.srs_id FROM gpkg_contents c "
        "JOIN gpkg_geometry_columns g ON c.table_name = g.table_name "
        f"WHERE c.data_type = 'features' LIMIT {MAX_LAYERS + 1}"
    ).fetchall()


def _layer(file: sqlite3.Connection, table: tuple[Any, ...], source: str) -> Layer:
    name, title, column, srs = table
    if not isinstance(name, str) or not isinstance(column, str):
        raise AreaError(f"{source}: gpkg_geometry_columns names no table; export it anew")
    listed = [row[1] for row in file.execute(f"PRAGMA table_info({_quoted(name)})")]
    lower = {str(one).lower(): str(one) for one in listed}
    key = next((lower[one] for one in NAME_COLUMNS if one in lower), None)
    wanted = ", ".join(map(_quoted, [column, key or column]))
    query = f"SELECT {wanted} FROM {_quoted(name)} LIMIT {MAX_SHAPES + 1}"
    rows = [(blob, value if key else None) for blob, value in file.execute(query)]
    stem = shown_name(title, shown_name(name, "layer"))
    return layer_of(_shapes(rows, stem, source), _system(file, srs, source), source)


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'


def _system(file: sqlite3.Connection, srs: object, source: str) -> pyproj.CRS | None:
    row = file.execute(
        "SELECT organization, organization_coordsys_id, definition FROM gpkg_spatial_ref_sys "
        "WHERE srs_id = ?",
        (srs,),
    ).fetchone()
    if srs in (0, -1) or row is None:  # by the standard: undefined
        return None
    organization, code, definition = row
    if str(organization).upper() == "EPSG" and isinstance(code, int):
        return crs_of_epsg(code, source)
    return crs_of_wkt(str(definition), source)


def _shapes(rows: list[tuple[object, object]], stem: str, source: str) -> Iterator[Shape]:
    for number, (blob, title) in enumerate(rows, start=1):
        name = row_name(title, stem, number, len(rows))
        if isinstance(title, int):
            name = f"{stem} {title}" if len(rows) > 1 else stem
        if blob is not None:
            where = f"{source}: {name}"
            polygons, points = parts_of(_geometry(blob, where))
            yield from shapes_of(name, where, [], polygons, points=points)


def _geometry(blob: object, where: str) -> BaseGeometry:
    fault = AreaError(f"{where}: its geometry cannot be read; export it anew")
    if not isinstance(blob, bytes) or len(blob) < 8 or blob[:2] != b"GP":
        raise fault
    envelope = blob[3] >> 1 & 7
    if envelope >= len(_ENVELOPE_BYTES):
        raise fault
    try:
        return shapely.from_wkb(blob[8 + _ENVELOPE_BYTES[envelope] :])
    except (shapely.errors.ShapelyError, ValueError, TypeError):
        raise fault from None
