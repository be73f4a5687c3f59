"""The boustrophedon search of the box, until somebody sees the ROI.

Lanes run along rows or columns of cells, whichever makes them longer. A frame judges the cell
below and its neighbours, so lanes lie three cells apart. Several vehicles share the lanes in
blocks of nearly equal length.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

from shapely import line_merge
from shapely.geometry import LineString, Polygon
from shapely.geometry import box as rectangle
from shapely.geometry.base import BaseGeometry
from shapely.ops import unary_union

from missions.ground.fence import Fence
from missions.units import GridPoint

LANE_CELLS = 3

Lane = tuple[GridPoint, GridPoint]


def lanes(box: Sequence[GridPoint], cell_m: float, fence: Fence) -> tuple[Lane, ...]:
    """The lanes over a box, in the order and direction of flight, inside the fence.

    Points are in the fixed frame. A lane is as long as the box is anywhere in the three rows that
    it judges, so a slanting rim leaves no gap; lanes are cut where the fence forbids them.

    >>> box = [GridPoint(0, 0), GridPoint(40, 0), GridPoint(40, 20), GridPoint(0, 20)]
    >>> around = [GridPoint(-9, -9), GridPoint(60, -9), GridPoint(60, 60), GridPoint(-9, 60)]
    >>> [lane[0].north_m for lane in lanes(box, 4.0, Fence.of(around, [], 0.0))]
    [4.0, 16.0]
    """
    polygon = Polygon(box)
    west, south, east, north = polygon.bounds
    along_east = east - west >= north - south
    low, high = (south, north) if along_east else (west, east)
    flown: list[Lane] = []
    for k, offset in enumerate(_offsets(low, high, cell_m)):
        near, far = offset - LANE_CELLS / 2 * cell_m, offset + LANE_CELLS / 2 * cell_m
        if along_east:
            parts = polygon.intersection(rectangle(west - 1, near, east + 1, far))
            spans = [(part.bounds[0], part.bounds[2]) for part in _pieces(parts)]
            line = unary_union([LineString([(a, offset), (b, offset)]) for a, b in spans])
        else:
            parts = polygon.intersection(rectangle(near, south - 1, far, north + 1))
            spans = [(part.bounds[1], part.bounds[3]) for part in _pieces(parts)]
            line = unary_union([LineString([(offset, a), (offset, b)]) for a, b in spans])
        pieces = line_merge(line).intersection(fence.inner)
        row = sorted(
            (_point(piece.coords[0]), _point(piece.coords[-1]))
            for piece in _pieces(pieces)
            if isinstance(piece, LineString) and piece.length >= cell_m / 2
        )
        if k % 2:
            row = [(end, start) for start, end in reversed(row)]
        flown.extend(row)
    return tuple(flown)


def _offsets(low: float, high: float, cell_m: float) -> list[float]:
    """Centre lines of cells, three cells apart, so that every row of cells is judged.

    The first lane judges the outermost row whose centre is in the box.
    """
    first = math.ceil(low / cell_m - 1e-9)
    last = math.floor(high / cell_m + 1e-9)
    if last < first:  # narrower than a cell: one lane through the middle
        return [(low + high) / 2]
    rows = list(range(first + 1, last + 1, LANE_CELLS)) or [first]
    if rows[-1] + 1 < last:
        rows.append(last)
    return [row * cell_m for row in rows]


def _pieces(shape: BaseGeometry) -> list[BaseGeometry]:
    """The parts of a geometry that has several, or the geometry itself."""
    return [part for part in getattr(shape, "geoms", [shape]) if not part.is_empty]


def _point(coordinates: Sequence[float]) -> GridPoint:
    return GridPoint(float(coordinates[0]), float(coordinates[1]))


def share_out(all_lanes: Sequence[Lane], vehicles: int) -> tuple[tuple[Lane, ...], ...]:
    """A block of consecutive lanes for each vehicle, of nearly equal length.

    >>> lane = (GridPoint(0, 0), GridPoint(10, 0))
    >>> [len(block) for block in share_out([lane] * 5, 2)]
    [2, 3]
    """
    total_m = sum(a.distance_to(b) for a, b in all_lanes)
    blocks: list[list[Lane]] = [[] for _ in range(vehicles)]
    done_m = 0.0
    for start, end in all_lanes:
        length_m = start.distance_to(end)
        middle = (done_m + length_m / 2) / total_m
        blocks[min(int(middle * vehicles), vehicles - 1)].append((start, end))
        done_m += length_m
    return tuple(tuple(block) for block in blocks)


def rest_of(lane: Lane, position: GridPoint) -> Lane:
    """What is left of a lane for a vehicle that leaves it at a position, on it or beside it.

    >>> rest_of((GridPoint(0, 0), GridPoint(10, 0)), GridPoint(4, 1))
    (GridPoint(east_m=4.0, north_m=0.0), GridPoint(east_m=10, north_m=0))
    """
    start, end = lane
    east_m, north_m = end.east_m - start.east_m, end.north_m - start.north_m
    along = (position.east_m - start.east_m) * east_m + (position.north_m - start.north_m) * north_m
    share = min(max(along / max(east_m**2 + north_m**2, 1e-9), 0.0), 1.0)
    return GridPoint(start.east_m + share * east_m, start.north_m + share * north_m), end


def search_length_m(block: Sequence[Lane], start: GridPoint) -> float:
    """How far a vehicle flies to search its block, from `start` and back to it."""
    stations = [start, *itertools.chain.from_iterable(block), start]
    return sum(a.distance_to(b) for a, b in itertools.pairwise(stations))
