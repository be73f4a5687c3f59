"""Lanes shared out among vehicles by the time that they take, from the pad and back to it.

Vehicles that stand in a row get lanes in that order, so no two of them cross each other's way. A
block of lanes is flown out on one lane and back on the next. Of all such shares one is taken whose
slowest vehicle is soonest at home, and of these one with the least flight of all together: who is
done early maps meanwhile.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

from missions.planning.search.lanes import Lane
from missions.units import GridPoint

AS_SOON: Final = 1.02
"""So much later than the least possible the slowest one may be at home, if all fly less."""

Blocks = tuple[tuple[Lane, ...], ...]
_Way = Callable[[int, int, int], float]


def tour_m(pad: GridPoint, block: Sequence[Lane]) -> tuple[float, tuple[Lane, ...]]:
    """The shortest way from a pad along all of a block and back: metres, and lanes as flown.

    The lanes are flown in their order or in the opposite one, by turns to and fro. Where two are
    equally long, the one is taken that begins nearer to the pad.

    >>> lanes = [(GridPoint(x, 0), GridPoint(x, 100)) for x in (50, 60)]
    >>> tour_m(GridPoint(70, 0), lanes)[0]
    240.0
    >>> tour_m(GridPoint(70, 0), lanes)[1][0]
    (GridPoint(east_m=60, north_m=0), GridPoint(east_m=60, north_m=100))
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
    """A block of consecutive lanes for each vehicle, by the place of its pad.

    Args:
        lanes: In the order in which they lie beside one another.
        pads: Of each vehicle; the blocks come in their order.

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
    cuts = _least_together(len(row), len(lanes), most_m * AS_SOON, way_m)
    blocks: list[tuple[Lane, ...]] = [()] * len(pads)
    for k, (first, end) in enumerate(zip([0, *cuts], cuts, strict=False)):
        blocks[row[k]] = tour_m(pads[row[k]], lanes[first:end])[1]
    return tuple(blocks)


def longest_m(blocks: Blocks, pads: Sequence[GridPoint]) -> float:
    """How far the one flies who flies farthest."""
    return max(tour_m(pad, block)[0] for pad, block in zip(pads, blocks, strict=True))


def _spread(lanes: Sequence[Lane], axis: int) -> float:
    places = [lane[0][axis] + lane[1][axis] for lane in lanes]
    return max(places) - min(places)


def _least_longest_m(vehicles: int, lanes: int, way_m: _Way) -> float:
    """How far the one flies who flies farthest, at best."""
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
    """Where each vehicle's block ends, so that together they fly least, none more than `most_m`."""
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
