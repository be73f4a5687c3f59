"""map.gpkg: all layers in the UTM zone of the grid, with the styles of QGIS (OGC 12-128r17).

Fixed settings and the dates of the mission: the same flight gives the same bytes.
"""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final
from xml.sax.saxutils import quoteattr

import numpy as np
import pyproj
import shapely

from uavmap.base.version import __version__
from uavmap.output.drawing import palette
from uavmap.output.drawing.palette import Colour
from uavmap.output.facts.flown_mission import FlownMission
from uavmap.output.formats.layers import Layer, Shapes

APPLICATION_ID: Final = 0x47504B47  # GPKG
VERSION: Final = 10300
_NO_DATE: Final = "1970-01-01T00:00:00.000Z"
_TYPES: Final = {
    "text": "TEXT", "whole": "INTEGER", "number": "REAL", "yes or no": "BOOLEAN",
    "time": "DATETIME",
}  # fmt: skip
_SCHEMA: Final = """
CREATE TABLE gpkg_spatial_ref_sys (
  srs_name TEXT NOT NULL, srs_id INTEGER NOT NULL PRIMARY KEY, organization TEXT NOT NULL,
  organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT);
CREATE TABLE gpkg_contents (
  table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE,
  description TEXT DEFAULT '',
  last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')),
  min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE, srs_id INTEGER,
  CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_geometry_columns (
  table_name TEXT NOT NULL, column_name TEXT NOT NULL, geometry_type_name TEXT NOT NULL,
  srs_id INTEGER NOT NULL, z TINYINT NOT NULL, m TINYINT NOT NULL,
  CONSTRAINT pk_geom_cols PRIMARY KEY (table_name, column_name),
  CONSTRAINT uk_gc_table_name UNIQUE (table_name),
  CONSTRAINT fk_gc_tn FOREIGN KEY (table_name) REFERENCES gpkg_contents(table_name),
  CONSTRAINT fk_gc_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys (srs_id));
CREATE TABLE layer_styles (
  id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, f_table_catalog TEXT(256),
  f_table_schema TEXT(256), f_table_name TEXT(256), f_geometry_column TEXT(256),
  styleName TEXT(30), styleQML TEXT, styleSLD TEXT, useAsDefault BOOLEAN, description TEXT,
  owner TEXT(30), ui TEXT(30),
  update_time DATETIME DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')));
"""
_GEOGRAPHIC: Final = (
    'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563,'
    'AUTHORITY["EPSG","7030"]],AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,'
    'AUTHORITY["EPSG","8901"]],UNIT["degree",0.0174532925199433,AUTHORITY["EPSG","9122"]],'
    'AXIS["Latitude",NORTH],AXIS["Longitude",EAST],AUTHORITY["EPSG","4326"]]'
)


def encode(flown: FlownMission, layers: Sequence[Layer]) -> bytes:
    """Encode the file."""
    file = sqlite3.connect(":memory:")
    try:
        file.execute("PRAGMA page_size = 4096")
        file.execute("PRAGMA encoding = 'UTF-8'")
        file.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        file.execute(f"PRAGMA user_version = {VERSION}")
        file.executescript(_SCHEMA)
        with file:
            _systems(file, flown)
            for layer in layers:
                _layer(file, flown, layer)
            _styles(file, flown, layers)
        return file.serialize()
    finally:
        file.close()


def _systems(file: sqlite3.Connection, flown: FlownMission) -> None:
    epsg = flown.data.grid.zone.epsg
    system = pyproj.CRS.from_epsg(epsg)
    file.executemany(
        "INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, ?)",
        [
            ("Undefined cartesian SRS", -1, "NONE", -1, "undefined", None),
            ("Undefined geographic SRS", 0, "NONE", 0, "undefined", None),
            ("WGS 84 geodetic", 4326, "EPSG", 4326, _GEOGRAPHIC, None),
            (system.name, epsg, "EPSG", epsg, system.to_wkt("WKT1_GDAL"), None),
        ],
    )


