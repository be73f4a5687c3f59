"""The boustrophedon search of the box, until a vehicle sees the ROI.

Lanes run along rows or columns of cells, whichever makes them longer. A frame judges the cell below
and its neighbours, so lanes lie three cells apart. Several vehicles share the lanes in blocks: of
nearly equal length (`share_out`), or by the time from the pad and back to it (`share_by_time`).
Vehicles in a row get lanes in the same order, so no two cross each other's way. Of all such shares,
those with the earliest return of the slowest vehicle are best. Of these, the one with the least
flight in all is taken: a vehicle that is done early maps meanwhile.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Container, Iterable, Sequence
from typing import Final

from shapely import line_merge
from shapely.geometry import LineString, Polygon
from shapely.geometry import box as rectangle
from shapely.geometry.base import BaseGeometry
from shapely.ops import unary_union

from missions.geo.fence import Fence
from missions.units import GridPoint

LANE_CELLS = 3

Lane = tuple[GridPoint, GridPoint]
Blocks = tuple[tuple[Lane, ...], ...]
"""The lanes of each vehicle, in the order of flight."""


def along_east(box: Sequence[GridPoint]) -> bool:
    """Return whether the lanes of a box lie along grid east, its longer side, else along north."""
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
    """Return the lanes over a box, in the order and direction of flight, inside the fence.

    With `eastward` they lie along grid east, with False along north, with None along the longer
    side of the box. Points are in the fixed frame. A lane is as long as the box is anywhere in its
    `rows` rows, so a slanting edge leaves no gap. Lanes are cut where the fence forbids them. The
    last lane has up to `spare_rows` more rows, if a lane for those alone would be left.

    >>> box = [GridPoint(0, 0), GridPoint(40, 0), GridPoint(40, 20), GridPoint(0, 20)]
    >>> around = [GridPoint(-9, -9), GridPoint(60, -9), GridPoint(60, 60), GridPoint(-9, 60)]
    >>> [lane[0].north_m for lane in lanes(box, 4.0, Fence.from_rings(around, [], 0.0))]
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
    """Return the offsets of lanes that judge `rows` rows each, so that every row is judged.

    The first lane judges the outermost row whose centre is in the box.

    >>> _offsets(0, 200, 10, 10), _offsets(0, 200, 10, 10, 1)
    ([45.0, 145.0, 155.0], [45.0, 150.0])
    """
    first = math.ceil(low / cell_m - 1e-9)
    last = math.floor(high / cell_m + 1e-9)
    if last < first:  # narrower than a cell: one lane through the middle
        return [(low + high) / 2]
    if rows == LANE_CELLS:  # on rows
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
    """Return the parts of a geometry that has several, or the geometry itself."""
    return [part for part in getattr(shape, "geoms", [shape]) if not part.is_empty]


def _point(coordinates: Sequence[float]) -> GridPoint:
    return GridPoint(float(coordinates[0]), float(coordinates[1]))


