"""The search by hand: where lanes lie, in which order they are flown, and who flies which."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.geo.fence import Fence
from missions.planning.search.lanes import LANE_CELLS, Lane, lanes, search_length_m, share_out
from missions.units import GridPoint

FAST = settings(max_examples=120, deadline=None)


def ring(west: float, south: float, east: float, north: float) -> list[GridPoint]:
    return [GridPoint(*xy) for xy in ((west, south), (east, south), (east, north), (west, north))]


def lane(west: float, north: float, east: float) -> Lane:
    return GridPoint(west, north), GridPoint(east, north)


OPEN = Fence.of(ring(-1000, -1000, 1000, 1000), [], 0.0)


# --- where they lie --------------------------------------------------------------------------
def test_lanes_lie_three_cells_apart_on_the_middles_of_cells() -> None:
    flown = lanes(ring(0, 0, 60, 44), 4.0, OPEN)
    assert [start.north_m for start, _ in flown] == [4.0, 16.0, 28.0, 40.0]
    assert all(start.north_m == end.north_m for start, end in flown)
    assert LANE_CELLS == 3


def test_lanes_run_along_the_longer_side() -> None:
    along_north = lanes(ring(0, 0, 44, 60), 4.0, OPEN)
    assert [start.east_m for start, _ in along_north] == [4.0, 16.0, 28.0, 40.0]
    assert all(start.east_m == end.east_m for start, end in along_north)


def test_every_second_lane_is_flown_the_other_way() -> None:
    flown = lanes(ring(0, 0, 60, 44), 4.0, OPEN)
    directions = [end.east_m > start.east_m for start, end in flown]
    assert directions == [True, False, True, False]


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
def test_so_many_rows_of_cells_need_so_many_lanes(north: float, rows: list[float]) -> None:
    flown = lanes(ring(0, -0.5, 80, north + 0.5), 4.0, OPEN)
    assert [start.north_m for start, _ in flown] == rows


def test_a_box_narrower_than_a_cell_has_a_lane_through_its_middle() -> None:
    (only,) = lanes(ring(0, 1.0, 80, 3.0), 4.0, OPEN)
    assert only == lane(0, 2.0, 80)


def test_a_hollow_box_is_searched_in_pieces() -> None:
    """A U: in the upper rows the lane has a gap."""
    corners = [(0, 0), (90, 0), (90, 30), (60, 30), (60, 10), (30, 10), (30, 30), (0, 30)]
    flown = lanes([GridPoint(*xy) for xy in corners], 4.0, OPEN)
    by_row: dict[float, int] = {}
    for start, _ in flown:
        by_row[start.north_m] = by_row.get(start.north_m, 0) + 1
    assert by_row[4.0] == 1
    assert by_row[28.0] == 2


def test_a_slanting_rim_makes_lanes_as_long_as_the_longest_row_they_judge() -> None:
    """A triangle: the lane in the middle of three rows is as long as the widest of them."""
    corners = [GridPoint(0, 0), GridPoint(120, 0), GridPoint(0, 60)]
    for start, end in lanes(corners, 4.0, OPEN):
        row = start.north_m
        widest_m = 120 * (1 - max(row - 6.0, 0.0) / 60)
        assert start.distance_to(end) == pytest.approx(widest_m, abs=0.01)


def test_what_the_fence_forbids_is_cut_out() -> None:
    holed = Fence.of(ring(-50, -50, 150, 150), [ring(40, -20, 60, 30)], 2.0)
    flown = lanes(ring(0, 0, 100, 44), 4.0, holed)
    cut = [(a.east_m, b.east_m) for a, b in flown if a.north_m == 4.0]
    assert cut == [(0.0, 38.0), (62.0, 100.0)]
    whole = [(a.east_m, b.east_m) for a, b in flown if a.north_m == 40.0]
    assert whole == [(100.0, 0.0)]


def test_pieces_of_a_lane_that_is_flown_back_come_in_that_order() -> None:
    holed = Fence.of(ring(-50, -50, 150, 150), [ring(40, -20, 60, 130)], 2.0)
    second = [(a.east_m, b.east_m) for a, b in lanes(ring(0, 0, 100, 44), 4.0, holed)
              if a.north_m == 16.0]  # fmt: skip
    assert second == [(100.0, 62.0), (38.0, 0.0)]


def test_pieces_shorter_than_half_a_cell_are_left_out() -> None:
    slit = [ring(4, -20, 50, 130), ring(51.9, -20, 100, 130)]
    fence = Fence.of(ring(-50, -50, 150, 150), slit, 0.0)
    flown = lanes(ring(0, 0, 100, 20), 4.0, fence)
    assert all(a.distance_to(b) >= 2.0 for a, b in flown)
    assert all(max(a.east_m, b.east_m) <= 4.0 for a, b in flown)


def test_a_box_in_the_margin_has_no_lane() -> None:
    assert lanes(ring(0, 0, 100, 6), 4.0, Fence.of(ring(0, 0, 100, 100), [], 8.0)) == ()


@FAST
@given(st.floats(20, 90), st.floats(20, 90), st.floats(2, 8))
def test_no_two_lanes_judge_more_than_one_row_twice(
    width: float, depth: float, cell_m: float
) -> None:
    """The last lane may lie nearer to the one before it; all others are three cells apart."""
    flown = lanes(ring(0, 0, width, depth), cell_m, OPEN)
    along_east = width >= depth
    rows = sorted({(a.north_m if along_east else a.east_m) / cell_m for a, _ in flown})
    gaps = [b - a for a, b in itertools.pairwise(rows)]
    assert all(gap == pytest.approx(3.0) for gap in gaps[:-1])
    assert all(0.99 < gap < 3.01 for gap in gaps)


@FAST
@given(st.integers(30, 120), st.integers(4, 16), st.integers(0, 3))
def test_a_row_or_two_that_are_left_are_not_worth_a_lane(
    rows_in_box: int, rows: int, spare: int
) -> None:
    """The last lane takes them; all others judge as many as ever, and none is left out."""
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
def test_blocks_are_consecutive_and_hold_every_lane_once(
    long_m: list[float], vehicles: int
) -> None:
    flown = [lane(0, 12.0 * i, length) for i, length in enumerate(long_m)]
    blocks = share_out(flown, vehicles)
    assert len(blocks) == vehicles
    assert [pair for block in blocks for pair in block] == flown


@FAST
@given(lengths, st.integers(1, 6))
def test_nobody_has_much_more_than_a_fair_share(long_m: list[float], vehicles: int) -> None:
    flown = [lane(0, 12.0 * i, length) for i, length in enumerate(long_m)]
    for block in share_out(flown, vehicles):
        metres = sum(a.distance_to(b) for a, b in block)
        assert metres <= sum(long_m) / vehicles + max(long_m) + 1e-9


def test_more_vehicles_than_lanes_leave_some_without() -> None:
    blocks = share_out([lane(0, 0, 50), lane(0, 12, 50)], 4)
    assert sorted(map(len, blocks)) == [0, 0, 1, 1]


# --- how far ---------------------------------------------------------------------------------
def test_the_length_of_a_search_counts_the_ways_there_between_and_back() -> None:
    block = [lane(0, 0, 30), (GridPoint(30, 12), GridPoint(0, 12))]
    home = GridPoint(0, -4)
    assert search_length_m(block, home) == pytest.approx(4 + 30 + 12 + 30 + 16)
    assert search_length_m([], home) == 0.0