def _layer(file: sqlite3.Connection, flown: FlownMission, layer: Layer) -> None:
    srs = flown.data.grid.zone.epsg
    columns = ", ".join(f'"{field.name}" {_TYPES[field.kind]}' for field in layer.fields)
    shape = layer.geometry.upper()
    file.execute(
        f'CREATE TABLE "{layer.name}" (fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, '
        f"geom {shape}, {columns})"
    )
    bounds = [shapely.total_bounds(shapes) for shapes, _ in layer.parts()]
    box = [*np.fmin.reduce(bounds)[:2].tolist(), *np.fmax.reduce(bounds)[2:].tolist()]
    _content(file, flown, layer.name, "features", layer.title, box, srs)
    file.execute(
        "INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', ?, ?, ?, 0)",
        (layer.name, shape, srs, int(layer.heights)),
    )
    marks = ", ".join("?" * (len(layer.fields) + 1))
    names = ", ".join(f'"{field.name}"' for field in layer.fields)
    for shapes, rows in layer.parts():
        filled = ((blob, *row) for blob, row in zip(_blobs(layer, shapes, srs), rows, strict=True))
        file.executemany(f'INSERT INTO "{layer.name}" (geom, {names}) VALUES ({marks})', filled)


def _content(
    file: sqlite3.Connection,
    flown: FlownMission,
    name: str,
    kind: str,
    title: str,
    bounds: Iterable[float | None],
    srs: int | None,
) -> None:
    when = flown.calendar.utc(flown.data.t_s) or _NO_DATE
    about = f"{flown.data.mission}: {title.lower()}; uavmap {__version__}"
    box = [None if value is None or np.isnan(value) else value for value in bounds]
    file.execute(
        "INSERT INTO gpkg_contents VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        (name, kind, title, about, when, *box, srs),
    )


def _styles(file: sqlite3.Connection, flown: FlownMission, layers: Sequence[Layer]) -> None:
    when = flown.calendar.utc(flown.data.t_s) or _NO_DATE
    _content(file, flown, "layer_styles", "attributes", "layer_styles", [None] * 4, 0)
    file.executemany(
        "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name, "
        "f_geometry_column, styleName, styleQML, styleSLD, useAsDefault, description, owner, ui, "
        "update_time) VALUES ('', '', ?, 'geom', ?, ?, '', 1, ?, '', NULL, ?)",
        [(one.name, one.name, qml(one), f"{one.title} of uavmap", when) for one in layers],
    )


def _blobs(layer: Layer, shapes: Shapes, srs: int) -> Iterator[bytes | None]:
    """Yield geometries: header, bounds of all but points, well-known binary."""
    binary = shapely.to_wkb(
        shapes, output_dimension=3 if layer.heights else 2, byte_order=1, flavor="iso"
    )
    point = layer.geometry == "Point"
    head = struct.pack("<2sBBi", b"GP", 0, 0b01 if point else 0b11, srs)
    bounds = shapely.bounds(shapes)[:, [0, 2, 1, 3]].astype("<f8")
    for data, box in zip(binary, bounds, strict=True):
        if data is None:
            yield None
        else:
            yield head + (b"" if point else box.tobytes()) + data


# --- styles of QGIS (QML), in the colours of map.png ----------------------------------------------
_KINDS = {
    "Point": ("marker", "SimpleMarker"),
    "LineString": ("line", "SimpleLine"),
    "Polygon": ("fill", "SimpleFill"),
    "MultiPolygon": ("fill", "SimpleFill"),
}


@dataclass(frozen=True, slots=True)
class Symbol:
    """The style of a symbol; sizes are in millimetres."""

    line: Colour
    width_mm: float
    fill: Colour | None = None
    opaque: int = 255
    """Opacity of the fill, 0 to 255."""
    dashed: bool = False
    size_mm: float = 1.0


def qml(layer: Layer) -> str:
    """Write the style of a layer for QGIS 3."""
    column, categories = _categories(layer)
    symbols = "".join(_symbol(i, layer, symbol) for i, (*_, symbol) in enumerate(categories))
    kind, attribute, listed = "singleSymbol", "", ""
    if column is not None:
        kind, attribute = "categorizedSymbol", f" attr={quoteattr(column)}"
        listed = "".join(
            f'<category value={quoteattr(value)} label={quoteattr(label)} symbol="{i}" '
            'render="true"/>'
            for i, (value, label, _) in enumerate(categories)
        )
        listed = f"<categories>{listed}</categories>"
    return (
        "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
        '<qgis version="3.22" styleCategories="Symbology">'
        f'<renderer-v2 type="{kind}"{attribute} forceraster="0" symbollevels="0" '
        f'enableorderby="0">{listed}<symbols>{symbols}</symbols></renderer-v2>'
        "<blendMode>0</blendMode><layerOpacity>1</layerOpacity></qgis>\n"
    )