def share_out(all_lanes: Sequence[Lane], vehicles: int) -> Blocks:
    """Return a block of consecutive lanes for each vehicle, of nearly equal length."""
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
    """Return the distance along a lane of the point nearest to a place, m.

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
    """Return the point of a lane at a distance from its start."""
    return lane[0].towards(lane[1], distance_m)


ON_LANE_M: Final = 0.5
"""Maximum distance of a place from a lane that it is on, m."""


def number_among(lanes: Sequence[Lane], lane: Lane) -> int | None:
    """Return the number of the lane, from 0, that a lane is or is a part of; None for none.

    >>> lanes = [(GridPoint(0, y), GridPoint(9, y)) for y in (0, 4)]
    >>> number_among(lanes, (GridPoint(6, 4), GridPoint(2, 4)))
    1
    """
    for number, whole in enumerate(lanes):
        length_m, ends_m = whole[0].distance_to(whole[1]), [along_m(whole, end) for end in lane]
        beside = any(offset_m(whole, end) > ON_LANE_M for end in lane)
        if not beside and all(0.0 <= end_m <= length_m for end_m in ends_m):
            return number
    return None


def offset_m(lane: Lane, place: GridPoint) -> float:
    """Return the distance of a place from a lane, m."""
    return point_on(lane, along_m(lane, place)).distance_to(place)


def unseen_parts(lane: Lane, seen_m: Collection[float], cell_m: float) -> tuple[Lane, ...]:
    """Return the stretches of a lane that no frame shows, in the direction of flight.

    A frame counts for a cell before it and a cell behind it. A stretch shorter than half a cell is
    in the frames beside it: they show three cells.
    """
    length_m = lane[0].distance_to(lane[1])
    gaps: list[tuple[float, float]] = []
    reached_m = 0.0
    for place_m in [*sorted(seen_m), length_m + cell_m]:
        if place_m - cell_m - reached_m >= 0.5 * cell_m:
            gaps.append((reached_m, min(place_m - cell_m, length_m)))
        reached_m = max(reached_m, place_m + cell_m)
    return tuple((point_on(lane, a), point_on(lane, b)) for a, b in gaps)


def turned(at: GridPoint, lanes: Iterable[Lane], keep: Container[Lane]) -> tuple[Lane, ...]:
    """Return lanes in such directions that the ways between them are shortest, from a place on.

    Lanes in `keep` keep their direction.
    """
    ways: list[tuple[float, tuple[Lane, ...]]] = [(0.0, ())]
    for lane in lanes:
        ways = [
            min(
                (
                    (way_m + (done[-1][1] if done else at).distance_to(each[0]), (*done, each))
                    for way_m, done in ways
                ),
                key=lambda way: way[0],
            )
            for each in ((lane,) if lane in keep else (lane, (lane[1], lane[0])))
        ]
    return min(ways, key=lambda way: way[0])[1]


def rest_ahead(lane: Lane, at: GridPoint, begin: GridPoint, ahead: GridPoint) -> Lane:
    """Return the rest of a lane from a place on it, in the direction from `begin` to `ahead`.

    >>> ends = GridPoint(0, 0), GridPoint(9, 0)
    >>> rest_ahead(ends, GridPoint(4, 0), GridPoint(8, 1), GridPoint(7, 1))[1]
    GridPoint(east_m=0, north_m=0)
    """
    east_m, north_m = ahead.east_m - begin.east_m, ahead.north_m - begin.north_m
    along = [
        east_m * (end.east_m - at.east_m) + north_m * (end.north_m - at.north_m) for end in lane
    ]
    return (at, lane[0] if along[0] > along[1] else lane[1])


def search_length_m(block: Sequence[Lane], start: GridPoint) -> float:
    """Return the way of a vehicle that searches its block, from `start` and back to it, m."""
    stations = [start, *itertools.chain.from_iterable(block), start]
    return sum(a.distance_to(b) for a, b in itertools.pairwise(stations))


MAX_TIME_FACTOR: Final = 1.02
"""Maximum time of the slowest vehicle, as a multiple of the minimum, if all fly less for it."""

_Way = Callable[[int, int, int], float]


def tour_m(pad: GridPoint, block: Sequence[Lane]) -> tuple[float, tuple[Lane, ...]]:
    """Return the shortest way from a pad along all of a block and back: metres, and lanes as flown.

    The lanes are flown in their order or in the opposite one, by turns to and fro. Of two equally
    long ones, the one that begins nearer to the pad is taken.
    """
    if not block:
        return 0.0, ()
    best: tuple[float, float, tuple[Lane, ...]] | None = None
    for lanes in (tuple(block), tuple(reversed(block))):
        for first in (lanes[0], (lanes[0][1], lanes[0][0])):
            flown = [first]
            for lane in lanes[1:]:
                at = flown[-1][1]
                near = at.distance_to(lane[0]) <= at.distance_to(lane[1])
                flown.append(lane if near else (lane[1], lane[0]))
            way_m, at = 0.0, pad
            for start, end in flown:
                way_m += at.distance_to(start) + start.distance_to(end)
                at = end
            found = round(way_m + at.distance_to(pad), 6), pad.distance_to(first[0]), tuple(flown)
            if best is None or found[:2] < best[:2]:
                best = found
    assert best is not None
    return best[0], best[2]


def share_by_time(lanes: Sequence[Lane], pads: Sequence[GridPoint]) -> Blocks:
    """Return a block of consecutive, adjacent lanes for each vehicle by its pad.

    >>> lanes = [(GridPoint(x, 0), GridPoint(x, 100)) for x in (0, 10, 20)]
    >>> blocks = share_by_time(lanes, [GridPoint(15, 0), GridPoint(5, 0)])
    >>> [len(block) for block in blocks], blocks[1][0][0].east_m
    ([1, 2], 0)
    """
    if not lanes:
        return ((),) * len(pads)
    across = 0 if _spread(lanes, 0) >= _spread(lanes, 1) else 1
    rising = lanes[0][0][across] <= lanes[-1][0][across]
    row = sorted(range(len(pads)), key=lambda k: (pads[k][across] * (1 if rising else -1), k))
    ways_m: dict[tuple[int, int, int], float] = {}

    def way_m(k: int, first: int, end: int) -> float:
        key = (k, first, end)
        if key not in ways_m:
            ways_m[key] = tour_m(pads[row[k]], lanes[first:end])[0]
        return ways_m[key]

    most_m = _least_longest_m(len(row), len(lanes), way_m)
    cuts = _least_together(len(row), len(lanes), most_m * MAX_TIME_FACTOR, way_m)
    blocks: list[tuple[Lane, ...]] = [()] * len(pads)
    for k, (first, end) in enumerate(zip([0, *cuts], cuts, strict=False)):
        blocks[row[k]] = tour_m(pads[row[k]], lanes[first:end])[1]
    return tuple(blocks)


def longest_m(blocks: Blocks, pads: Sequence[GridPoint]) -> float:
    """Return the length of the longest tour, m."""
    return max(tour_m(pad, block)[0] for pad, block in zip(pads, blocks, strict=True))


def _spread(lanes: Sequence[Lane], axis: int) -> float:
    places = [lane[0][axis] + lane[1][axis] for lane in lanes]
    return max(places) - min(places)


def _least_longest_m(vehicles: int, lanes: int, way_m: _Way) -> float:
    """Return the minimum length of the longest tour, m."""
    least_m = [0.0] + [math.inf] * lanes
    for k in range(vehicles):
        found_m = []
        for end in range(lanes + 1):
            most_m = least_m[end]
            for first in range(end - 1, -1, -1):
                mine_m = way_m(k, first, end)
                if mine_m >= most_m:  # more lanes take longer still
                    break
                most_m = min(most_m, max(least_m[first], mine_m))
            found_m.append(most_m)
        least_m = found_m
    return least_m[lanes]


def _least_together(vehicles: int, lanes: int, most_m: float, way_m: _Way) -> list[int]:
    """Return the ends of each vehicle's block, so that all fly least, none more than `most_m`."""
    least: list[tuple[float, list[int]]] = [(0.0, [])]
    least += [(math.inf, [])] * lanes
    for k in range(vehicles):
        rows = []
        for end in range(lanes + 1):
            found: tuple[float, list[int]] = (math.inf, [])
            for first in range(end, -1, -1):
                way = way_m(k, first, end) if end > first else 0.0
                if way > most_m:
                    break
                if least[first][0] + way < found[0]:
                    found = (least[first][0] + way, [*least[first][1], end])
            rows.append(found)
        least = rows
    return least[lanes][1]
