"""The ground that is explored: a polygon with holes, and the lines of sight in it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import LineString, Polygon
from shapely.geometry.polygon import orient
from shapely.validation import explain_validity

from missions.errors import AreaError

Point = tuple[float, float]
"""East and north, in metres."""

GRID_M: Final = 1e-4
"""Corners are rounded to this: two of them are either one, or well apart."""
TOUCH_M: Final = 1e-6
"""Tolerance of a line of sight along a wall, m: rounding may put it inside."""
MAX_CORNERS: Final = 2000


def cross(a: Point, b: Point, c: Point) -> float:
    """Return twice the area of the triangle a, b, c in square metres; positive for a left turn."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def between(a: Point, b: Point, part: float) -> Point:
    """Return the point at this part of the way from a to b."""
    return (a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1]))


class Space:
    """Free ground inside of a ring, less the holes; its walls belong to it.

    >>> room = Space([(0, 0), (10, 0), (10, 5), (0, 5)], [[(4, 1), (6, 1), (6, 3), (4, 3)]])
    >>> room.area_m2, room.sees((1, 2), (9, 2)), room.sees((1, 4), (9, 4))
    (46.0, False, True)
    """

    def __init__(self, ring: Iterable[Point], holes: Iterable[Iterable[Point]] = ()) -> None:
        """Use the corners of a polygon in metres, open rings in any direction.

        Raises `AreaError` for an invalid polygon: rings that cross or touch, holes outside, too
        many corners.
        """
        rings = [_corners(points) for points in (ring, *holes)]
        if any(len(points) < 3 for points in rings):
            raise AreaError("the polygon has a ring without area; draw it anew")
        if sum(map(len, rings)) > MAX_CORNERS:
            raise AreaError(f"the polygon has more than {MAX_CORNERS} corners; simplify it")
        polygon = Polygon(rings[0], rings[1:])
        if not polygon.is_valid:
            raise AreaError(f"not a polygon: {explain_validity(polygon)}; draw it anew")
        self.polygon = Polygon(orient(polygon))
        self.rings: list[list[Point]] = [
            [(float(x), float(y)) for x, y in one.coords[:-1]]
            for one in (self.polygon.exterior, *self.polygon.interiors)
        ]
        """Corners, with the free ground to the left of each edge."""
        self.edges: NDArray[np.float64] = np.array(
            [
                (*a, *b)
                for points in self.rings
                for a, b in zip(points, points[1:] + points[:1], strict=True)
            ]
        )
        """Edges, a row each: x and y of the beginning and the end."""
        self._wide = self.polygon.buffer(TOUCH_M, join_style="mitre")
        shapely.prepare(self._wide)

    @property
    def corners(self) -> list[Point]:
        """Corners of all rings."""
        return [point for points in self.rings for point in points]

    @property
    def area_m2(self) -> float:
        """Area of the free ground, m2."""
        return float(self.polygon.area)

    @property
    def diameter_m(self) -> float:
        """Distance of the two corners that are farthest from each other, m."""
        hull = shapely.get_coordinates(self.polygon.convex_hull)
        return float(np.hypot(*(hull[:, None] - hull[None]).transpose(2, 0, 1)).max())

    @property
    def reflex_corners(self) -> int:
        """Number of corners that the free ground turns around: there sight is broken."""
        return sum(
            cross(points[i - 1], points[i], points[(i + 1) % len(points)]) < 0.0
            for points in self.rings
            for i in range(len(points))
        )

    def sees(self, a: Point, b: Point) -> bool:
        """Return whether the straight line between two points is free; walls may be touched."""
        return bool(self._wide.covers(LineString((a, b))))

    def sees_all(self, a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return the same for many pairs; both of shape (n, 2)."""
        lines = shapely.linestrings(np.stack([a, b], axis=1))
        return np.asarray(shapely.covers(self._wide, lines), dtype=bool)

    def is_free(self, corners: Sequence[Point]) -> bool:
        """Return whether no part of a convex polygon lies in a wall."""
        return bool(self._wide.covers(shapely.MultiPoint(corners).convex_hull))

    def holds(self, point: Point) -> bool:
        """Return whether a point is free; walls count as free."""
        return bool(self._wide.covers(shapely.Point(point)))


def _corners(points: Iterable[Point]) -> list[Point]:
    """Return corners rounded, without repetitions and without corners on a straight line."""
    ring: list[Point] = []
    for x, y in points:
        if not (math.isfinite(x) and math.isfinite(y)):
            raise AreaError(f"the polygon has a corner at {x}, {y}; give finite numbers")
        point = (round(x / GRID_M) * GRID_M, round(y / GRID_M) * GRID_M)
        if not ring or point != ring[-1]:
            ring.append(point)
    while len(ring) > 1 and ring[0] == ring[-1]:
        ring.pop()
    kept = len(ring) + 1
    while kept > len(ring) >= 3:  # the rest may be straight by now
        kept = len(ring)
        ring = [
            point
            for i, point in enumerate(ring)
            if not _straight(ring[i - 1], point, ring[(i + 1) % len(ring)])
        ]
    return ring


def _straight(a: Point, b: Point, c: Point) -> bool:
    """Return whether b is on the line from a to c, within rounding."""
    return abs(cross(a, b, c)) <= GRID_M * 1e-3 * (math.dist(a, b) + math.dist(b, c))