def _categories(layer: Layer) -> tuple[str | None, Sequence[tuple[str, str, Symbol]]]:
    """Return the column that decides on symbols (None: one symbol), with values and labels."""
    match layer.name:
        case "cells":
            there = set(layer.column("state"))
            return "state", [
                (state, palette.STATE_NAMES[state], Symbol(_seam(colour), 0.1, colour, 200))
                for state, colour in palette.STATES.items()
                if state in there
            ]
        case "classes":
            rows = zip(layer.column("name"), layer.column("number"), strict=True)
            named = [(str(name), palette.class_colour(int(str(n)))) for name, n in rows]
            return "name", [(name, name, Symbol(c, 0.5, c, 200)) for name, c in named]
        case "tracks" | "track_points":
            width_mm, size_mm = (0.4, 1.0) if layer.name == "tracks" else (0.0, 0.8)
            colours = {
                int(str(n)): palette.track_colour(int(str(n))) for n in layer.column("vehicle")
            }
            return "vehicle", [
                (str(n), f"vehicle {n}", Symbol(colour, width_mm, colour, size_mm=size_mm))
                for n, colour in sorted(colours.items())
            ]
        case "fence":
            return "kind", [
                ("fence", "geofence", Symbol(palette.FENCE, 0.4, dashed=True)),
                ("box", "search box", Symbol(palette.BOX, 0.4, dashed=True)),
            ]
    single = {
        "region": Symbol(palette.OUTLINE, 0.7),
        "boundary": Symbol(palette.BOUNDARY, 0.5),
        "frames": Symbol(palette.INK, 0.1, (255, 255, 255), size_mm=1.0),
        "unsearched": Symbol(palette.UNSEARCHED, 0.8),
        "places": Symbol(palette.INK, 0.6, (255, 255, 255), size_mm=3.0),
    }
    return None, [("", layer.title, single[layer.name])]


def _seam(colour: Colour) -> Colour:
    red, green, blue = (round(0.9 * channel + 0.1 * 255) for channel in colour)
    return red, green, blue


def _symbol(number: int, layer: Layer, symbol: Symbol) -> str:
    kind, drawn = _KINDS[layer.geometry]
    options = "".join(
        f'<Option name="{key}" value={quoteattr(value)} type="QString"/>'
        for key, value in _options(drawn, symbol).items()
    )
    return (
        f'<symbol type="{kind}" name="{number}" alpha="1" clip_to_extent="1" force_rhr="0">'
        f'<layer class="{drawn}" enabled="1" locked="0" pass="0"><Option type="Map">{options}'
        "</Option></layer></symbol>"
    )


def _options(drawn: str, symbol: Symbol) -> dict[str, str]:
    line, width = _rgba(symbol.line, 255), f"{symbol.width_mm:g}"
    pen = "dash" if symbol.dashed else "solid"
    fill = _rgba(symbol.fill or (0, 0, 0), symbol.opaque if symbol.fill else 0)
    if drawn == "SimpleLine":
        return {
            "line_color": line, "line_width": width, "line_width_unit": "MM", "line_style": pen,
            "joinstyle": "round", "capstyle": "round",
        }  # fmt: skip
    outline = {
        "color": fill, "outline_color": line, "outline_width": width, "outline_width_unit": "MM",
        "outline_style": pen if symbol.width_mm else "no",
    }  # fmt: skip
    if drawn == "SimpleMarker":
        return {**outline, "name": "circle", "size": f"{symbol.size_mm:g}", "size_unit": "MM"}
    return {**outline, "style": "solid" if symbol.fill else "no", "joinstyle": "miter"}


def _rgba(colour: Colour, opaque: int) -> str:
    return ",".join(map(str, (*colour, opaque)))
