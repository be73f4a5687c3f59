"""The places of a mission over an area, in ground metres: box, fence, holes, home."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import shapely
from shapely.geometry import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.ops import nearest_points, unary_union

from missions.errors import AreaError, GeodesyError
from missions.geo.grid import Grid
from missions.mission.places import SMALLEST_GAP_M, invalidity
from missions.units import GridPoint, LatLon
from uavmap.load.areas.drawing import Area, Drawing, Positions

WIDEST_M: Final = 10_000.0
"""Maximum side of an area, m."""
MAX_CORNERS: Final = 300
"""Maximum number of corners of the box; a coast line traced in detail is simplified."""
PATH_ROOM_M: Final = 10.0
"""Distance of pads, and of the path from them to the area, from a fence that was not drawn, m."""
_NICE_M: Final = (4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0)
_MAX_CELLS: Final = 10_000
_SHARE_OF_ROI: Final = 0.12
_OFF_THE_EDGE_M: Final = 0.5
"""Gap between a hole and the fence, m: less than the margin, so no vehicle flies in it."""


@dataclass(frozen=True, slots=True)
class Layout:
    """The places of a mission; rings are in WGS84, without a repeated first corner."""

    name: str
    box: tuple[LatLon, ...]
    fence: tuple[LatLon, ...]
    holes: tuple[tuple[LatLon, ...], ...]
    home: LatLon
    roi: tuple[LatLon, ...]
    """An invented region for the simulator."""
    cell_m: float
    notices: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class LayoutOptions:
    """The user's choices besides the drawing; None: the default."""

    home: LatLon | None = None
    area: str | None = None
    together: bool = False
    room_m: float = 20.0
    """Distance from the box to the fence, m."""
    cell_m: float | None = None
    largest_cell_m: float = math.inf
    """Maximum size of a cell by default, m: a picture would show too few larger ones."""
    vehicles: int = 1


def rectangle(middle: LatLon, wide_m: float, high_m: float) -> Positions:
    """Return the corners of a rectangle, east by north. Raises `AreaError` for a wrong size."""
    if not (4.0 <= wide_m <= 10_000.0 and 4.0 <= high_m <= 10_000.0):
        raise AreaError(f"--size {wide_m:g}x{high_m:g}: give each side from 4 to 10000 metres")
    grid = Grid.at(middle, 1.0)
    return tuple(
        grid.position(GridPoint(e * wide_m / 2.0, n * high_m / 2.0))
        for e, n in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    )


def lay_out(drawing: Drawing, options: LayoutOptions) -> Layout:
    """Plan the places of a mission over a drawing. Raises `AreaError` with the remedy."""
    chosen = _chosen(drawing, options)
    grid = _grid(drawing, chosen)
    notices = list(drawing.notices)
    areas = [_on_ground(area, grid, drawing.source) for area in chosen]
    whole = areas[0] if len(areas) == 1 else _hull(areas)
    _check_size(whole, drawing.source)
    cell_m = options.cell_m or cell_for(whole.area, options.largest_cell_m)
    box = _simplified(Polygon(whole.exterior), cell_m, notices)
    fence = _drawn_fence(drawing, box, grid)
    keep_out = _keep_out(drawing, areas, grid, notices)
    if fence is not None:
        box = _inside(box, fence, drawing.source, notices)
    home = home_of(drawing, options.home, options.vehicles, box, fence, keep_out, grid, notices)
    pads = [GridPoint(home[0] + k * SMALLEST_GAP_M, home[1]) for k in range(options.vehicles)]
    if fence is None:
        fence = _fence_around(box, pads, options.room_m)
    holes = _cut_to(keep_out, fence)
    free = box.difference(unary_union(holes)) if holes else box
    if free.is_empty:
        raise AreaError(f"{drawing.source}: keep-out polygons cover all of it; draw them smaller")
    title = chosen[0].name if len(chosen) == 1 else f"{len(chosen)} areas"
    return Layout(
        title,
        _ring(box, grid),
        _ring(fence, grid),
        tuple(_ring(hole, grid) for hole in holes),
        grid.position(home),
        _ring(invented_region(free, cell_m), grid),
        cell_m,
        tuple(notices),
    )


