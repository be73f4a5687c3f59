"""Files of ground stations: QGroundControl's plans, Mission Planner's waypoints and polygons."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Final

import pyproj
import shapely
from pymavlink.dialects.v20 import common as mav
from shapely.geometry import LineString, MultiPoint, Polygon

from missions.errors import AreaError, GeodesyError
from missions.geo.grid import Grid
from missions.units import GridPoint, LatLon
from uavmap.base.printable import printable
from uavmap.load.areas.drawing import (
    MAX_VERTICES,
    WGS84,
    Layer,
    Point,
    Role,
    Shape,
    layer_of,
    number,
    polygon,
)

_GEOD: Final = pyproj.Geod(ellps="WGS84")
_CORNERS: Final = 32
"""Number of corners of a circle."""
_LARGEST_RADIUS_M: Final = 50_000.0
_MAX_BENDS: Final = 300
"""Maximum points of a corridor: each piece of its ground may cross every other."""
_NEAR_HOME_M: Final = 5.0
_FLOWN: Final = (
    mav.MAV_CMD_NAV_WAYPOINT, mav.MAV_CMD_NAV_LOITER_TURNS, mav.MAV_CMD_NAV_LOITER_TIME,
    mav.MAV_CMD_NAV_SPLINE_WAYPOINT,
)  # fmt: skip
_POLYGONS: Final = {
    mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION: Role.FENCE,
    mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION: Role.KEEP_OUT,
}
_CIRCLES: Final = {
    mav.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION: Role.FENCE,
    mav.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION: Role.KEEP_OUT,
}


# --- QGroundControl ---------------------------------------------------------------------------
def read_plan(text: str, source: str) -> Layer:
    """Read surveys, fence, home and rally points of a plan. Raises `AreaError`.

    Without a survey the area is the hull of the waypoints; without those, the inside of the fence.
    """
    try:
        root = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise AreaError(f"{source}: not JSON ({printable(str(error), 80)})") from None
    kind = root.get("fileType") if isinstance(root, dict) else None
    if isinstance(kind, str) and kind != "Plan":
        raise AreaError(
            f"{source}: {printable(kind, 20)!r} of an old QGroundControl; open it there, and save "
            "it as a plan"
        )
    if kind != "Plan":
        raise AreaError(f'{source}: not a plan of QGroundControl: "fileType": "Plan" is missing')
    mission, fence = _table(root, "mission", source), _table(root, "geoFence", source)
    home = _home(root, mission, source)
    items = [item for item in _listed(mission, "items", source) if isinstance(item, Mapping)]
    structures = sum(item.get("complexItemType") == "StructureScan" for item in items)
    shapes = [*_surveys(items, source), *_fences(fence, source)]
    if home is not None:
        shapes.append(Shape("home", Role.HOME, (home,)))
    flown = [
        (number(item["params"][5], source), number(item["params"][4], source))
        for item in items
        if item.get("command") in _FLOWN
        and isinstance(item.get("params"), list)
        and len(item["params"]) >= 6
    ]
    layer = with_area(shapes, flown, home, source)
    if not structures:
        return layer
    notice = "a structure scan is left out: it outlines a building, not an area to fly over"
    if all(shape.role is Role.HOME for shape in layer.shapes):
        raise AreaError(f"{source}: {notice}; draw a survey around it")
    return replace(layer, notices=(*layer.notices, notice))


def _home(root: Mapping[str, Any], mission: Mapping[str, Any], source: str) -> Point | None:
    planned = mission.get("plannedHomePosition")
    if isinstance(planned, list) and len(planned) >= 2 and planned[0] is not None:
        point = _lat_lon(planned, f"{source}: plannedHomePosition")
        if point != (0.0, 0.0):
            return point
    points = _listed(_table(root, "rallyPoints", source), "points", source)
    return _lat_lon(points[0], f"{source}: rallyPoints") if points else None


def _surveys(items: list[Mapping[str, Any]], source: str) -> Iterator[Shape]:
    count = 0
    for item in items:
        if item.get("complexItemType") == "survey":
            count += 1
            name = f"survey {count}"
            where = f"{source}: {name}"
            corners = [_lat_lon(p, where) for p in _listed(item, "polygon", where)]
            yield polygon(name, [corners], where, Role.AREA)
        elif item.get("complexItemType") == "CorridorScan":
            count += 1
            yield _corridor(item, f"corridor {count}", source)


def _corridor(item: Mapping[str, Any], name: str, source: str) -> Shape:
    """Return the ground of a corridor scan: a line with half the width on either side."""
    where = f"{source}: {name}"
    line = [_lat_lon(p, where) for p in _listed(item, "polyline", where)]
    width_m = number(item.get("CorridorWidth"), where)
    if len(line) > _MAX_BENDS:
        raise AreaError(f"{where}: {len(line)} points; simplify it to at most {_MAX_BENDS}")
    if len(line) < 2 or not 0.0 < width_m <= _LARGEST_RADIUS_M:
        raise AreaError(
            f"{where}: {len(line)} points, {width_m:g} m wide; it needs two points and a width"
        )
    if not all(abs(lon) <= 180.0 and abs(lat) <= 90.0 for lon, lat in line):
        raise AreaError(f"{where}: a point is not latitude and longitude")
    try:
        grid = Grid.at(LatLon(line[0][1], line[0][0]), 1.0)
        path = LineString([grid.fixed(LatLon(lat, lon)) for lon, lat in line])
    except GeodesyError as error:
        raise AreaError(f"{where}: {error}") from None
    ground = path.buffer(width_m / 2.0, cap_style="flat", join_style="mitre")
    if not isinstance(ground, Polygon) or ground.is_empty:
        raise AreaError(f"{where}: its line has no length; draw it anew")
    rings = [
        [(place.lon_deg, place.lat_deg) for place in map(grid.position, _grid_points(ring))]
        for ring in (ground.exterior, *ground.interiors)
    ]
    return polygon(name, rings, where, Role.AREA)


def _grid_points(ring: Any) -> list[GridPoint]:
    return [GridPoint(float(x), float(y)) for x, y, *_ in ring.coords]


def _fences(fence: Mapping[str, Any], source: str) -> Iterator[Shape]:
    where = f"{source}: geoFence"
    for one in _listed(fence, "polygons", where):
        inside = isinstance(one, Mapping) and one.get("inclusion", True)
        role, name = (Role.FENCE, "fence") if inside else (Role.KEEP_OUT, "exclusion")
        corners = [_lat_lon(p, where) for p in _listed(one, "polygon", where)]
        yield polygon(name, [corners], where, role)
    for one in _listed(fence, "circles", where):
        circle = one.get("circle") if isinstance(one, Mapping) else None
        if not isinstance(circle, Mapping):
            raise AreaError(f"{where}: {printable(repr(one), 40)} is not a circle")
        centre = _lat_lon(circle.get("center"), where)
        role = Role.FENCE if one.get("inclusion", True) else Role.KEEP_OUT
        yield _circle(centre, number(circle.get("radius"), where), role, where)
    if isinstance(fence.get("polygon"), list) and fence["polygon"]:  # version 1
        corners = [_lat_lon(p, where) for p in fence["polygon"]]
        yield polygon("fence", [corners], where, Role.FENCE)


def _table(root: Mapping[str, Any], key: str, source: str) -> Mapping[str, Any]:
    value = root.get(key) or {}
    if not isinstance(value, Mapping):
        raise AreaError(f"{source}: {key} is not a table; save the plan anew")
    return value


def _listed(table: object, key: str, where: str) -> list[Any]:
    value = (table.get(key) or []) if isinstance(table, Mapping) else None
    if not isinstance(value, list):
        raise AreaError(f"{where}: {key} is not a list; save the plan anew")
    return value


def _lat_lon(value: object, where: str) -> Point:
    if not isinstance(value, list) or len(value) < 2:
        raise AreaError(f"{where}: {printable(repr(value), 40)} is not [latitude, longitude]")
    return number(value[1], where), number(value[0], where)


# --- Mission Planner --------------------------------------------------------------------------
def read_waypoints(text: str, source: str) -> Layer:
    """Read waypoints, fence and rally points of a QGC WPL 110 file. Raises `AreaError`."""
    shapes: list[Shape] = []
    flown: list[Point] = []
    corners: list[Point] = []
    home: Point | None = None
    for i, line in enumerate(text.splitlines()[1:]):
        if not line.strip():
            continue
        where = f"{source}: line {i + 2}"
        command, first, point = _row(line, where)
        if i == 0 and command == mav.MAV_CMD_NAV_WAYPOINT:
            home = point if point != (0.0, 0.0) else None
        elif command in _POLYGONS:
            corners.append(point)
            if len(corners) >= max(int(first), 3):
                role = _POLYGONS[command]
                shapes.append(polygon(role.value, [corners], where, role))
                corners = []
        elif command in _CIRCLES:
            shapes.append(_circle(point, first, _CIRCLES[command], where))
        elif command == mav.MAV_CMD_NAV_RALLY_POINT:
            home = home or point
        elif command in _FLOWN and point != (0.0, 0.0):
            flown.append(point)
    if corners:
        raise AreaError(f"{source}: the last polygon of its fence lacks corners; save it anew")
    if home is not None:
        shapes.append(Shape("home", Role.HOME, (home,)))
    return with_area(shapes, flown, home, source)


def _row(line: str, where: str) -> tuple[int, float, Point]:
    words = line.split()
    try:
        command = int(float(words[3]))
        first, lat_deg, lon_deg = (float(words[k]) for k in (4, 8, 9))
    except (ValueError, IndexError, OverflowError):
        raise AreaError(
            f"{where}: {printable(line, 40)!r} is not a row of QGC WPL 110 (12 columns)"
        ) from None
    return command, number(first, where), (number(lon_deg, where), number(lat_deg, where))


def is_pairs(text: str) -> bool:
    """Return whether the first line that is not a comment has two numbers.

    >>> is_pairs("# a fence\\n52.4 13.3"), is_pairs("52.4, 13.3, 5"), is_pairs("x y")
    (True, False, False)
    """
    lines = (line.replace(",", " ").split() for line in text.splitlines())
    first = next((words for words in lines if words and not words[0].startswith("#")), [])
    try:
        return len([float(word) for word in first]) == 2
    except ValueError:
        return False


def read_polygon(text: str, source: str, *, fence: bool | None) -> Layer:
    """Read a polygon of Mission Planner or MAVProxy: latitude and longitude a line (.poly, .fen).

    A fence begins with its return point, which becomes the home. If `fence` is None, the file is a
    fence when its second point is also its last. Raises `AreaError`.
    """
    points: list[Point] = []
    for i, line in enumerate(text.splitlines()):
        words = line.replace(",", " ").split()
        if not words or words[0].startswith("#"):
            continue
        try:
            lat_deg, lon_deg = float(words[0]), float(words[1])
        except (ValueError, IndexError):
            raise AreaError(
                f"{source}: line {i + 1}: {printable(line, 40)!r} is not latitude and longitude"
            ) from None
        points.append((number(lon_deg, source), number(lat_deg, source)))
        if len(points) > MAX_VERTICES:
            raise AreaError(f"{source}: more than {MAX_VERTICES} corners; simplify the area")
    if fence is None:
        fence = len(points) > 4 and points[1] == points[-1]
    if not fence:
        return layer_of([polygon("polygon", [points], source, Role.AREA)], WGS84, source)
    border = polygon("fence", [points[1:]], source, Role.FENCE)
    home = Shape("return point", Role.HOME, tuple(points[:1]))
    return layer_of([border, home], WGS84, source)


# --- all of them --------------------------------------------------------------------------------
def with_area(shapes: list[Shape], flown: list[Point], home: Point | None, source: str) -> Layer:
    """Create the layer of a mission; without an area in it, the hull of the waypoints is one."""
    notices: list[str] = []
    if not any(shape.role is Role.AREA for shape in shapes):
        away = [
            point for point in flown if home is None or _GEOD.inv(*home, *point)[2] > _NEAR_HOME_M
        ]
        hull = shapely.convex_hull(MultiPoint(away)) if len(away) > 2 else None
        if isinstance(hull, Polygon):
            corners = [(float(x), float(y)) for x, y, *_ in hull.exterior.coords]
            shapes.append(polygon("waypoints", [corners], source, Role.AREA))
            notices.append(f"no survey; the area is the hull of its {len(away)} waypoints")
    return layer_of(shapes, WGS84, source, notices)


def _circle(centre: Point, radius_m: float, role: Role, where: str) -> Shape:
    if not 0.0 < radius_m <= _LARGEST_RADIUS_M:
        raise AreaError(
            f"{where}: a circle of {radius_m:g} m; the radius must be above 0 and at most "
            f"{_LARGEST_RADIUS_M:g} m"
        )
    if max(abs(centre[0]) - 180.0, abs(centre[1]) - 90.0) > 0.0:
        raise AreaError(f"{where}: {centre[1]:g}, {centre[0]:g} is not latitude and longitude")
    points = [_GEOD.fwd(*centre, -360.0 * k / _CORNERS, radius_m)[:2] for k in range(_CORNERS)]
    return Shape(f"circle ({role.value})", role, tuple((float(x), float(y)) for x, y in points))
