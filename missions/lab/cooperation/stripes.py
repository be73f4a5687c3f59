"""The trapezoid decomposition in stripes, as a graph: convex pieces of ground, and doors.

Horizontal lines, a stripe's height apart, cut the free ground. Vertical lines through the corners
where the ground stops being convex cut each layer into pieces. Robots find a piece by sweeping it:
see `trapezoids`, which uses only ground in sight.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.lab.cooperation.space import Point, Space

_THIN_M: Final = 1e-6
"""Width below which ground is no way, m."""
_SLOPE: Final = 1e-9


@dataclass(frozen=True, slots=True)
class Trapezoid:
    """Ground between two vertical lines, a floor and a ceiling."""

    x0: float
    x1: float
    low: tuple[float, float]
    """y of the floor at x0 and at x1."""
    high: tuple[float, float]
    open_below: bool
    """True if the floor is a line between two layers, not a wall."""
    open_above: bool


@dataclass(frozen=True, slots=True)
class Door:
    """A segment through which robots come from one stripe into another."""

    other: int
    """Number of the stripe behind it."""
    a: Point
    b: Point


@dataclass(slots=True)
class Stripe:
    """A convex piece of a layer: a vertex of the dual graph, its doors the edges."""

    number: int
    bottom: float
    """y of the layer's lower line."""
    top: float
    parts: tuple[Trapezoid, ...]
    """From west to east."""
    doors: list[Door] = field(default_factory=list)

    @property
    def x0(self) -> float:
        """Its western end."""
        return self.parts[0].x0

    @property
    def x1(self) -> float:
        """Its eastern end."""
        return self.parts[-1].x1

    def span(self, x: float) -> tuple[float, float]:
        """y of floor and ceiling at an x between its ends."""
        parts = self.parts
        i = max(bisect_right(parts, x, key=lambda part: part.x0) - 1, 0)
        part = parts[i]
        share = min(max((x - part.x0) / (part.x1 - part.x0), 0.0), 1.0)
        low = part.low[0] + share * (part.low[1] - part.low[0])
        high = part.high[0] + share * (part.high[1] - part.high[0])
        return low, max(low, high)

    def bends(self) -> list[float]:
        """x where floor or ceiling bends, from west to east, with both ends."""
        return [self.x0, *(part.x1 for part in self.parts)]

    def outline(self) -> list[Point]:
        """Its corners, against the clock."""
        floor = [(p.x0, p.low[0]) for p in self.parts] + [(self.x1, self.parts[-1].low[1])]
        ceiling = [(p.x0, p.high[0]) for p in self.parts] + [(self.x1, self.parts[-1].high[1])]
        return floor + ceiling[::-1]

    def holds(self, point: Point) -> bool:
        """Return whether a point lies in it, its border included."""
        if not self.x0 - _THIN_M <= point[0] <= self.x1 + _THIN_M:
            return False
        low, high = self.span(point[0])
        return low - _THIN_M <= point[1] <= high + _THIN_M


def stripes_of(space: Space, line_y: float, height_m: float) -> list[Stripe]:
    """Return all stripes, of layers `height_m` high, one of whose lines is at `line_y`."""
    ys = space.edges[:, 1]
    first = math.floor((ys.min() - line_y) / height_m + 1e-9)
    last = math.ceil((ys.max() - line_y) / height_m - 1e-9)
    stripes: list[Stripe] = []
    below: list[Stripe] = []
    for layer in range(first, last):
        bottom, top = line_y + layer * height_m, line_y + (layer + 1) * height_m
        found = [
            Stripe(len(stripes) + i, bottom, top, parts)
            for i, parts in enumerate(_merged(_trapezoids(space, bottom, top)))
        ]
        _doors_beside(found)
        _doors_between(below, found)
        stripes += found
        below = found
    return stripes


def _trapezoids(space: Space, bottom: float, top: float) -> list[Trapezoid]:
    """Return a layer from west to east, cut at every corner and at the ends of each wall."""
    edges = space.edges
    inside = (edges[:, 1] >= bottom - _THIN_M) & (edges[:, 1] <= top + _THIN_M)
    cuts = [edges[inside, 0]]
    rise = edges[:, 3] - edges[:, 1]
    for y in (bottom, top):
        through = (edges[:, 1] - y) * (edges[:, 3] - y) < 0.0
        share = (y - edges[through, 1]) / rise[through]
        cuts.append(edges[through, 0] + share * (edges[through, 2] - edges[through, 0]))
    xs = np.unique(np.concatenate(cuts))
    leaning = edges[edges[:, 0] != edges[:, 2]]
    found: list[Trapezoid] = []
    x0 = math.nan
    for x1 in map(float, xs):
        if x1 - x0 < _THIN_M:
            continue
        if not math.isnan(x0):
            found += _column(leaning, x0, x1, bottom, top)
        x0 = x1
    return found