def cell_for(area_m2: float, largest_m: float = math.inf) -> float:
    """Return a cell size with which an area has at most about 10,000 cells, m.

    It is at most `largest_m`, and at least 4 m, the default of a mission.

    >>> cell_for(20_000.0), cell_for(1_000_000.0), cell_for(1_000_000.0, largest_m=9.0)
    (4.0, 10.0, 8.0)
    """
    least_m = math.sqrt(area_m2 / _MAX_CELLS)
    possible = [size for size in _NICE_M if size <= largest_m] or [_NICE_M[0]]
    return next((size for size in possible if size >= least_m), possible[-1])


# --- the area ---------------------------------------------------------------------------------
def _chosen(drawing: Drawing, options: LayoutOptions) -> tuple[Area, ...]:
    areas = drawing.areas
    names = ", ".join(dict.fromkeys(repr(area.name) for area in areas[:10]))
    names += ", ..." if len(areas) > 10 else ""
    if options.area is not None:
        found = [area for area in areas if area.name.casefold() == options.area.casefold()]
        if len(found) == 1:
            return tuple(found)
        what = "several areas of this name; rename one" if found else f"there are {names}"
        raise AreaError(f"{drawing.source}: --area {options.area!r}: {what}")
    if len(areas) > 1 and not options.together:
        raise AreaError(
            f"{drawing.source}: {len(areas)} areas: {names}; choose one with --area NAME, or give "
            "--together for an area around all of them"
        )
    return areas


def _grid(drawing: Drawing, areas: Iterable[Area]) -> Grid:
    places = [place for area in areas for place in area.ring]
    first = places[0].lon_deg
    # relative to the first one: else an area over the antimeridian would span the globe
    east = [math.remainder(place.lon_deg - first, 360.0) for place in places]
    lats = [place.lat_deg for place in places]
    middle = math.remainder(first + (min(east) + max(east)) / 2.0, 360.0)
    wide_deg = max(max(east) - min(east), max(lats) - min(lats))
    if wide_deg > 2.0:
        raise AreaError(
            f"{drawing.source}: {wide_deg:.0f} degrees wide: too large for multicopters; "
            "draw a smaller area, or choose one with --area"
        )
    try:
        return Grid.at(LatLon((min(lats) + max(lats)) / 2.0, middle), 1.0)
    except GeodesyError as error:
        raise AreaError(f"{drawing.source}: {error}; are latitude and longitude swapped?") from None


def _on_ground(area: Area, grid: Grid, source: str) -> Polygon:
    polygon = Polygon(
        [grid.fixed(place) for place in area.ring],
        [[grid.fixed(place) for place in hole] for hole in area.holes],
    )
    if not polygon.is_valid:
        reason, at = invalidity(polygon, grid)
        near = "" if at is None else f" near {at.lat_deg:.6f}, {at.lon_deg:.6f}"
        raise AreaError(
            f"{source}: {area.name}: crosses or touches itself{near} ({reason.lower()}); draw its "
            "corners in order, once around"
        )
    return polygon


def _hull(areas: Iterable[Polygon]) -> Polygon:
    hull = shapely.convex_hull(unary_union(list(areas)))
    return hull if isinstance(hull, Polygon) else Polygon()


def _check_size(area: BaseGeometry, source: str) -> None:
    west, south, east, north = area.bounds
    wide_m, high_m = east - west, north - south
    if max(wide_m, high_m) > WIDEST_M:
        raise AreaError(
            f"{source}: {wide_m / 1000:.1f} km x {high_m / 1000:.1f} km; a mission has at most "
            f"{WIDEST_M / 1000:g} km; draw a smaller area"
        )
    if area.area < 16.0:
        raise AreaError(
            f"{source}: {wide_m:.1f} m x {high_m:.1f} m, {area.area:.1f} m2: smaller than a cell; "
            "draw a larger area"
        )


def _simplified(box: Polygon, cell_m: float, notices: list[str]) -> Polygon:
    """Return the box with at most `MAX_CORNERS` corners; it never loses half a cell."""
    found, tolerance_m = box, cell_m / 16.0
    while len(found.exterior.coords) - 1 > MAX_CORNERS and tolerance_m <= cell_m / 2.0:
        found = _polygon_of(box.simplify(tolerance_m), box)
        tolerance_m *= 2.0
    if len(found.exterior.coords) - 1 > MAX_CORNERS:
        found = _hull([box])
    corners, kept = len(box.exterior.coords) - 1, len(found.exterior.coords) - 1
    if kept < corners:
        notices.append(f"of the {corners} corners of the area {kept} are kept")
    return found


