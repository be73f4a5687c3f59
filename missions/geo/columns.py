"""The air over the pads of a fleet: each member climbs and comes down in a column of its own.

Members out of contact cannot ask each other. So each has air that no other ever enters: its layer,
and the column over its pad, which is a hole in the geofence of all others.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from missions.geo.fence import Fence
from missions.units import GridPoint

STRAY_M: Final = 2.0
"""So far a vehicle strays from its column while it climbs or comes down."""
PAD_M: Final = 2.0
"""So far from its pad it may stand."""
_CORNERS: Final = 12


def column_radius_m(separation_m: float) -> float:
    """How far from a pad everybody else stays, metres.

    >>> column_radius_m(4.0)
    8.0
    """
    return separation_m + STRAY_M + PAD_M


def columns_over(pads: Sequence[GridPoint], separation_m: float) -> list[list[GridPoint]]:
    """A ring around each pad (not closed), no nearer to it anywhere than `column_radius_m`."""
    reach_m = column_radius_m(separation_m) / math.cos(math.pi / _CORNERS)
    turns = [k * math.tau / _CORNERS for k in range(_CORNERS)]
    return [
        [
            GridPoint(
                round(pad.east_m + reach_m * math.sin(turn), 2),
                round(pad.north_m + reach_m * math.cos(turn), 2),
            )
            for turn in turns
        ]
        for pad in pads
    ]


def fence_without(fence: Fence, columns: Sequence[Sequence[GridPoint]], margin_m: float) -> Fence:
    """A fence without the columns of others; one that reaches over the rim takes a bite of it."""
    area: BaseGeometry = fence.outer
    for column in columns:
        area = area.difference(Polygon(column))
    parts = getattr(area, "geoms", [area])
    whole = max(parts, key=lambda part: part.area)
    return Fence.of(
        _points(whole.exterior.coords), [_points(r.coords) for r in whole.interiors], margin_m
    )


def _points(coordinates: Sequence[Sequence[float]]) -> list[GridPoint]:
    return [GridPoint(float(at[0]), float(at[1])) for at in list(coordinates)[:-1]]
