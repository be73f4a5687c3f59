"""Where the first vehicle stands, over an area that may say nothing of it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import shapely
from shapely.geometry import LineString, Point, Polygon

from missions.errors import AreaError
from missions.geo.grid import Grid
from missions.mission.places import SMALLEST_GAP_M
from missions.units import GridPoint, LatLon
from uavmap.load.areas.drawing import Drawing

FARTHEST_HOME_M: Final = 1000.0
"""A home farther from the area is taken for a mistake."""
BESIDE_M: Final = 8.0
"""So far beside the area a home is put that nobody has drawn."""
MARGIN_M: Final = 2.0
"""As `fence.margin_m` is by default."""
PAD_ROOM_M: Final = 3.0
"""From a pad to the margin of a fence that was drawn, at the least."""


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
    """Return where the first vehicle stands: as given, as drawn, or beside the area.

    Raises `AreaError` for a home far away or outside of the fence, or without room for one.
    """
    place = given or drawing.home
    if place is not None:
        return _near(place, grid, box, fence, drawing.source, by_option=given is not None)
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
                f"no home was drawn; it is taken {where} the area, at {place.lat_deg:.6f},"
                f"{place.lon_deg:.6f}; --home LAT,LON for another"
            )
            return GridPoint(point.x, point.y)
    raise AreaError(
        f"{drawing.source}: no room for a home between the fence and what is to be kept out of; "
        "give --home LAT,LON"
    )


def _near(
    place: LatLon,
    grid: Grid,
    box: Polygon,
    fence: Polygon | None,
    source: str,
    *,
    by_option: bool,
) -> GridPoint:
    """A given home in ground metres, unless it lies where nobody would start from."""
    key = "--home" if by_option else f"{source}: its home"
    said = f"{key} {place.lat_deg:g},{place.lon_deg:g}"
    away_m = _away_m(place, grid, box)
    if away_m <= FARTHEST_HOME_M:
        point = grid.fixed(place)
        if fence is not None and not fence.contains(Point(point)):
            raise AreaError(
                f"{said}: lies outside of the fence of {source}; give --home LAT,LON inside, or "
                "draw the fence around it"
            )
        return point
    hint = "give --home LAT,LON near the area"
    if abs(place.lon_deg) <= 90.0:
        turned = LatLon(place.lon_deg, place.lat_deg)
        if _away_m(turned, grid, box) <= FARTHEST_HOME_M:
            hint = "latitude and longitude are swapped"
    raise AreaError(f"{said}: {away_m / 1000:.1f} km from the area; {hint}")


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
    """Places for a home: around the box from the south on, then in it, near its rim."""
    for distance_m in (BESIDE_M, -BESIDE_M):
        rim = box.buffer(distance_m, join_style="mitre", mitre_limit=2.0)
        rings = [p.exterior for p in shapely.get_parts(rim) if isinstance(p, Polygon)]
        for ring in rings:
            if ring.is_empty:
                continue
            step_m = max(ring.length / 200.0, 2.0)
            points = [ring.interpolate(k * step_m) for k in range(int(ring.length / step_m) + 1)]
            middle = box.centroid
            # in the south, near the middle: a place that people find on the map
            yield from sorted(points, key=lambda p: p.y + 0.3 * abs(p.x - middle.x))
    yield box.representative_point()