def _polygon_of(shape: BaseGeometry, otherwise: Polygon) -> Polygon:
    return shape if isinstance(shape, Polygon) else otherwise


def _polygons(shape: BaseGeometry) -> list[Polygon]:
    return [part for part in shapely.get_parts(shape) if isinstance(part, Polygon)]


# --- fence and what to keep out of ------------------------------------------------------------
def _drawn_fence(drawing: Drawing, box: Polygon, grid: Grid) -> Polygon | None:
    if not drawing.fences:
        return None
    fences = [_on_ground(fence, grid, drawing.source) for fence in drawing.fences]
    best = max(fences, key=lambda fence: float(fence.intersection(box).area))
    if best.intersection(box).area < 0.5 * box.area:
        away_m = best.distance(box)
        raise AreaError(
            f"{drawing.source}: the fence is {away_m / 1000:.1f} km from the area, or holds less "
            "than half of it; draw it around the area, or leave it out"
        )
    return Polygon(best.exterior)


def _inside(box: Polygon, fence: Polygon, source: str, notices: list[str]) -> Polygon:
    inner = fence.buffer(-MARGIN_M - 0.1, join_style="mitre")
    if inner.contains(box):
        return box
    parts = _polygons(box.intersection(inner))
    if not parts:
        raise AreaError(f"{source}: the fence leaves nothing of the area; draw it wider")
    largest = Polygon(max(parts, key=lambda part: float(part.area)).exterior)
    notices.append(f"the fence cuts {box.area - largest.area:.0f} m2 off the area")
    return largest


def _keep_out(
    drawing: Drawing, areas: Iterable[Polygon], grid: Grid, notices: list[str]
) -> list[Polygon]:
    """Return the polygons that no vehicle flies over: holes of areas and fences, and keep-outs."""
    drawn = [_on_ground(area, grid, drawing.source) for area in drawing.keep_out]
    inner = [Polygon(ring) for area in areas for ring in area.interiors]
    for fence in drawing.fences:
        inner += [Polygon(r) for r in _on_ground(fence, grid, drawing.source).interiors]
    if inner:
        notices.append(f"no vehicle flies over {len(inner)} holes of polygons (fence.holes)")
    return [Polygon(part.exterior) for part in _polygons(unary_union([*drawn, *inner]))]


def _cut_to(keep_out: Iterable[Polygon], fence: Polygon) -> list[Polygon]:
    inside = fence.buffer(-_OFF_THE_EDGE_M, join_style="mitre")
    return [
        Polygon(part.exterior)
        for hole in keep_out
        for part in _polygons(hole.intersection(inside))
        if part.area > _OFF_THE_EDGE_M
    ]


def _fence_around(box: Polygon, pads: Sequence[GridPoint], room_m: float) -> Polygon:
    parts: list[BaseGeometry] = [box.buffer(room_m, join_style="mitre", mitre_limit=2.0)]
    for pad in pads:
        near, _ = nearest_points(box, Point(pad))
        path = LineString([(pad.east_m, pad.north_m), (near.x, near.y)])
        parts.append(path.buffer(PATH_ROOM_M, quad_segs=2))
    around = _polygon_of(unary_union(parts), box)
    return _polygon_of(Polygon(around.exterior).simplify(0.5), around)


# --- the simulator ----------------------------------------------------------------------------
def invented_region(free: BaseGeometry, cell_m: float) -> Polygon:
    """Return a compact region for the simulator, in the middle of the ground to be searched."""
    part = max(shapely.get_parts(free), key=lambda one: float(one.area))
    middle = part.representative_point()
    radius_m = max(math.sqrt(_SHARE_OF_ROI * part.area / math.pi), 1.5 * cell_m)
    # an irregular shape, not a circle: the outline of a region is unknown
    corners = [
        (
            middle.x + radius_m * (1.0 + 0.2 * math.cos(3.0 * a)) * math.cos(a),
            middle.y + radius_m * (1.0 + 0.2 * math.cos(3.0 * a)) * math.sin(a),
        )
        for a in (2.0 * math.pi * k / 18 for k in range(18))
    ]
    cut = [p for p in shapely.get_parts(Polygon(corners).intersection(part)) if p.area > 0.0]
    largest = max(cut, key=lambda one: float(one.area), default=part)
    return Polygon(largest.exterior)


