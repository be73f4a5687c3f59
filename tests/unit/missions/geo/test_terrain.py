"""The ground as a lattice: heights, relief, and targets that clear what lies between."""

from __future__ import annotations

import math

import numpy as np
import pytest
from shapely.geometry import box

from missions.geo.terrain import FOLLOW_M, Terrain, decoded, encoded, relief_of
from missions.mission.energy import CLIMB_SPEED_M_S
from missions.mission.sections import terrain_in
from missions.units import GridPoint
from tests.support.ground.hills import SIDE_M, STEP_M, hills, lattice, slope


def terrain_of(heights):
    return Terrain(-SIDE_M, -SIDE_M, STEP_M, heights)


def test_one_point_and_many_agree_inside_and_beyond():
    terrain = terrain_of(hills(3, 40.0))
    rng = np.random.default_rng(1)
    east, north = rng.uniform(-1.3 * SIDE_M, 1.3 * SIDE_M, (2, 200))
    each = [terrain.height_m(GridPoint(e, n)) for e, n in zip(east, north, strict=True)]
    assert terrain.at(east, north) == pytest.approx(each)


def test_a_slope_is_found_with_its_relief():
    relief = relief_of(terrain_of(slope(20.0, 90.0)), box(-50.0, -50.0, 50.0, 50.0))
    assert relief.steepest == pytest.approx(0.2)
    assert (relief.lowest_m, relief.highest_m) == pytest.approx((-10.4, 10.4))
    assert relief.highest_m - relief.lowest_m == pytest.approx(20.8)


def test_heights_survive_as_text_to_half_a_centimetre():
    heights = hills(5, 300.0)
    again = decoded(encoded(heights), *heights.shape)
    assert float(np.abs(again - heights).max()) <= 0.005 + 1e-9
    assert len(encoded(heights)) < 3 * heights.size


@pytest.mark.parametrize(
    ("text", "rows"), [("", 2), ("AAAA", 2), ("?", 2), (encoded(np.zeros((2, 2))), 3)]
)
def test_damaged_heights_are_refused(text, rows):
    with pytest.raises(ValueError, match=r"heights"):
        decoded(text, rows, 2)


def test_heights_that_would_unpack_to_too_much_are_refused():
    bomb = encoded(np.zeros((2000, 2000)))
    with pytest.raises(ValueError, match=r"not 2 x 2"):
        decoded(bomb, 2, 2)


@pytest.mark.parametrize("seed", range(12))
def test_vehicle_that_climbs_and_flies_in_any_order_clears_the_ground(seed):
    """On the way to its target a vehicle may be at any height between its own and the target's.

    All of these heights clear the ground, and none is more than `FOLLOW_M` too high."""
    rng = np.random.default_rng(seed)
    terrain = terrain_of(hills(seed, float(rng.uniform(5.0, 60.0)), float(rng.uniform(50, 150))))
    here, end = (GridPoint(*rng.uniform(-150.0, 150.0, 2)) for _ in range(2))
    height_m = terrain.height_m(here)
    for _ in range(400):
        aim, target_m = terrain.next_target(here, end)
        between = terrain.along(here, aim)
        lowest_m = min(height_m, target_m)
        # it is at least as high as the ground where it is: rounding and the lattice remain
        assert float(between.max()) <= max(target_m, lowest_m) + 0.05
        assert target_m - float(between.min()) <= FOLLOW_M + 0.6 * 1.0 + 0.05
        if aim == end:
            break
        # a second later: part of the way flown, at the height of the target by then
        share = rng.uniform(0.2, 1.0)
        here = GridPoint(
            here.east_m + share * (aim.east_m - here.east_m),
            here.north_m + share * (aim.north_m - here.north_m),
        )
        height_m = target_m
    assert aim == end


def test_a_leg_over_a_ridge_is_flown_over_it_and_not_through():
    steps = np.arange(-SIDE_M, SIDE_M + STEP_M / 2, STEP_M)
    ridge = np.tile(20.0 * np.exp(-((steps / 30.0) ** 2)), (len(steps), 1))
    terrain = terrain_of(ridge)
    here, end = GridPoint(-100.0, 0.0), GridPoint(100.0, 0.0)
    tops = []
    while here != end:
        here, target_m = terrain.next_target(here, end)
        tops.append(target_m)
    assert max(tops) == pytest.approx(20.0, abs=0.3)
    assert terrain.ups_and_downs_m([GridPoint(-100.0, 0.0), end]) == pytest.approx(40.0, abs=0.5)
    assert math.isclose(tops[-1], terrain.height_m(end), abs_tol=FOLLOW_M)


@pytest.mark.parametrize(
    ("percent", "flown_m_s"), [(10.0, 5.0), (20.0, 3.15), (30.0, 1.5), (45.0, 1.04)]
)
def test_estimate_over_steep_ground_is_at_least_the_measured_time(percent, flown_m_s):
    """Speeds were measured in the simulators, with the slower of both autopilots."""
    terrain = terrain_in(lattice(slope(percent, 0.0)))
    way = [GridPoint(0.0, 0.0), GridPoint(0.0, 120.0)]
    climbs_m = terrain.ups_and_downs_m(way, 5.0, CLIMB_SPEED_M_S)
    reckoned_s = 120.0 / 5.0 + climbs_m / CLIMB_SPEED_M_S
    assert 120.0 / flown_m_s <= reckoned_s <= 120.0 / flown_m_s * 1.5
