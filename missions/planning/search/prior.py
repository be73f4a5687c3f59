"""Probable places of the region, and the lanes that would show it there.

A prior is a sum of spots (normal distributions around a point) and areas (evenly spread over a
polygon), by weight. It is never certain: a part of it lies evenly over the box, so every lane has
some weight.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry import Polygon

from missions.planning.search.lanes import Lane, along_east
from missions.units import GridPoint

EVEN_SHARE: Final = 0.1
"""Share of the probability that lies evenly over the box, for any prior."""
_MAX_POINTS: Final = 200_000
_POINTS_A_CELL: Final = 3
_FEWEST_COLUMNS: Final = 50

Points = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Spot:
    """A place with a standard deviation of `spread_m` along either axis. Fixed frame."""

    place: GridPoint
    spread_m: float
    weight: float = 1.0

    def density(self, points: Points) -> Points:
        """Return the weight per square metre at points of shape (n, 2), metres east and north."""
        away_m2 = np.sum((points - np.asarray(self.place)) ** 2, axis=1)
        two_var_m2 = 2.0 * self.spread_m**2
        found: Points = np.exp(-away_m2 / two_var_m2) * (self.weight / (math.pi * two_var_m2))
        return found


@dataclass(frozen=True, slots=True)
class Area:
    """A polygon of the fixed frame, with its holes."""

    polygon: Polygon
    weight: float = 1.0

    def density(self, points: Points) -> Points:
        """Return the weight per square metre at points of shape (n, 2), metres east and north."""
        inside = shapely.intersects_xy(self.polygon, points[:, 0], points[:, 1])
        found: Points = np.where(inside, self.weight / self.polygon.area, 0.0)
        return found


class LikelyLane(NamedTuple):
    """A lane, and the part of the prior that it shows."""

    lane: Lane
    probability: float
    """Probability that the region lies where this lane shows the ground; 1 over all lanes."""
    middle_m: float
    """Mean distance of the region from the start of the lane in that case, m."""

    @property
    def length_m(self) -> float:
        """Length from end to end, m."""
        return self.lane[0].distance_to(self.lane[1])

    @property
    def turned(self) -> LikelyLane:
        """The same lane, flown in the other direction."""
        start, end = self.lane
        return LikelyLane((end, start), self.probability, self.length_m - self.middle_m)


def likely_lanes(
    flown: Sequence[Lane],
    box: Sequence[GridPoint],
    prior: Sequence[Spot | Area],
    cell_m: float,
    rows: int,
) -> tuple[LikelyLane, ...]:
    """Return every lane of a box with its part of the prior; each judges `rows` rows of cells.

    Ground that no lane shows does not count, nor does ground outside the box.

    >>> box = [GridPoint(0, 0), GridPoint(40, 0), GridPoint(40, 20), GridPoint(0, 20)]
    >>> low = (GridPoint(0, 4), GridPoint(40, 4))
    >>> high = (GridPoint(40, 16), GridPoint(0, 16))
    >>> found = likely_lanes([low, high], box, [Spot(GridPoint(36, 16), 4.0)], 4.0, 3)
    >>> [round(lane.probability, 2) for lane in found], round(found[1].middle_m)
    ([0.12, 0.88], 6)
    """
    across = 1 if along_east(box) else 0
    points = _points(Polygon(box), cell_m, across)
    mass = np.zeros(len(points))
    for part in prior:
        mass += part.density(points)
    if (total := float(mass.sum())) > 0.0:
        mass *= (1.0 - EVEN_SHARE) / total
    mass += EVEN_SHARE / len(points)
    shown_by, along_m = _shown_by(flown, points, across, (rows + 1) / 2 * cell_m)
    seen = shown_by >= 0
    lane_mass = np.bincount(shown_by[seen], mass[seen], len(flown))
    moment = np.bincount(shown_by[seen], (mass * along_m)[seen], len(flown))
    sum_mass = float(lane_mass.sum()) or 1.0
    return tuple(
        LikelyLane(lane, float(m) / sum_mass, float(s / m) if m > 0.0 else 0.0)
        for lane, m, s in zip(flown, lane_mass, moment, strict=True)
    )


def _points(box: Polygon, cell_m: float, across: int) -> Points:
    """Return points of the box: `_POINTS_A_CELL` rows to a cell, evenly along them."""
    west, south, east, north = box.bounds
    (low, high), (near, far) = ((west, east), (south, north))[:: 1 if across == 0 else -1]
    apart_m = cell_m / _POINTS_A_CELL
    first, last = math.ceil(low / apart_m - 1e-9), math.floor(high / apart_m + 1e-9)
    rows = np.arange(first, last + 1) * apart_m
    if not len(rows):
        rows = np.asarray([(low + high) / 2.0])
    most = max(_MAX_POINTS // len(rows), _FEWEST_COLUMNS)
    count = min(max(math.ceil((far - near) / apart_m), 1), most)
    columns = near + (np.arange(count) + 0.5) * (far - near) / count
    points = np.empty((len(rows) * count, 2))
    points[:, across], points[:, 1 - across] = np.repeat(rows, count), np.tile(columns, len(rows))
    inside = points[shapely.intersects_xy(box, points[:, 0], points[:, 1])]
    return inside if len(inside) else points


def _shown_by(
    flown: Sequence[Lane], points: Points, across: int, reach_m: float
) -> tuple[npt.NDArray[np.intp], Points]:
    """Return for each point the nearest lane that shows it, -1 for none, and its distance along
    it."""
    best_m = np.full(len(points), np.inf)
    found, along_m = np.full(len(points), -1, np.intp), np.zeros(len(points))
    rows, columns = points[:, across], points[:, 1 - across]
    for index, (start, end) in enumerate(flown):
        near = np.flatnonzero(np.abs(rows - start[across]) <= reach_m)
        first, last = start[1 - across], end[1 - across]
        on_it = np.clip(columns[near], min(first, last), max(first, last))
        away_m = np.hypot(columns[near] - on_it, rows[near] - start[across])
        nearer = (away_m < best_m[near]) & (np.abs(columns[near] - on_it) <= reach_m)
        chosen = near[nearer]
        best_m[chosen], found[chosen] = away_m[nearer], index
        along_m[chosen] = np.abs(on_it[nearer] - first)
    return found, along_m
