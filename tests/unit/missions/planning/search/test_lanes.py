"""The search by hand: places and order of lanes, and the vehicle of each."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely.geometry import LineString, Point, Polygon
from shapely.ops import unary_union

from missions.geo.fence import Fence
from missions.planning.search.lanes import (
    LANE_CELLS,
    Lane,
    lanes,
    longest_m,
    search_length_m,
    share_by_time,
    share_out,
    tour_m,
    unseen_parts,
)
from missions.units import GridPoint
from tests.unit.missions.geo.test_fence import random_fence

FAST = settings(max_examples=120, deadline=None)


def ring(west: float, south: float, east: float, north: float) -> list[GridPoint]:
    return [GridPoint(*xy) for xy in ((west, south), (east, south), (east, north), (west, north))]


def lane(west: float, north: float, east: float) -> Lane:
    return GridPoint(west, north), GridPoint(east, north)


OPEN = Fence.from_rings(ring(-1000, -1000, 1000, 1000), [], 0.0)


# --- where they lie --------------------------------------------------------------------------
@pytest.mark.parametrize("along", [0, 1])
def test_lanes_lie_three_cells_apart_along_the_longer_side_to_and_fro(along):
    """On the middles of cells."""
    flown = lanes(ring(0, 0, 60, 44) if along == 0 else ring(0, 0, 44, 60), 4.0, OPEN)
    assert [start[1 - along] for start, _ in flown] == [4.0, 16.0, 28.0, 40.0]
    assert all(start[1 - along] == end[1 - along] for start, end in flown)
    assert [end[along] > start[along] for start, end in flown] == [True, False, True, False]
    assert LANE_CELLS == 3


@pytest.mark.parametrize(
    ("north", "rows"),
    [
        (0.0, [0.0]),  # one row of cells
        (4.0, [4.0]),  # two
        (8.0, [4.0]),  # three: one lane judges them all
        (12.0, [4.0, 12.0]),  # four
        (20.0, [4.0, 16.0]),  # six
        (24.0, [4.0, 16.0, 24.0]),  # seven
    ],
)
def test_number_of_rows_gives_the_number_of_lanes(north, rows):
    flown = lanes(ring(0, -0.5, 80, north + 0.5), 4.0, OPEN)
    assert [start.north_m for start, _ in flown] == rows


def test_a_box_narrower_than_a_cell_has_a_lane_through_its_middle():
    (only,) = lanes(ring(0, 1.0, 80, 3.0), 4.0, OPEN)
    assert only == lane(0, 2.0, 80)


def test_a_hollow_box_is_searched_in_pieces():
    """A U: in the upper rows the lane has a gap."""
    corners = [(0, 0), (90, 0), (90, 30), (60, 30), (60, 10), (30, 10), (30, 30), (0, 30)]
    flown = lanes([GridPoint(*xy) for xy in corners], 4.0, OPEN)
    by_row: dict[float, int] = {}
    for start, _ in flown:
        by_row[start.north_m] = by_row.get(start.north_m, 0) + 1
    assert by_row[4.0] == 1
    assert by_row[28.0] == 2


def test_a_slanting_rim_makes_lanes_as_long_as_the_longest_row_they_judge():
    """A triangle: the lane in the middle of three rows is as long as the widest of them."""
    corners = [GridPoint(0, 0), GridPoint(120, 0), GridPoint(0, 60)]
    for start, end in lanes(corners, 4.0, OPEN):
        row = start.north_m
        widest_m = 120 * (1 - max(row - 6.0, 0.0) / 60)
        assert start.distance_to(end) == pytest.approx(widest_m, abs=0.01)


def test_part_that_the_fence_forbids_is_cut_out():
    holed = Fence.from_rings(ring(-50, -50, 150, 150), [ring(40, -20, 60, 30)], 2.0)
    flown = lanes(ring(0, 0, 100, 44), 4.0, holed)
    cut = [(a.east_m, b.east_m) for a, b in flown if a.north_m == 4.0]
    assert cut == [(0.0, 38.0), (62.0, 100.0)]
    whole = [(a.east_m, b.east_m) for a, b in flown if a.north_m == 40.0]
    assert whole == [(100.0, 0.0)]


def test_pieces_of_a_lane_that_is_flown_back_come_in_that_order():
    holed = Fence.from_rings(ring(-50, -50, 150, 150), [ring(40, -20, 60, 130)], 2.0)
    second = [(a.east_m, b.east_m) for a, b in lanes(ring(0, 0, 100, 44), 4.0, holed)
              if a.north_m == 16.0]  # fmt: skip
    assert second == [(100.0, 62.0), (38.0, 0.0)]


def test_pieces_shorter_than_half_a_cell_are_left_out():
    slit = [ring(4, -20, 50, 130), ring(51.9, -20, 100, 130)]
    fence = Fence.from_rings(ring(-50, -50, 150, 150), slit, 0.0)
    flown = lanes(ring(0, 0, 100, 20), 4.0, fence)
    assert all(a.distance_to(b) >= 2.0 for a, b in flown)
    assert all(max(a.east_m, b.east_m) <= 4.0 for a, b in flown)


def test_a_box_in_the_margin_has_no_lane():
    assert lanes(ring(0, 0, 100, 6), 4.0, Fence.from_rings(ring(0, 0, 100, 100), [], 8.0)) == ()


@FAST
@given(st.floats(20, 90), st.floats(20, 90), st.floats(2, 8))
def test_no_two_lanes_judge_more_than_one_row_twice(width, depth, cell_m):
    """The last lane may lie nearer to the one before it; all others are three cells apart."""
    flown = lanes(ring(0, 0, width, depth), cell_m, OPEN)
    along_east = width >= depth
    rows = sorted({(a.north_m if along_east else a.east_m) / cell_m for a, _ in flown})
    gaps = [b - a for a, b in itertools.pairwise(rows)]
    assert all(gap == pytest.approx(3.0) for gap in gaps[:-1])
    assert all(0.99 < gap < 3.01 for gap in gaps)


@FAST
@given(st.integers(30, 120), st.integers(4, 16), st.integers(0, 3))
def test_a_row_or_two_that_are_left_are_not_worth_a_lane(rows_in_box, rows, spare):
    """The last lane judges them; all others judge three rows, and no row is left out."""
    box = ring(0, 0, 500, (rows_in_box - 1) * 2.0)
    plain, flown = (lanes(box, 2.0, OPEN, rows, eastward=True, spare_rows=k) for k in (0, spare))
    left = (rows_in_box - 1) % rows + 1
    fewer = rows_in_box > rows and left <= spare
    assert len(flown) == len(plain) - fewer
    for row in range(rows_in_box):
        near = min(abs(start.north_m / 2.0 - row) for start, _ in flown)
        most = rows + left if fewer and row >= (len(flown) - 1) * rows else rows
        assert near <= (most - 1) / 2 + 1e-9


# --- who flies which -------------------------------------------------------------------------
lengths = st.lists(st.floats(1, 200), min_size=1, max_size=14)


@FAST
@given(lengths, st.integers(1, 6))
def test_blocks_are_consecutive_and_hold_every_lane_once(long_m, vehicles):
    flown = [lane(0, 12.0 * i, length) for i, length in enumerate(long_m)]
    blocks = share_out(flown, vehicles)
    assert len(blocks) == vehicles
    assert [pair for block in blocks for pair in block] == flown


@FAST
@given(lengths, st.integers(1, 6))
def test_no_vehicle_has_much_more_than_a_fair_share(long_m, vehicles):
    flown = [lane(0, 12.0 * i, length) for i, length in enumerate(long_m)]
    for block in share_out(flown, vehicles):
        metres = sum(a.distance_to(b) for a, b in block)
        assert metres <= sum(long_m) / vehicles + max(long_m) + 1e-9


def test_more_vehicles_than_lanes_leave_some_without():
    blocks = share_out([lane(0, 0, 50), lane(0, 12, 50)], 4)
    assert sorted(map(len, blocks)) == [0, 0, 1, 1]


# --- how far ---------------------------------------------------------------------------------
def test_the_length_of_a_search_counts_the_ways_there_between_and_back():
    block = [lane(0, 0, 30), (GridPoint(30, 12), GridPoint(0, 12))]
    home = GridPoint(0, -4)
    assert search_length_m(block, home) == pytest.approx(4 + 30 + 12 + 30 + 16)
    assert search_length_m([], home) == 0.0


# --- shares by time -------------------------------------------------------------------------------
def beside(count: int, apart_m: float, length_m: float) -> list[tuple[GridPoint, GridPoint]]:
    return [(GridPoint(k * apart_m, 0.0), GridPoint(k * apart_m, length_m)) for k in range(count)]


@pytest.mark.parametrize("seed", range(6))
def test_no_other_cuts_have_the_slowest_at_home_sooner(seed):
    rng = np.random.default_rng(seed)
    lanes = beside(7, 40.0, float(rng.uniform(50, 400)))
    pads = sorted(GridPoint(float(x), -5.0) for x in rng.uniform(0, 240, 3))
    blocks = share_by_time(lanes, pads)
    best_m = min(
        longest_m((tuple(lanes[:a]), tuple(lanes[a:b]), tuple(lanes[b:])), pads)
        for a, b in itertools.combinations_with_replacement(range(8), 2)
    )
    assert longest_m(blocks, pads) <= 1.02 * best_m + 1e-6
    flown = {frozenset(lane) for block in blocks for lane in block}
    assert flown == {frozenset(lane) for lane in lanes}


def test_two_lanes_are_flown_out_and_back():
    way_m, flown = tour_m(GridPoint(0.0, 0.0), beside(2, 30.0, 100.0))
    assert way_m == 260.0
    assert [lane[0].north_m for lane in flown] == [0.0, 100.0]


def test_vehicle_in_the_middle_gets_the_lanes_in_the_middle():
    lanes = beside(9, 155.0, 1000.0)
    pads = [GridPoint(x, 0.0) for x in (570.0, 670.0, 595.0, 645.0, 620.0)]
    blocks = share_by_time(lanes, pads)
    assert [len(block) for block in blocks] == [2, 2, 2, 2, 1]
    assert blocks[4][0][0].east_m == 620.0
    assert share_by_time((), pads) == ((),) * 5


# --- what is judged from them -----------------------------------------------------------------
places = st.builds(GridPoint, st.floats(-30, 30), st.floats(-30, 30))


def judged(box: list[GridPoint], cell_m: float) -> None:
    """Check that every cell of the box is under a lane, or beside one across no corner."""
    flown = lanes(box, cell_m, OPEN)
    seen = unary_union([LineString(lane) for lane in flown])
    rows = seen.bounds[2] - seen.bounds[0], seen.bounds[3] - seen.bounds[1]
    inside = Polygon(box).buffer(-1e-6)
    shapely.prepare(inside)
    west, south, east, north = (round(edge / cell_m) for edge in inside.bounds)
    assert max(rows) > 0
    for i, k in itertools.product(range(west, east + 1), range(south, north + 1)):
        centre = Point(i * cell_m, k * cell_m)
        if inside.covers(centre):
            assert seen.distance(centre) <= cell_m + 1e-6


edges = st.floats(6, 60)


@FAST
@given(st.floats(-40, 40), st.floats(-40, 40), edges, edges, st.floats(2, 6))
def test_every_cell_of_the_box_is_judged_from_a_lane(east_m, north_m, width_m, depth_m, cell_m):
    judged(ring(east_m, north_m, east_m + width_m, north_m + depth_m), cell_m)


@FAST
@given(st.floats(0, math.tau), st.floats(20, 60), st.floats(15, 40))
def test_a_turned_box_is_judged_up_to_its_slanting_rim(turn_rad, width_m, depth_m):
    cos, sin = math.cos(turn_rad), math.sin(turn_rad)
    box = [GridPoint(e * cos - n * sin, e * sin + n * cos) for e, n in ring(0, 0, width_m, depth_m)]
    judged(box, 4.0)


def test_a_box_that_is_a_rounding_too_short_loses_no_row():
    judged(ring(0, 0, 40, 39.99999999999999), 1.0)


@pytest.mark.parametrize("seed", range(20))
def test_lanes_stay_inside_the_fence(seed):
    fence, exact = random_fence(seed)
    rng = np.random.default_rng([seed, 3])
    (west, south), (width, depth) = rng.uniform(-40, 0, 2), rng.uniform(20, 60, 2)
    box = ring(float(west), float(south), float(west + width), float(south + depth))
    flown = lanes(box, 4.0, fence)
    for start, end in flown:
        assert fence.allows(start)
        assert fence.allows(end)
        assert exact.covers(LineString([start, end]))
    blocks = share_out(flown, 3) if flown else ()
    assert tuple(itertools.chain.from_iterable(blocks)) == flown


@FAST
@given(places, places, st.lists(st.floats(0, 1), max_size=30))
def test_unseen_part_of_a_lane_lies_on_it_and_has_no_frame_near(start, end, shares):
    length_m = start.distance_to(end)
    assume(length_m > 0.01)
    seen_m = [share * length_m for share in shares]
    line = LineString([start, end])
    stretches = unseen_parts((start, end), seen_m, 4.0)
    for a, b in stretches:
        assert line.distance(Point(a)) < 1e-6
        assert line.distance(Point(b)) < 1e-6
        middle_m = (start.distance_to(a) + start.distance_to(b)) / 2
        assert all(abs(middle_m - place_m) > 4.0 - 1e-6 for place_m in seen_m)
    # places farther than a cell and a half from every frame are in one of them
    for share in np.linspace(0, 1, 21):
        place_m = float(share) * length_m
        if all(abs(place_m - seen) > 6.0 for seen in seen_m) and length_m > 2.0:
            place = line.interpolate(place_m)
            assert any(LineString(stretch).distance(place) < 1e-6 for stretch in stretches)


def test_a_lane_with_a_frame_over_each_cell_is_seen():
    lane = (GridPoint(0, 0), GridPoint(40, 0))
    assert unseen_parts(lane, [4.0 * i for i in range(11)], 4.0) == ()
    assert unseen_parts(lane, [4.0 * i for i in range(11) if i != 5], 4.0) == ()  # one is lost
    two_lost = [4.0 * i for i in range(11) if i not in (5, 6)]
    assert unseen_parts(lane, two_lost, 4.0) == ((GridPoint(20, 0), GridPoint(24, 0)),)
    assert unseen_parts(lane, [], 4.0) == (lane,)