def _column(
    edges: NDArray[np.float64], x0: float, x1: float, bottom: float, top: float
) -> list[Trapezoid]:
    """Return the free parts between two vertical lines, without a corner between them."""
    middle = (x0 + x1) / 2.0
    west, east = np.minimum(edges[:, 0], edges[:, 2]), np.maximum(edges[:, 0], edges[:, 2])
    here = edges[(west <= middle) & (middle < east)]  # for a corner far above, one of two edges
    slope = (here[:, 3] - here[:, 1]) / (here[:, 2] - here[:, 0])
    y = here[:, 1] + (middle - here[:, 0]) * slope
    order = np.argsort(y, kind="stable")
    walls = [(float(y[i]), float(slope[i])) for i in order]
    found = []
    for (y_low, slope_low), (y_high, slope_high) in zip(walls[::2], walls[1::2], strict=True):
        open_below, open_above = y_low < bottom - _THIN_M, y_high > top + _THIN_M
        if y_low < bottom:
            y_low, slope_low = bottom, 0.0
        if y_high > top:
            y_high, slope_high = top, 0.0
        if y_high - y_low <= _THIN_M:
            continue
        half = (x1 - x0) / 2.0
        ends = (y_low - half * slope_low, y_low + half * slope_low)
        tops = (y_high - half * slope_high, y_high + half * slope_high)
        found.append(Trapezoid(x0, x1, ends, tops, open_below, open_above))
    return found


def _merged(parts: list[Trapezoid]) -> list[tuple[Trapezoid, ...]]:
    """Return neighbours that are one piece and convex together, as one."""
    chains: list[list[Trapezoid]] = []
    for part in parts:
        before = [c for c in chains if abs(c[-1].x1 - part.x0) < _THIN_M and _overlap(c[-1], part)]
        if len(before) == 1 and _convex(before[0][-1], part):
            before[0].append(part)
        else:
            chains.append([part])
    return [tuple(chain) for chain in chains]


def _overlap(west: Trapezoid, east: Trapezoid) -> tuple[float, float] | None:
    """Return the y between which two neighbours are open to each other."""
    low, high = max(west.low[1], east.low[0]), min(west.high[1], east.high[0])
    return (low, high) if high - low > _THIN_M else None


def _convex(west: Trapezoid, east: Trapezoid) -> bool:
    """Return whether two neighbours share their whole border, and are convex together."""
    if abs(west.low[1] - east.low[0]) > _THIN_M or abs(west.high[1] - east.high[0]) > _THIN_M:
        return False
    wide_w, wide_e = west.x1 - west.x0, east.x1 - east.x0
    floor = (east.low[1] - east.low[0]) / wide_e - (west.low[1] - west.low[0]) / wide_w
    ceiling = (east.high[1] - east.high[0]) / wide_e - (west.high[1] - west.high[0]) / wide_w
    return floor >= -_SLOPE and ceiling <= _SLOPE


def _doors_beside(stripes: list[Stripe]) -> None:
    for west in stripes:
        for east in stripes:
            last, first = west.parts[-1], east.parts[0]
            if west is east or abs(last.x1 - first.x0) >= _THIN_M:
                continue
            if (shared := _overlap(last, first)) is not None:
                a, b = (first.x0, shared[0]), (first.x0, shared[1])
                west.doors.append(Door(east.number, a, b))
                east.doors.append(Door(west.number, a, b))


def _doors_between(below: list[Stripe], above: list[Stripe]) -> None:
    floors = [
        (part.x0, part.x1, stripe) for stripe in above for part in stripe.parts if part.open_below
    ]
    floors.sort(key=lambda one: one[0])
    starts = [one[0] for one in floors]
    for stripe in below:
        found: dict[int, list[tuple[float, float]]] = {}
        for part in stripe.parts:
            if not part.open_above:
                continue
            for x0, x1, other in floors[: bisect_left(starts, part.x1)]:
                west, east = max(x0, part.x0), min(x1, part.x1)
                if east - west > _THIN_M:
                    found.setdefault(other.number, []).append((west, east))
        by_number = {other.number: other for _, _, other in floors}
        for number, pieces in found.items():
            for west, east in _joined(sorted(pieces)):
                a, b = (west, stripe.top), (east, stripe.top)
                stripe.doors.append(Door(number, a, b))
                by_number[number].doors.append(Door(stripe.number, a, b))


def _joined(pieces: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return pieces of a line, with those that touch as one."""
    joined = [pieces[0]]
    for west, east in pieces[1:]:
        if west - joined[-1][1] < _THIN_M:
            joined[-1] = (joined[-1][0], max(joined[-1][1], east))
        else:
            joined.append((west, east))
    return joined
