"""The geofence: its limits, and routes from A to B inside it.

All points are in the grid's fixed frame (ground metres). Planning uses the fence shrunk by a
margin, so that a vehicle which strays from its leg stays inside the fence itself.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import shapely
from shapely.geometry import LineString, Point, Polygon
from shapely.ops import nearest_points

from missions.units import GridPoint

_TOLERANCE_M = 0.01
_MIN_MARGIN_M = 1e-9
"""Margin below which there is none, m: GEOS loses holes at margins below 1e-14 m."""
_REMEMBERED = 10_000
"""Number of kept answers: rules ask for a route several times in one step of a mission."""

Waypoints = tuple[GridPoint, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Fence:
    """A polygon with holes, and the same shrunk by the margin.

    >>> square = [GridPoint(0, 0), GridPoint(50, 0), GridPoint(50, 50), GridPoint(0, 50)]
    >>> fence = Fence.from_rings(square, holes=[], margin_m=2.0)
    >>> fence.allows(GridPoint(25, 25)), fence.allows(GridPoint(1, 25))
    (True, False)
    """

    outer: Polygon
    inner: Polygon | shapely.MultiPolygon
    corners: tuple[GridPoint, ...]
    _seen: dict[tuple[GridPoint, GridPoint], bool] = field(default_factory=dict)
    """Pairs of corners with a clear line between them, as far as they were asked for."""

    @classmethod
    def from_rings(
        cls,
        polygon: Sequence[GridPoint],
        holes: Sequence[Sequence[GridPoint]],
        margin_m: float,
    ) -> Fence:
        """Return a fence from its rings (not closed) and the margin that legs keep from it."""
        outer = Polygon(polygon, holes)
        width_m = margin_m if margin_m >= _MIN_MARGIN_M else 0.0
        inner = outer.buffer(-width_m, join_style="mitre")
        parts = inner.geoms if isinstance(inner, shapely.MultiPolygon) else [inner]
        corners = tuple(
            GridPoint(float(x), float(y))
            for part in parts
            for ring in (part.exterior, *part.interiors)
            for x, y in list(ring.coords)[:-1]
        )
        for part in (outer, inner):
            shapely.prepare(part)
        return cls(outer, inner, corners)

    def shrunk(self, by_m: float) -> shapely.Geometry:
        """Return the inside of the margin at this distance from its edge, prepared."""
        return _shrunk(self, by_m)

    def contains(self, point: GridPoint) -> bool:
        """Return whether a point is inside the fence itself, margin or not."""
        return bool(shapely.intersects_xy(self.outer, point.east_m, point.north_m))

    def allows(self, point: GridPoint) -> bool:
        """Return whether a leg may end here."""
        return _allows(self, point)

    def allows_leg(self, start: GridPoint, end: GridPoint) -> bool:
        """Return whether a straight leg stays inside the margin."""
        leg = LineString([start, end])
        # a leg along an edge misses it by rounding errors: all of its length is outside then, by
        # nothing
        if bool(self.inner.covers(leg)):
            return True
        forgiven = self.shrunk(-_TOLERANCE_M)
        return bool(shapely.covers(forgiven, leg)) and self.allows(start) and self.allows(end)

    def route(self, start: GridPoint, end: GridPoint) -> Waypoints | None:
        """Return the points of the shortest route to `end` inside the margin; None without one.

        A start outside the margin (blown there) goes to the nearest allowed point first.
        """
        return _route(self, start, end)

    def route_near(self, start: GridPoint, end: GridPoint) -> Waypoints | None:
        """Return the route to an `end` in the margin, straight from the nearest allowed place.

        None if that cannot be reached or `end` lies outside the fence.
        """
        if not self.contains(end):
            return None
        way = self.route(start, self.nearest(end))
        return None if way is None else (*way, end)

    def inside(self, point: GridPoint) -> GridPoint:
        """Return the point itself if a leg may end there, else the nearest place inside the
        margin."""
        return point if self.allows(point) else self.nearest(point)

    def nearest(self, point: GridPoint, inside_m: float = 0.0) -> GridPoint:
        """Return the nearest place inside the margin, `inside_m` from its edge if any is so
        deep."""
        deep = self.shrunk(inside_m) if inside_m else self.inner
        near = nearest_points(self.inner if shapely.is_empty(deep) else deep, Point(point))[0]
        return GridPoint(float(near.x), float(near.y))

    def _shortest(self, start: GridPoint, end: GridPoint) -> Waypoints | None:
        """Return the shortest route by A* over the corners with clear lines between them."""
        if self.allows_leg(start, end):
            return (end,)
        counter = itertools.count()
        # lower bound of the total, distance so far, the place, the route to it
        queue: list[tuple[float, int, float, GridPoint, Waypoints]] = [
            (start.distance_to(end), next(counter), 0.0, start, ())
        ]
        done: set[GridPoint] = set()
        while queue:
            _, _, travelled_m, at, way = heapq.heappop(queue)
            if at == end:
                return way
            if at in done:
                continue
            done.add(at)
            for corner in (end, *self.corners):
                if corner not in done and self._sees(at, corner):
                    so_far_m = travelled_m + at.distance_to(corner)
                    in_all_m = so_far_m + corner.distance_to(end)
                    heapq.heappush(
                        queue, (in_all_m, next(counter), so_far_m, corner, (*way, corner))
                    )
        return None

    def _sees(self, one: GridPoint, other: GridPoint) -> bool:
        """Return whether a leg is allowed; remembered between corners."""
        if one not in self.corners or other not in self.corners:
            return self.allows_leg(one, other)
        if (one, other) not in self._seen:
            self._seen[one, other] = self._seen[other, one] = self.allows_leg(one, other)
        return self._seen[one, other]


@lru_cache(maxsize=64)
def _shrunk(fence: Fence, by_m: float) -> shapely.Geometry:
    found = fence.inner.buffer(-by_m, join_style="mitre")
    shapely.prepare(found)
    return found


@lru_cache(_REMEMBERED)
def _allows(fence: Fence, point: GridPoint) -> bool:
    # a point that was computed to lie on the edge may miss it by a rounding error
    inside = shapely.intersects_xy(fence.inner, point.east_m, point.north_m)
    return bool(inside or fence.inner.dwithin(Point(point), _TOLERANCE_M))


@lru_cache(_REMEMBERED)
def _route(fence: Fence, start: GridPoint, end: GridPoint) -> Waypoints | None:
    if not fence.allows(end):
        return None
    entry = fence.inside(start)
    onward = fence._shortest(entry, end)
    return onward if onward is None or entry is start else (entry, *onward)


def route_length_m(start: GridPoint, route: Sequence[GridPoint]) -> float:
    """Return the length of the way from `start` through the points of a route, m."""
    return sum(a.distance_to(b) for a, b in itertools.pairwise((start, *route)))


def first_part(start: GridPoint, route: Waypoints, length_m: float) -> Waypoints:
    """Return the first `length_m` of the way from `start` through the points of a route.

    >>> first_part(GridPoint(0, 0), (GridPoint(10, 0), GridPoint(10, 10)), 15.0)
    (GridPoint(east_m=10, north_m=0), GridPoint(east_m=10.0, north_m=5.0))
    """
    part: list[GridPoint] = []
    for place in route:
        leg_m = start.distance_to(place)
        if leg_m >= length_m:
            return (*part, start.towards(place, length_m))
        part.append(place)
        start, length_m = place, length_m - leg_m
    return tuple(part)


def corners_home(fence: Fence, position: GridPoint, home: GridPoint) -> tuple[GridPoint, ...]:
    """Return the places to turn at until home lies straight ahead: an RTL knows no fence.

    Empty if nothing is in the way, or if no route is known: outside the fence already, or with a
    home that cannot be reached.

    >>> yard = [GridPoint(0, 0), GridPoint(50, 0), GridPoint(50, 50), GridPoint(0, 50)]
    >>> house = [GridPoint(20, 10), GridPoint(30, 10), GridPoint(30, 40), GridPoint(20, 40)]
    >>> fence = Fence.from_rings(yard, [house], margin_m=2.0)
    >>> corners_home(fence, GridPoint(40, 12), GridPoint(10, 10))
    (GridPoint(east_m=32.0, north_m=8.0), GridPoint(east_m=18.0, north_m=8.0))
    >>> corners_home(fence, GridPoint(40, 5), GridPoint(10, 5))
    ()
    """
    if not fence.contains(position):
        return ()
    route = fence.route(position, home) or fence.route_near(position, home) or ()
    return route[:-1]
