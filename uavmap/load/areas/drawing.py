"""The results of reading an area: shapes as the file has them, and the drawing in WGS84."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final

import pyproj
from pyproj.exceptions import CRSError, ProjError
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from missions.errors import AreaError
from missions.units import LatLon
from uavmap.base.printable import printable

MAX_BYTES: Final = 20_000_000
"""Maximum size of a file, and of the data unpacked from one, bytes."""
MAX_LAYERS: Final = 100
MAX_SHAPES: Final = 1000
MAX_VERTICES: Final = 100_000
LONGEST_NAME: Final = 60

Point = tuple[float, float]
"""x and y in the file's own coordinates: longitude and latitude where these are degrees."""
Points = tuple[Point, ...]
Rings = Sequence[Sequence[Point]]
"""The outer ring of a polygon and its holes."""


class Role(Enum):
    """The use of a shape in a mission."""

    AREA = "area"
    FENCE = "fence"
    KEEP_OUT = "keep out"
    HOME = "home"


@dataclass(frozen=True, slots=True)
class Shape:
    """A polygon with its holes, or a home, as it stands in the file."""

    name: str
    role: Role
    ring: Points
    """Corners in order; the first one is not repeated. A home has one point."""
    holes: tuple[Points, ...] = ()


@dataclass(frozen=True, slots=True)
class Layer:
    """Shapes that share coordinates."""

    shapes: tuple[Shape, ...]
    crs: pyproj.CRS | None
    """None if the file names no coordinate system."""
    notices: tuple[str, ...] = ()
    """One line for each part that was left out or assumed."""


Positions = tuple[LatLon, ...]


@dataclass(frozen=True, slots=True)
class Area:
    """A polygon in WGS84: its ring and the rings of its holes, open."""

    name: str
    ring: Positions
    holes: tuple[Positions, ...] = ()


@dataclass(frozen=True, slots=True)
class Drawing:
    """The parts of a file from which a mission can be made."""

    source: str
    areas: tuple[Area, ...]
    fences: tuple[Area, ...] = ()
    keep_out: tuple[Area, ...] = ()
    home: LatLon | None = None
    notices: tuple[str, ...] = ()


_FENCE = re.compile(r"\b(geo[ _-]?)?fence\b|\bgeozaun\b|\bzaun\b", re.IGNORECASE)
_KEEP_OUT = re.compile(r"\b(keep[ _-]?out|no[ _-]?fly|exclusion|obstacle)", re.IGNORECASE)
_HOME = re.compile(r"\b(home|start|take[ _-]?off|launch|pad)\b", re.IGNORECASE)


def role_of(name: str) -> Role:
    """Return the use of a polygon by its name; a polygon without such a name is an area.

    >>> role_of("Geofence"), role_of("no-fly zone"), role_of("defence")
    (<Role.FENCE: 'fence'>, <Role.KEEP_OUT: 'keep out'>, <Role.AREA: 'area'>)
    """
    if _KEEP_OUT.search(name):
        return Role.KEEP_OUT
    return Role.FENCE if _FENCE.search(name) else Role.AREA


def names_home(name: str) -> bool:
    """Return whether the name of a point marks it as the home.

    >>> names_home("Take-off"), names_home("parking")
    (True, False)
    """
    return bool(_HOME.search(name))


NAME_COLUMNS: Final = ("name", "title", "label", "id", "fid", "objectid")
"""Names of the column with the names of shapes, in small letters; the first one counts."""


def shown_name(value: object, otherwise: str) -> str:
    """Return a name from a file without control characters, at most `LONGEST_NAME` long.

    >>> shown_name("  North field ", "polygon 1"), shown_name(None, "polygon 1")
    ('North field', 'polygon 1')
    """
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        return otherwise
    return printable(str(value).strip(), LONGEST_NAME) or otherwise