def _ring(polygon: Polygon, grid: Grid) -> tuple[LatLon, ...]:
    points = list(polygon.exterior.coords)[:-1]
    return tuple(grid.position(GridPoint(x, y)) for x, y, *_ in points)


# --- where the first vehicle stands ---------------------------------------------------------------
FARTHEST_HOME_M: Final = 1000.0
"""Maximum distance of a home from the area, m."""
BESIDE_M: Final = 8.0
"""Distance from the area of a home that was not drawn, m."""
MARGIN_M: Final = 2.0
"""The default of `fence.margin_m`, m."""
PAD_ROOM_M: Final = 3.0
"""Minimum distance of a pad from the margin of a drawn fence, m."""


def home_of(
    drawing: Drawing,
    given: LatLon | None,
    vehicles: int,
    box: Polygon,
    fence: Polygon | None,
    keep_out: list[Polygon],
    grid: Grid,
    notices: list[str],
) -> GridPoint:
    """Return the home of the first vehicle: as given, as drawn, or beside the area.

    Raises `AreaError` for a home far away or outside of the fence, and if there is no room for one.
    """
    place = given or drawing.home
    if place is not None:
        key = f"{drawing.source}: its home" if given is None else "--home"
        return _near(key, place, grid, box, fence, drawing.source)
    for point in _places_beside(box):
        end_m = point.x + SMALLEST_GAP_M * vehicles
        row = LineString([(point.x, point.y), (end_m, point.y)])
        room = MARGIN_M + PAD_ROOM_M
        if any(hole.distance(row) < room for hole in keep_out):
            continue
        if fence is None or fence.buffer(-room).contains(row):
            where = "beside" if point.distance(box) else "in"
            place = grid.position(GridPoint(point.x, point.y))
            notices.append(
                f"no home was drawn; it is {where} the area, at {place.lat_deg:.6f},"
                f"{place.lon_deg:.6f}; --home LAT,LON sets another"
            )
            return GridPoint(point.x, point.y)
    raise AreaError(
        f"{drawing.source}: no room for a home between the fence and the keep-out polygons; "
        "give --home LAT,LON"
    )


def _near(
    key: str, place: LatLon, grid: Grid, box: Polygon, fence: Polygon | None, source: str
) -> GridPoint:
    """Return a given home in ground metres.

    Raises `AreaError` for a home outside of the fence or far from the area.
    """
    home = f"{key} {place.lat_deg:g},{place.lon_deg:g}"
    away_m = _away_m(place, grid, box)
    if away_m <= FARTHEST_HOME_M:
        point = grid.fixed(place)
        if fence is not None and not fence.contains(Point(point)):
            raise AreaError(
                f"{home}: lies outside of the fence of {source}; give --home LAT,LON inside, or "
                "draw the fence around it"
            )
        return point
    hint = "give --home LAT,LON near the area"
    if abs(place.lon_deg) <= 90.0:
        swapped = LatLon(place.lon_deg, place.lat_deg)
        if _away_m(swapped, grid, box) <= FARTHEST_HOME_M:
            hint = "latitude and longitude are swapped"
    raise AreaError(f"{home}: {away_m / 1000:.1f} km from the area; {hint}")


def _away_m(place: LatLon, grid: Grid, box: Polygon) -> float:
    middle = grid.position(GridPoint(0.0, 0.0))
    apart = max(
        abs(place.lat_deg - middle.lat_deg),
        abs(math.remainder(place.lon_deg - middle.lon_deg, 360.0)),
    )
    if apart > 2.0 or not -80.0 <= place.lat_deg <= 84.0:  # far from where the projection is true
        return apart * 111_000.0
    return float(box.distance(Point(grid.fixed(place))))


def _places_beside(box: Polygon) -> Iterator[Point]:
    """Yield places for a home: around the box from the south on, then in it, near its rim."""
    for distance_m in (BESIDE_M, -BESIDE_M):
        rim = box.buffer(distance_m, join_style="mitre", mitre_limit=2.0)
        for ring in (part.exterior for part in _polygons(rim)):
            if ring.is_empty:
                continue
            step_m = max(ring.length / 200.0, 2.0)
            points = [ring.interpolate(k * step_m) for k in range(int(ring.length / step_m) + 1)]
            middle = box.centroid
            # south of the middle: easy to find on the map
            yield from sorted(points, key=lambda p: p.y + 0.3 * abs(p.x - middle.x))
    yield box.representative_point()
