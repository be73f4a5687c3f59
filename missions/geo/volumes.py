"""Volumes of reserved airspace: layers, and columns over the pads.

Every vehicle flies in a layer of its own height, so two legs never meet. Only a vehicle that climbs
or descends over its pad crosses the layers below its own. So a column is closed to legs while a
vehicle is in it, and no vehicle enters a column while a leg passes through it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from shapely.geometry import LineString, Point

from missions.units import GridPoint

_ROUNDING_M = 1e-6
"""Tolerance of heights, m: heights of layers are sums, and must not seem closer than they are."""


@dataclass(frozen=True, slots=True)
class Volume:
    """The air that a vehicle reserves: a path over ground, and its heights there.

    `stray_m` is the maximum distance of the vehicle from its path.

    >>> column = Volume((GridPoint(0, 0),), 0.0, 18.0)
    >>> leg = Volume((GridPoint(-20, 1), GridPoint(20, 1)), 12.0, 12.0)
    >>> column.meets(leg, distance_m=4.0)
    True
    """

    path: tuple[GridPoint, ...]
    low_m: float
    high_m: float
    stray_m: float = 0.0

    def meets(self, other: Volume, distance_m: float, layer_m: float = math.inf) -> bool:
        """Return whether the two come nearer to each other than a distance.

        Layers whose heights differ by `layer_m` are far enough apart.
        """
        gap_m = max(self.low_m - other.high_m, other.low_m - self.high_m)
        if gap_m >= min(distance_m, layer_m) - _ROUNDING_M:
            return False
        gap_m = _line(self.path).distance(_line(other.path)) - self.stray_m - other.stray_m
        return bool(gap_m < distance_m)

    def parts_from(self, other: Volume) -> bool:
        """Return whether its path is nearest to the other's at its beginning, over ground."""
        there = _line(other.path)
        nearest_m = float(_line(self.path).distance(there))
        return nearest_m >= float(Point(self.path[0]).distance(there)) - _ROUNDING_M


def _line(path: Sequence[GridPoint]) -> LineString | Point:
    return LineString(path) if len(path) > 1 else Point(path[0])