def number(value: object, where: str) -> float:
    """Return a finite number. Raises `AreaError` for any other value, also for text and true."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        try:
            found = float(value)
        except OverflowError:  # a whole number of hundreds of digits
            found = math.inf
        if math.isfinite(found):
            return found
    raise AreaError(f"{where}: {printable(repr(value), 40)} is no coordinate; give numbers")


def open_ring(points: Iterable[Point], where: str) -> Points:
    """Return a ring without repeated points; a last point that equals the first is removed.

    Raises `AreaError` for fewer than three corners.

    >>> open_ring([(0, 0), (1, 0), (1, 0), (0, 1), (0, 0)], "x")
    ((0, 0), (1, 0), (0, 1))
    """
    kept: list[Point] = []
    for point in points:
        if not kept or point != kept[-1]:
            kept.append(point)
    if len(kept) > 1 and kept[0] == kept[-1]:
        kept.pop()
    if len(kept) < 3:
        raise AreaError(f"{where}: {len(kept)} corners; a polygon needs three")
    return tuple(kept)


def polygon(
    name: str, rings: Sequence[Iterable[Point]], where: str, role: Role | None = None
) -> Shape:
    """Create a polygon from its outer ring and its holes. Raises `AreaError`."""
    if not rings:
        raise AreaError(f"{where}: a polygon without a ring; draw it anew")
    ring, *holes = (open_ring(points, where) for points in rings)
    return Shape(name, role or role_of(name), ring, tuple(holes))


def row_name(title: object, stem: str, number: int, rows: int) -> str:
    """Return the name of a row of a table: its title, or the table's name.

    The table's name gets a number if the table has several rows.

    >>> row_name("North", "field", 2, 3), row_name(None, "field", 2, 3), row_name("", "field", 1, 1)
    ('North', 'field 2', 'field')
    """
    return shown_name(title, stem if rows == 1 else f"{stem} {number}")


def shapes_of(
    name: str,
    where: str,
    notices: list[str],
    polygons: Sequence[Rings],
    lines: Sequence[Sequence[Point]] = (),
    points: Iterable[Point] = (),
) -> Iterator[Shape]:
    """Yield the shapes that a file draws under one name, numbered if there are several.

    A line that ends where it begins is a polygon. A point is a home if its name marks it as one.
    `notices` gets a line if open lines are left out. Raises `AreaError` for a bad polygon.
    """
    closed = [[line] for line in lines if len(line) > 3 and line[0] == line[-1]]
    if len(closed) < len(lines):
        notices.append("open paths are left out; an area is a polygon")
    found = [*polygons, *closed]
    for number, rings in enumerate(found, start=1):
        yield polygon(f"{name} ({number})" if len(found) > 1 else name, rings, where)
    if names_home(name):
        yield from (Shape(name, Role.HOME, (point,)) for point in points)


def parts_of(geometry: BaseGeometry) -> tuple[list[Rings], list[Point]]:
    """Return the polygons and the points of a geometry and of all its parts."""
    if (inner := getattr(geometry, "geoms", None)) is not None:
        found = [parts_of(part) for part in inner]
        return [p for part, _ in found for p in part], [p for _, part in found for p in part]
    if geometry.is_empty:
        return [], []
    if isinstance(geometry, Polygon):
        return [[_points(ring) for ring in (geometry.exterior, *geometry.interiors)]], []
    return [], _points(geometry) if geometry.geom_type == "Point" else []


def _points(geometry: BaseGeometry) -> list[Point]:
    return [(float(x), float(y)) for x, y, *_ in geometry.coords]


def layer_of(
    shapes: Iterable[Shape], crs: pyproj.CRS | None, source: str, notices: Sequence[str] = ()
) -> Layer:
    """Create a layer of shapes, each notice once. Raises `AreaError` for too many shapes."""
    return Layer(bounded(shapes, source), crs, tuple(dict.fromkeys(notices)))


def bounded(shapes: Iterable[Shape], source: str) -> tuple[Shape, ...]:
    """Return all shapes. Raises `AreaError` for more than `MAX_SHAPES` or `MAX_VERTICES`."""
    found: list[Shape] = []
    vertices = 0
    for shape in shapes:
        found.append(shape)
        vertices += len(shape.ring) + sum(map(len, shape.holes))
        if len(found) > MAX_SHAPES:
            raise AreaError(
                f"{source}: more than {MAX_SHAPES} shapes; save the area alone in a file"
            )
        if vertices > MAX_VERTICES:
            raise AreaError(
                f"{source}: more than {MAX_VERTICES} corners; simplify the area, or save it alone"
            )
    return tuple(found)


def bounded_together(layers: Sequence[Layer], source: str) -> None:
    """Raise `AreaError` if there are too many layers, or too many shapes in all of them."""
    if len(layers) > MAX_LAYERS:
        raise AreaError(f"{source}: more than {MAX_LAYERS} layers; save the area alone in a file")
    bounded((shape for layer in layers for shape in layer.shapes), source)


# --- coordinate reference systems -----------------------------------------------------------------
WGS84: Final = pyproj.CRS.from_epsg(4326)
_LONGEST: Final = 100_000


def crs_of_epsg(code: int, where: str) -> pyproj.CRS:
    """Return the coordinate system with an EPSG number. Raises `AreaError`."""
    try:
        return pyproj.CRS.from_epsg(code)
    except CRSError:
        raise AreaError(
            f"{where}: EPSG:{code} is not known; save the area in WGS84 (EPSG:4326)"
        ) from None


def crs_of_wkt(text: str, where: str) -> pyproj.CRS:
    """Return the coordinate system of a well-known text (OGC or ESRI). Raises `AreaError`."""
    try:
        # only WKT is accepted: another kind of text could name files of grids
        return pyproj.CRS.from_wkt(text[:_LONGEST].strip().lstrip("\ufeff"))
    except CRSError:
        raise AreaError(
            f"{where}: the coordinate system {printable(text.strip(), 40)!r} is not known; save "
            "the area in WGS84 (EPSG:4326)"
        ) from None


def in_wgs84(layers: list[Layer], source: str, *, given: int | None, swap: bool) -> Drawing:
    """Return the drawing of a file in WGS84. Raises `AreaError`.

    Args:
        layers: The layers of the file, in its own coordinates.
        source: Name of the file in messages.
        given: EPSG number for a file that names no coordinate system.
        swap: Exchange latitude and longitude.
    """
    found: dict[Role, list[Area]] = {role: [] for role in Role}
    notices: list[str] = []
    for layer in layers:
        notices += layer.notices
        system = layer.crs
        if system is None and given is not None:
            system = crs_of_epsg(given, f"{source}: --crs")
        elif given is not None and system is not None:
            raise AreaError(
                f"{source}: --crs {given}: the file names its system itself, {_title(system)}; "
                "leave --crs out"
            )
        if system is None:
            _must_be_degrees(layer, source)
            notices.append("the file names no coordinate system; WGS84 is assumed")
        elif not system.equals(WGS84, ignore_axis_order=True):
            notices.append(f"coordinates are converted from {_title(system)} to WGS84")
        for shape in layer.shapes:
            ring, *holes = (
                _places(shape, ring, system or WGS84, source, swap)
                for ring in (shape.ring, *shape.holes)
            )
            found[shape.role].append(Area(shape.name, ring, tuple(holes)))
    homes = found[Role.HOME]
    if len(homes) > 1:
        notices.append(f"{len(homes)} homes; the first one is used: {homes[0].name}")
    return Drawing(
        source,
        tuple(found[Role.AREA]),
        tuple(found[Role.FENCE]),
        tuple(found[Role.KEEP_OUT]),
        homes[0].ring[0] if homes else None,
        tuple(dict.fromkeys(notices)),
    )


def _title(system: pyproj.CRS) -> str:
    code = system.to_epsg()
    return f"EPSG:{code}" if code is not None else printable(system.name, 40)


def _must_be_degrees(layer: Layer, source: str) -> None:
    for shape in layer.shapes:
        for x, y in shape.ring:
            if not (abs(x) <= 180.0 and abs(y) <= 180.0):
                raise AreaError(
                    f"{source}: {shape.name}: {x:g}, {y:g} are not degrees, and the file names no "
                    "coordinate system (a Shapefile names it in its .prj); give --crs EPSG, or "
                    "save the area in WGS84"
                )


def _places(shape: Shape, ring: Points, system: pyproj.CRS, source: str, swap: bool) -> Positions:
    where = f"{source}: {shape.name}"
    if not all(math.isfinite(x) and math.isfinite(y) for x, y in ring):
        raise AreaError(f"{where}: a coordinate is not a finite number; draw it anew")
    if swap:
        ring = tuple((y, x) for x, y in ring)
    if not system.equals(WGS84, ignore_axis_order=True):
        ring = _transformed(ring, system, where)
    for lon_deg, lat_deg in ring:
        if abs(lat_deg) > 90.0 or abs(lon_deg) > 180.0:
            raise AreaError(_out_of_range(where, lat_deg, lon_deg, swap))
    return tuple(LatLon(lat_deg, lon_deg) for lon_deg, lat_deg in ring)


def _transformed(ring: Points, system: pyproj.CRS, where: str) -> Points:
    try:
        turn = pyproj.Transformer.from_crs(system, WGS84, always_xy=True)
        lons, lats = turn.transform([x for x, _ in ring], [y for _, y in ring])
    except (ProjError, CRSError):
        raise AreaError(
            f"{where}: {_title(system)} cannot be converted to WGS84; save the area in WGS84"
        ) from None
    if not all(map(math.isfinite, (*lons, *lats))):
        raise AreaError(
            f"{where}: {ring[0][0]:g}, {ring[0][1]:g} lie outside of {_title(system)}; check that "
            "this is the system of the file"
        )
    return tuple(zip(map(float, lons), map(float, lats), strict=True))


def _out_of_range(where: str, lat_deg: float, lon_deg: float, swapped: bool) -> str:
    place = f"{where}: latitude {lat_deg:g}, longitude {lon_deg:g}: "
    if abs(lon_deg) <= 90.0 and abs(lat_deg) <= 180.0:
        turn = "leave out --swap" if swapped else "give --swap"
        return f"{place}they are swapped; {turn}, or write longitude first"
    if abs(lat_deg) > 180.0 or abs(lon_deg) > 360.0:
        return f"{place}these are metres, not degrees; save the area in WGS84 (EPSG:4326)"
    return f"{place}not a place on Earth; draw it anew"
