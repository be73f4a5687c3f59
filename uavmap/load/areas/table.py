"""CSV tables of places: polygons as WKT, corners as latitude and longitude, or waypoints."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from pathlib import PurePath
from typing import Final

import shapely

from missions.errors import AreaError
from uavmap.base.printable import printable
from uavmap.load.areas.drawing import (
    MAX_BYTES,
    MAX_SHAPES,
    MAX_VERTICES,
    NAME_COLUMNS,
    WGS84,
    Layer,
    Point,
    Role,
    Shape,
    layer_of,
    number,
    parts_of,
    polygon,
    row_name,
    shapes_of,
    shown_name,
)
from uavmap.load.areas.ground_station import with_area

_WKT: Final = ("wkt", "geometry", "geom", "the_geom", "wkt_geom")
_LATITUDE: Final = ("latitude", "lat")
_LONGITUDE: Final = ("longitude", "lon", "lng", "long")
_WAYPOINTS: Final = ("altitude(m)", "altitude(ft)", "curvesize(m)", "curvesize(ft)")
"""Columns of a mission of Litchi: its rows are a path over the area, not its corners."""
_BETWEEN: Final = ",;\t"


def is_table(text: str) -> bool:
    """Return whether the first line names columns of places.

    >>> is_table("lat;lon\\n52,4;13,3\\n"), is_table("52.4,13.3\\n"), is_table('{"lat": 1}')
    (True, False, False)
    """
    names = set(_names(text))
    places = not names.isdisjoint(_LATITUDE) and not names.isdisjoint(_LONGITUDE)
    return places or not names.isdisjoint(_WKT)


def _between(text: str) -> str:
    """Return the separator of columns: the most frequent one in the first line."""
    head = _head(text)
    return max(_BETWEEN, key=head.count)


def _head(text: str) -> str:
    return text.lstrip().partition("\n")[0][:10_000]


def _names(text: str) -> list[str]:
    return [name.strip().strip('"').lower() for name in _head(text).split(_between(text))]


def read_table(text: str, source: str) -> Layer:
    """Read polygons from a column of WKT, or one from the rows' places. Raises `AreaError`."""
    names, rows = _names(text), list(_rows(text, source))
    wkt = next((names.index(one) for one in _WKT if one in names), None)
    if wkt is not None:
        title = next((names.index(one) for one in NAME_COLUMNS if one in names), None)
        return layer_of(_by_wkt(rows, wkt, title, source), None, source)
    columns = (_column(names, _LATITUDE), _column(names, _LONGITUDE))
    points = [_place(row, columns, f"{source}: row {i + 2}") for i, row in enumerate(rows)]
    if not set(names).isdisjoint(_WAYPOINTS):
        return with_area([], points, None, source)
    return layer_of([polygon("polygon", [points], source, Role.AREA)], WGS84, source)


def _rows(text: str, source: str) -> Iterator[list[str]]:
    before = csv.field_size_limit(MAX_BYTES)  # the outline of a large region is one long cell
    try:
        reader = csv.reader(text.strip().splitlines()[1:], delimiter=_between(text))
        for count, row in enumerate(reader):
            if count > MAX_VERTICES:
                raise AreaError(f"{source}: more than {MAX_VERTICES} rows; save the area alone")
            if any(cell.strip() for cell in row):
                yield row
    except csv.Error as error:
        raise AreaError(f"{source}: not a table ({printable(str(error), 60)})") from None
    finally:
        csv.field_size_limit(before)


def _column(names: list[str], called: tuple[str, ...]) -> int:
    return next(names.index(one) for one in called if one in names)


def _place(row: list[str], columns: tuple[int, int], where: str) -> Point:
    try:
        # with semicolons between, a comma is a decimal point
        lat, lon = (float(row[column].strip().replace(",", ".")) for column in columns)
    except (ValueError, IndexError):
        raise AreaError(
            f"{where}: {printable(str(row), 40)} has no latitude and longitude"
        ) from None
    return number(lon, where), number(lat, where)


def _by_wkt(rows: list[list[str]], wkt: int, title: int | None, source: str) -> Iterator[Shape]:
    stem = shown_name(PurePath(source).stem, "polygon")
    for place, row in enumerate(rows[: MAX_SHAPES + 1], start=1):
        cells: Mapping[int, str] = dict(enumerate(row))
        name = row_name("" if title is None else cells.get(title), stem, place, len(rows))
        where = f"{source}: {name}"
        try:
            shape = shapely.from_wkt(cells.get(wkt, ""))
        except shapely.errors.ShapelyError:
            raise AreaError(
                f"{where}: {printable(cells.get(wkt, ''), 40)!r} is not WKT; export it anew"
            ) from None
        if shape is not None:
            yield from shapes_of(name, where, [], parts_of(shape)[0])
