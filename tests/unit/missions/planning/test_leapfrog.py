"""One vehicle maps while the other hovers and tracks it: the plan, and the position errors."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import LineString

from missions.lab.cooperation.leapfrog_errors import LeapfrogNoise, compare, fly_leapfrog
from missions.planning.leapfrog_geometry import Role, TrackerView, plan_leapfrog

VIEW = TrackerView(above_m=12.0)
STRAIGHT = ((0.0, 0.0), (200.0, 0.0))

coordinates = st.integers(-300, 300).map(lambda n: n / 10.0)
paths = st.lists(st.tuples(coordinates, coordinates), min_size=2, max_size=7).filter(
    lambda places: LineString(places).length > 0.1
)


def test_a_straight_path_takes_hops_as_long_as_the_circle_is_wide():
    plan = plan_leapfrog(STRAIGHT, VIEW)
    assert plan.hops == math.ceil(200.0 / (2.0 * VIEW.reach_m))
    hops = [step for step in plan.steps if step.mover is Role.MAPPER]
    assert [step.length_m for step in hops[:-1]] == pytest.approx(
        [2.0 * VIEW.reach_m] * (plan.hops - 1)
    )
    assert plan.length_m(Role.MAPPER) == pytest.approx(200.0)


@settings(max_examples=12, deadline=None)
@given(paths)
def test_mapper_never_leaves_the_picture_and_the_path_is_flown(path):
    plan = plan_leapfrog(path, VIEW)
    places = {Role.MAPPER: path[0], Role.TRACKER: path[0]}
    for step in plan.steps:
        other = next(role for role in Role if role is not step.mover)
        assert step.start == pytest.approx(places[step.mover], abs=1e-6)
        assert step.hovering == pytest.approx(places[other], abs=1e-6)
        # the path is straight between its places, so its ends are the farthest
        assert max(math.dist(p, step.hovering) for p in step.path) <= VIEW.reach_m + 1e-6
        places[step.mover] = step.end
    flown = [p for step in plan.steps if step.mover is Role.MAPPER for p in step.path]
    assert sum(map(math.dist, flown, flown[1:])) == pytest.approx(LineString(path).length)
    assert LineString(flown).hausdorff_distance(LineString(path)) < 1e-6
    assert all(a.mover is not b.mover for a, b in pairwise(plan.steps) if a.mover is Role.TRACKER)


def test_path_that_cannot_be_flown_or_seen_is_refused():
    with pytest.raises(ValueError, match=r"at least separation_m = 5 m higher"):
        TrackerView(above_m=4.0, separation_m=5.0)
    with pytest.raises(ValueError, match="fly higher, or take a wider angle"):
        TrackerView(hfov_rad=math.radians(10.0), vfov_rad=math.radians(8.0))
    with pytest.raises(ValueError, match="no length"):
        plan_leapfrog([(1.0, 1.0), (1.0, 1.0)], VIEW)
    with pytest.raises(ValueError, match="two places"):
        plan_leapfrog([(1.0, 1.0)], VIEW)


@pytest.mark.parametrize("above_m", [10.0, 12.0])
def test_map_errs_by_a_fifth_of_dead_reckoning(above_m):
    """Odometry errs by 2 % of the distance, a gyro by 0.3 deg after a metre, without a compass."""
    plan = plan_leapfrog(STRAIGHT, TrackerView(above_m=above_m))
    found = compare(plan, LeapfrogNoise.of_tracker(above_m), seeds=range(40))
    assert found.times_better > 5.0
    assert 0.3 < found.tracked_m < 1.3
    # by hand: 2 % along, and the root of L^3 / 3 for the gyro, at the end of 200 m
    end_m = math.hypot(0.02 * 200.0, math.radians(0.3) * math.sqrt(200.0**3 / 3.0))
    assert found.alone_m == pytest.approx(0.55 * end_m, rel=0.25)


def test_estimated_errors_are_honest():
    """NEES of a place is 2; 99.9 % of means of 150 runs lie between these limits."""
    bent = plan_leapfrog([(0.0, 0.0), (40.0, 0.0), (40.0, 15.0), (0.0, 15.0)], VIEW)
    found = compare(bent, LeapfrogNoise.of_tracker(12.0), seeds=range(150))
    assert 1.5 < found.tracked_nees < 2.6
    assert 1.5 < found.alone_nees < 2.6


def test_error_grows_with_the_root_of_the_hops():
    plan = plan_leapfrog(STRAIGHT, VIEW)
    still = LeapfrogNoise(place_m=0.1, yaw_rad=1e-6, hover_m=0.0, hover_rad=0.0)
    tracked, _ = fly_leapfrog(plan, still, seed=1)
    # with headings known, each hop adds two sightings to both axes: a root, not a line
    hops = np.arange(1, plan.hops + 1)
    bound = 0.1 * np.sqrt(2.0 * 2.0 * hops)
    assert (tracked.sigmas_m <= bound).all()
    assert tracked.sigmas_m[-1] > 0.5 * bound[-1]
    quarter = tracked.sigmas_m[plan.hops // 4 - 1]
    assert tracked.sigmas_m[-1] / quarter < 1.1 * math.sqrt(plan.hops / (plan.hops // 4))
    assert tracked.nees.shape == tracked.sigmas_m.shape == (plan.hops,)
