"""The air over the pads of a fleet: each member climbs and descends in its own column.

Members out of contact cannot ask each other. So each has air that no other enters. It is its layer,
and the column over its pad, a hole in the geofence of all others.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Final

from shapely.geometry import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from missions.geo.fence import Fence
from missions.units import GridPoint

STRAY_M: Final = 2.0
"""Maximum distance of a vehicle from its column in a climb or descent, m."""
PAD_M: Final = 2.0
"""Maximum distance of a vehicle from its pad on the ground, m."""
_CORNERS: Final = 12
GATE_STEP_M: Final = 4.0
GATE_STEPS: Final = 15
"""Number of steps from the pad in which a gate is searched."""
ROW_TIMES: Final = 1.5
"""Ratio of length to width from which on pads count as a row."""
BEYOND_GATE_M: Final = 120.0
GATE_DIRECTIONS_RAD: Final = tuple(
    math.radians(turn) for turn in (-75.0, -50.0, -25.0, 0.0, 25.0, 50.0, 75.0)
)
"""Directions from a gate that must lead past all columns."""


def column_radius_m(separation_m: float) -> float:
    """Return the distance from a pad that all others keep, m.

    >>> column_radius_m(4.0)
    8.0
    """
    return separation_m + STRAY_M + PAD_M


def columns_over(pads: Sequence[GridPoint], separation_m: float) -> list[list[GridPoint]]:
    """Return a ring around each pad (not closed), at least `column_radius_m` from it everywhere."""
    reach_m = column_radius_m(separation_m) / math.cos(math.pi / _CORNERS)
    return [ring(pad, reach_m, _CORNERS) for pad in pads]


def ring(centre: GridPoint, radius_m: float, places: int) -> list[GridPoint]:
    """Return places all around a centre, north first, to the centimetre.

    >>> ring(GridPoint(1.0, 0.0), 2.0, places=4)[1]
    GridPoint(east_m=3.0, north_m=0.0)
    """
    turns = (k * math.tau / places for k in range(places))
    return [
        GridPoint(
            round(centre.east_m + radius_m * math.sin(turn), 2),
            round(centre.north_m + radius_m * math.cos(turn), 2),
        )
        for turn in turns
    ]


def fence_without(fence: Fence, columns: Sequence[Sequence[GridPoint]], margin_m: float) -> Fence:
    """Return a fence without others' columns; a column across its edge removes that part."""
    area: BaseGeometry = fence.outer
    for column in columns:
        area = area.difference(Polygon(column))
    parts = getattr(area, "geoms", [area])
    whole = max(parts, key=lambda part: part.area)
    return Fence.from_rings(
        _points(whole.exterior.coords), [_points(r.coords) for r in whole.interiors], margin_m
    )


def _points(coordinates: Sequence[Sequence[float]]) -> list[GridPoint]:
    return [GridPoint(float(at[0]), float(at[1])) for at in list(coordinates)[:-1]]


@lru_cache(maxsize=64)
def gate_past_columns(fence: Fence, whole: Fence, pad: GridPoint, cell_m: float) -> GridPoint:
    """Return a place before a pad from which ways lead past all columns, the holes of `fence`.

    `whole` is the fence without them. If no such place is found it is the pad itself.
    """
    # (a plan looks at whole cells)
    columns = whole.inner.difference(fence.inner).buffer(cell_m * math.sqrt(0.5))
    if columns.is_empty:
        return pad
    middle = whole.inner.centroid
    ahead = math.atan2(middle.y - pad.north_m, middle.x - pad.east_m)
    # straight out of a row of pads, not along it
    out = _across(columns.minimum_rotated_rectangle, ahead)
    for step in range(GATE_STEPS + 1):
        gate = _beyond(pad, out, step * GATE_STEP_M)
        if not fence.allows(gate):
            continue
        ways = [
            LineString([gate, _beyond(gate, out + turn, BEYOND_GATE_M)])
            for turn in GATE_DIRECTIONS_RAD
        ]
        if not any(way.intersects(columns) for way in ways):
            return gate
    return pad


def _across(row: BaseGeometry, ahead: float) -> float:
    """Return the direction across the longer side of a rectangle that is nearest to another."""
    if not isinstance(row, Polygon):
        return ahead
    corners = [GridPoint(x, y) for x, y in row.exterior.coords[:3]]
    (short_m, _), (long_m, along) = sorted(
        (a.distance_to(b), math.atan2(b.north_m - a.north_m, b.east_m - a.east_m))
        for a, b in pairwise(corners)
    )
    if long_m < ROW_TIMES * short_m:
        return ahead
    turns = (along + math.pi / 2.0, along - math.pi / 2.0)
    return max(turns, key=lambda turn: math.cos(turn - ahead))


def _beyond(place: GridPoint, turn_rad: float, way_m: float) -> GridPoint:
    return GridPoint(
        place.east_m + way_m * math.cos(turn_rad), place.north_m + way_m * math.sin(turn_rad)
    )
