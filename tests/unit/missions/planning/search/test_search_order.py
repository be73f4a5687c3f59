"""Lanes in the order that shows the region soonest, by hand and against all orders there are."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.flight.setting_of import setting_of
from missions.flight.state import Setting
from missions.geo.fence import Fence
from missions.geo.grid import Grid
from missions.mission.checks import parse_mission
from missions.planning.search.lanes import lanes
from missions.planning.search.prior import LikelyLane, Spot, likely_lanes
from missions.planning.search.search_order import (
    EXACT_LANES,
    Block,
    Pace,
    expected_s,
    plain_blocks,
    soonest,
)
from missions.units import GridPoint
from tests.support.small_missions import CELL_M, START, mission_text, square
from uavmap.runner.preflight.plan_figures import first_sighting_s

HOME = GridPoint(0.0, 0.0)
PACE = Pace(5.0, 2.0)


def lane(north_m: float, probability: float, middle_m: float = 20.0) -> LikelyLane:
    return LikelyLane((GridPoint(0, north_m), GridPoint(40, north_m)), probability, middle_m)


def field(prior: tuple[float, float] | None, vehicles: int = 1, north_m: float = 60.0) -> Setting:
    """Return the setting of a box from 10 m to `north_m`; the prior is a point in metres."""
    text = mission_text(
        square(0, 10, 130, north_m),
        square(-60, -60, 260, 400),
        vehicles=vehicles,
        capacity_wh=90.0,
    )
    if prior is not None:
        place = Grid.at(START, CELL_M).position(GridPoint(*prior))
        text = text.replace(
            "[search]",
            f"[search]\nprior = [{{position = [{place.lat_deg}, {place.lon_deg}], spread_m = 8}}]",
        )
    return setting_of(parse_mission(text, "field.toml"))


# --- by hand ---------------------------------------------------------------------------------
def test_the_expected_time_of_two_lanes_by_hand():
    """It takes 8 s to the middle of the first lane; then 22 s to that of the next."""
    blocks = [(lane(0.0, 0.25), lane(15.0, 0.75).turned)]
    first_s = 0 / 5 + 2 + 20 / 5
    second_s = 2 + (40 / 5 + 2) + (15 / 5 + 2) + 20 / 5
    expected = 0.25 * first_s + 0.75 * second_s
    assert expected_s(blocks, [HOME], PACE) == pytest.approx(expected)


def test_a_lane_is_flown_from_the_end_that_is_likelier():
    ((flown,),) = soonest([lane(0.0, 1.0, 36.0)], [GridPoint(20.0, 0.0)], PACE)
    assert flown.lane[0].east_m == 40.0


@pytest.mark.parametrize("vehicles", [1, 2])
def test_search_order_is_the_best_of_all_orders(vehicles):
    likely = [lane(12.0 * i, p, m) for i, (p, m) in enumerate(((0.1, 5), (0.5, 33), (0.4, 20)))]
    homes = [HOME, GridPoint(60.0, 0.0)][:vehicles]
    every: list[list[Block]] = []
    for order in itertools.permutations(likely):
        for turned in itertools.product((False, True), repeat=3):
            flown = [part.turned if t else part for part, t in zip(order, turned, strict=True)]
            cuts = range(4) if vehicles == 2 else (3,)
            every.extend([tuple(flown[:c]), tuple(flown[c:])][:vehicles] for c in cuts)
    best_s = min(expected_s(blocks, homes, PACE) for blocks in every)
    assert expected_s(soonest(likely, homes, PACE), homes, PACE) == pytest.approx(best_s)


# --- in a mission ----------------------------------------------------------------------------
@pytest.mark.parametrize("north_m", [60.0, 220.0])
def test_point_in_the_far_corner_is_observed_first(north_m):
    setting = field((126.0, 4.0 + north_m), north_m=north_m)
    few = len(setting.lanes) <= EXACT_LANES
    assert few is (north_m == 60.0)  # the exact order, and the local search
    first = setting.initial_state().vehicles[1].lanes[0]
    far = GridPoint(126.0, 4.0 + north_m)
    assert min(point.distance_to(far) for point in first) < 16.0
    plain = setting.lanes[0]
    assert min(point.distance_to(far) for point in plain) > north_m / 2 - 16.0


def test_first_sighting_is_compared_with_that_in_plain_order():
    found = first_sighting_s(field((96.0, 64.0)))
    assert found is not None
    soon_s, late_s = found
    assert 20.0 < soon_s < 0.5 * late_s


def test_two_vehicles_see_the_region_sooner_than_one():
    one, two = (first_sighting_s(field((50.0, 64.0), vehicles)) for vehicles in (1, 2))
    assert one is not None
    assert two is not None
    assert two[0] < one[0]


def test_lanes_without_a_prior_are_shared_out_as_they_lie():
    setting = field(None, vehicles=2)
    assert tuple(lane for block in setting.shares for lane in block) == setting.lanes


def test_plain_blocks_are_those_of_a_search_without_a_prior():
    setting, plain = field((96.0, 64.0), 3), field(None, 3)
    blocks = plain_blocks(setting.likely, 3)
    assert tuple(tuple(part.lane for part in block) for block in blocks) == plain.shares


# --- whatever the box, the prior and the team ------------------------------------------------
OPEN = Fence.from_rings(
    [GridPoint(*xy) for xy in ((-1e3, -1e3), (1e3, -1e3), (1e3, 1e3), (-1e3, 1e3))], [], 0.0
)


@settings(max_examples=60, deadline=None)
@given(
    width_m=st.floats(20, 240),
    depth_m=st.floats(20, 240),
    spots=st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1), st.floats(2, 60)), min_size=1,
                   max_size=3),
    homes=st.lists(st.tuples(st.floats(-60, 60), st.floats(-60, 60)), min_size=1, max_size=4),
    pause_s=st.floats(0, 4),
)  # fmt: skip
def test_the_order_is_never_worse_and_the_lanes_are_the_same(
    width_m, depth_m, spots, homes, pause_s
):
    corners = ((0.0, 0.0), (width_m, 0.0), (width_m, depth_m), (0.0, depth_m))
    box = [GridPoint(*xy) for xy in corners]
    flown = lanes(box, 4.0, OPEN)
    prior = [Spot(GridPoint(e * width_m, n * depth_m), spread_m) for e, n, spread_m in spots]
    likely = likely_lanes(flown, box, prior, 4.0, 3)
    assert abs(sum(lane.probability for lane in likely) - 1.0) < 1e-9
    assert all(0.0 <= lane.middle_m <= lane.length_m + 1e-9 for lane in likely)
    pads, pace = [GridPoint(*xy) for xy in homes], Pace(6.0, pause_s)
    found = soonest(likely, pads, pace)
    assert len(found) == len(pads)
    assert expected_s(found, pads, pace) <= expected_s(plain_blocks(likely, len(pads)), pads, pace)
    ways = [frozenset(part.lane) for block in found for part in block]
    assert len(ways) == len(flown)
    assert set(ways) == {frozenset(lane) for lane in flown}
