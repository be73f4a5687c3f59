"""The boustrophedon search of the box, until somebody sees the ROI.

Lanes run along rows or columns of cells, whichever makes them longer. A frame judges the cell
below and its neighbours, so lanes lie three cells apart. Several vehicles share the lanes in
blocks of nearly equal length.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Sequence

from shapely import line_merge
from shapely.geometry import LineString, Polygon
from shapely.geometry import box as rectangle
from shapely.geometry.base import BaseGeometry
from shapely.ops import unary_union

from missions.geo.fence import Fence
from missions.units import GridPoint

LANE_CELLS = 3

Lane = tuple[GridPoint, GridPoint]


def along_east(box: Sequence[GridPoint]) -> bool:
    """Whether the lanes of a box lie along grid east, else along grid north: its longer side."""
    west, south, east, north = Polygon(box).bounds
    return bool(east - west >= north - south)


def lanes(
    box: Sequence[GridPoint],
    cell_m: float,
    fence: Fence,
    rows: int = LANE_CELLS,
    eastward: bool | None = None,
    spare_rows: int = 0,
) -> tuple[Lane, ...]:
    """The lanes over a box, in the order and direction of flight, inside the fence.

    They lie along grid east or north as `eastward` says, else along the longer side of the box.
    Points are in the fixed frame. A lane is as long as the box is anywhere in the `rows` rows that
    it judges, so a slanting rim leaves no gap; lanes are cut where the fence forbids them. The last
    one takes as many as `spare_rows` more, where a lane for those alone would be left.

    >>> box = [GridPoint(0, 0), GridPoint(40, 0), GridPoint(40, 20), GridPoint(0, 20)]
    >>> around = [GridPoint(-9, -9), GridPoint(60, -9), GridPoint(60, 60), GridPoint(-9, 60)]
    >>> [lane[0].north_m for lane in lanes(box, 4.0, Fence.of(around, [], 0.0))]
    [4.0, 16.0]
    """
    polygon = Polygon(box)
    west, south, east, north = polygon.bounds
    eastward = along_east(box) if eastward is None else eastward
    low, high = (south, north) if eastward else (west, east)
    flown: list[Lane] = []
    for k, offset in enumerate(_offsets(low, high, cell_m, rows, spare_rows)):
        near, far = offset - rows / 2 * cell_m, offset + rows / 2 * cell_m
        if eastward:
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


def _offsets(low: float, high: float, cell_m: float, rows: int, spare: int = 0) -> list[float]:
    """Where lanes lie that judge so many rows each, so that every row of cells is judged.

    The first lane judges the outermost row whose centre is in the box.

    >>> _offsets(0, 200, 10, 10), _offsets(0, 200, 10, 10, 1)
    ([45.0, 145.0, 155.0], [45.0, 150.0])
    """
    first = math.ceil(low / cell_m - 1e-9)
    last = math.floor(high / cell_m + 1e-9)
    if last < first:  # narrower than a cell: one lane through the middle
        return [(low + high) / 2]
    if rows == LANE_CELLS:  # on rows, as ever
        on = list(range(first + 1, last + 1, LANE_CELLS)) or [first]
        if on[-1] + 1 < last:
            on.append(last)
        return [row * cell_m for row in on]
    beside = (rows - 1) / 2
    if last - first + 1 <= rows:
        return [(first + last) / 2 * cell_m]
    begin = list(range(first, last + 1, rows))
    if last - begin[-1] < spare:
        return [(row + beside) * cell_m for row in begin[:-2]] + [(begin[-2] + last) / 2 * cell_m]
    return [min(row + beside, last - beside) * cell_m for row in begin]


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


def along_m(lane: Lane, place: GridPoint) -> float:
    """How far along a lane the nearest point to a place lies, from 0 to the lane's length.

    >>> along_m((GridPoint(0, 0), GridPoint(10, 0)), GridPoint(4, 1))
    4.0
    """
    start, end = lane
    length_m = start.distance_to(end)
    if length_m == 0.0:
        return 0.0
    east_m, north_m = end.east_m - start.east_m, end.north_m - start.north_m
    along = (place.east_m - start.east_m) * east_m + (place.north_m - start.north_m) * north_m
    return min(max(along / length_m, 0.0), length_m)


def point_on(lane: Lane, distance_m: float) -> GridPoint:
    """The point of a lane so far from its start."""
    start, end = lane
    share = distance_m / max(start.distance_to(end), 1e-9)
    return GridPoint(
        start.east_m + share * (end.east_m - start.east_m),
        start.north_m + share * (end.north_m - start.north_m),
    )


def offset_m(lane: Lane, place: GridPoint) -> float:
    """How far a place lies beside a lane."""
    return point_on(lane, along_m(lane, place)).distance_to(place)


def unseen(lane: Lane, seen_m: Collection[float], cell_m: float) -> tuple[Lane, ...]:
    """The stretches of a lane that no frame shows, in the direction of flight.

    A frame counts for a cell before it and a cell behind it. What is shorter than half a cell is
    in the frames beside it: they show three cells.

    >>> lane = (GridPoint(0, 0), GridPoint(40, 0))
    >>> unseen(lane, [2.0, 6.0, 10.0, 14.0], cell_m=4.0)
    ((GridPoint(east_m=18.0, north_m=0.0), GridPoint(east_m=40.0, north_m=0.0)),)
    """
    length_m = lane[0].distance_to(lane[1])
    gaps: list[tuple[float, float]] = []
    reached_m = 0.0
    for place_m in [*sorted(seen_m), length_m + cell_m]:
        if place_m - cell_m - reached_m >= 0.5 * cell_m:
            gaps.append((reached_m, min(place_m - cell_m, length_m)))
        reached_m = max(reached_m, place_m + cell_m)
    return tuple((point_on(lane, a), point_on(lane, b)) for a, b in gaps)


def search_length_m(block: Sequence[Lane], start: GridPoint) -> float:
    """How far a vehicle flies to search its block, from `start` and back to it."""
    stations = [start, *itertools.chain.from_iterable(block), start]
    return sum(a.distance_to(b) for a, b in itertools.pairwise(stations))
