"""Straight motion between two samples: least distances and distances outside, computed."""

from __future__ import annotations

import math

import shapely
from shapely.geometry import LineString, MultiPolygon, Point, Polygon

from missions.units import GridPoint

from .track import Sample

LONGEST_LEG_S = 1.0
"""Maximum time between two samples that are taken for a straight leg, s."""

Leg = tuple[Sample, Sample]
Vector = tuple[float, float, float]


def place_at(leg: Leg, t_s: float) -> Vector:
    """Return east, north and up at a time within a leg."""
    a, b = leg
    share = (t_s - a.t_s) / (b.t_s - a.t_s)
    return (
        a.place.east_m + share * (b.place.east_m - a.place.east_m),
        a.place.north_m + share * (b.place.north_m - a.place.north_m),
        a.up_m + share * (b.up_m - a.up_m),
    )


def least_distance_m(one: Leg, other: Leg) -> float:
    """Return the least distance in 3D over the time that two legs share; inf for none.

    >>> def leg(e0, e1, n):
    ...     ends = ((0.0, e0), (1.0, e1))
    ...     return tuple(Sample(t, GridPoint(e, n), 10.0, True) for t, e in ends)
    >>> least_distance_m(leg(-9.0, 9.0, 0.0), leg(9.0, -9.0, 4.0))
    4.0
    """
    begin_s, end_s = max(one[0].t_s, other[0].t_s), min(one[1].t_s, other[1].t_s)
    if begin_s >= end_s:
        return math.inf
    ends = [
        tuple(a - b for a, b in zip(place_at(one, t), place_at(other, t), strict=True))
        for t in (begin_s, end_s)
    ]
    along = [b - a for a, b in zip(*ends, strict=True)]
    length2 = sum(d * d for d in along)
    share = -sum(a * d for a, d in zip(ends[0], along, strict=True)) / length2 if length2 else 0.0
    share = min(max(share, 0.0), 1.0)
    return math.hypot(*(a + share * d for a, d in zip(ends[0], along, strict=True)))


class Inside:
    """The distance of legs of one vehicle outside of a fence; quick where the edge is far away."""

    def __init__(self, fence: Polygon | MultiPolygon) -> None:
        self._fence, self._free_m = fence, 0.0
        shapely.prepare(fence)

    def outside_m(self, leg: Leg) -> float:
        """Return how far a leg leads outside at least, m.

        It is measured at both ends, and half-way through a corner that the leg cuts.
        """
        begin, end = leg[0].place, leg[1].place
        self._free_m -= begin.distance_to(end)
        if self._free_m > 0.0:
            return 0.0
        at = Point(end)
        if self._fence.contains(at):
            self._free_m = float(self._fence.boundary.distance(at))
        points = [begin, end]
        if begin != end:
            path = LineString((begin, end))
            if self._fence.covers(path):
                return 0.0
            beyond = path.difference(self._fence)
            points += [_middle(piece) for piece in getattr(beyond, "geoms", [beyond])]
        return max(float(self._fence.distance(Point(point))) for point in points)


def _middle(piece: LineString) -> GridPoint:
    middle = piece.interpolate(0.5, normalized=True)
    return GridPoint(middle.x, middle.y)


def unseen(
    lane: tuple[GridPoint, GridPoint], frames: list[tuple[GridPoint, float]], step_m: float
) -> GridPoint | None:
    """Return the first point of a lane that no frame shows."""
    begin, end = lane
    length_m = begin.distance_to(end)
    for i in range(int(length_m // step_m) + 1):
        at = begin.towards(end, i * step_m)
        if not any(place.distance_to(at) <= reach_m for place, reach_m in frames):
            return at
    return None
