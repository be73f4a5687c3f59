"""Paths without a halt: continuous, within their limits, through every leg, at rest in the end."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from missions.geo.braking import Course
from missions.geo.trajectory import ACCELERATION_M_S2, Trajectory, rounded_path
from missions.units import GridPoint

STEP_S = 0.02

points = st.lists(
    st.tuples(st.integers(-15, 15), st.integers(-15, 15)).map(
        lambda cell: GridPoint(4.0 * cell[0], 4.0 * cell[1])
    ),
    min_size=1,
    max_size=12,
)
drifts = st.sampled_from([(0.0, 0.0), (0.4, -0.3)])


def times(plan: Trajectory) -> list[float]:
    count = math.ceil((plan.end_s - plan.begin_s) / STEP_S)
    return [plan.begin_s + STEP_S * i for i in range(count + 1)]


@settings(max_examples=60, deadline=None)
@given(points, st.sampled_from([1.0, 6.0, 10.0]), st.sampled_from([0.3, 1.0, 2.5]), drifts)
def test_a_path_is_continuous_and_keeps_its_limits(corners, speed_m_s, cut_m, drift):
    plan = rounded_path(corners, 7.0, speed_m_s=speed_m_s, cut_m=cut_m, drift_m_s=drift)
    for a_s, b_s in itertools.pairwise(times(plan)):
        a, b = plan.at(a_s), plan.at(b_s)
        assert plan.place_at(a_s) == a.place
        # the mean velocity lies between those at both ends, but for the curvature
        for moved, first, last in (
            (b.east_m - a.east_m, a.v_east_m_s, b.v_east_m_s),
            (b.north_m - a.north_m, a.v_north_m_s, b.v_north_m_s),
        ):
            assert abs(moved / STEP_S - (first + last) / 2) <= 2.0 * ACCELERATION_M_S2 * STEP_S
        assert math.dist(a[2:4], b[2:4]) <= (ACCELERATION_M_S2 + 1e-6) * STEP_S
        assert math.hypot(a.v_east_m_s - drift[0], a.v_north_m_s - drift[1]) <= speed_m_s + 1e-6
        assert math.hypot(*a[4:]) <= ACCELERATION_M_S2 + 1e-6
    first, last = plan.at(plan.begin_s - 5.0), plan.at(plan.end_s + 3.0)
    assert plan.place_at(plan.begin_s - 5.0) == first.place
    assert plan.place_at(plan.end_s + 3.0) == last.place
    begin = (corners[0].east_m + 7.0 * drift[0], corners[0].north_m + 7.0 * drift[1])
    assert first.place == pytest.approx(begin)
    later_s = plan.end_s + 3.0
    end = (corners[-1].east_m + later_s * drift[0], corners[-1].north_m + later_s * drift[1])
    assert last.place == pytest.approx(end)
    assert last[2:] == pytest.approx((*drift, 0.0, 0.0))


@settings(max_examples=40, deadline=None)
@given(points, st.sampled_from([1.0, 2.5]))
def test_every_corner_is_passed_at_no_more_than_the_cut(corners, cut_m):
    plan = rounded_path(corners, 0.0, speed_m_s=6.0, cut_m=cut_m)
    way = [plan.at(t_s).place for t_s in times(plan)]
    for corner in corners:
        assert min(corner.distance_to(place) for place in way) <= cut_m + 6.0 * STEP_S


def test_leg_from_rest_to_rest_takes_the_measured_time_but_for_the_jerk():
    """A real ArduCopter at 6 m/s: 12 m 5.4 s, 30 m 9.6 s, 60 m 14.8 s, with 1.3 s for the end."""
    for way_m, measured_s in ((12.0, 5.4), (30.0, 9.6), (60.0, 14.8)):
        plan = rounded_path([GridPoint(0, 0), GridPoint(0, way_m)], 0.0, speed_m_s=6.0)
        assert plan.end_s + 1.3 == pytest.approx(measured_s, abs=1.0)


@settings(max_examples=40, deadline=None)
@given(points, st.floats(0.1, 0.9), st.sampled_from([0.0, 0.5]))
def test_a_plan_that_begins_on_the_way_goes_on_without_a_jump(corners, share, notice_s):
    first = rounded_path(corners, 0.0, speed_m_s=6.0)
    begin_s = share * first.end_s
    assume(begin_s > 0.5)
    here = first.at(begin_s)
    speed_m_s = math.hypot(here.v_east_m_s, here.v_north_m_s)
    heading = math.atan2(here.v_north_m_s, here.v_east_m_s)
    ahead = GridPoint(
        here.east_m + 20.0 * math.cos(heading), here.north_m + 20.0 * math.sin(heading)
    )
    second = rounded_path(
        [here.place, ahead, GridPoint(0, 0)], begin_s, speed_m_s=6.0, begin_speed_m_s=speed_m_s
    )
    course = Course((first,)).then(second, begin_s - notice_s)
    assert course.end_s == second.end_s
    before, after = course.at(begin_s - 1e-6), course.at(begin_s)
    assert before[:4] == pytest.approx(after[:4], abs=1e-4)
    assert course.at(begin_s - 0.3) == first.at(begin_s - 0.3)


def test_course_drops_parts_that_are_over_or_replaced():
    def plan(begin_s: float) -> Trajectory:
        return rounded_path([GridPoint(0, 0), GridPoint(90, 0)], begin_s, speed_m_s=6.0)

    course = Course((plan(0.0),)).then(plan(5.0), 4.0).then(plan(6.0), 4.5).then(plan(5.5), 4.6)
    assert [part.begin_s for part in course.parts] == [0.0, 5.0, 5.5]
    course = course.then(plan(20.0), 19.0)
    assert [part.begin_s for part in course.parts] == [5.5, 20.0]
    assert [part.begin_s for part in course.then(plan(3.0), 19.0).parts] == [3.0]


@pytest.mark.parametrize(
    ("corners", "how"),
    [
        ([], {}),
        ([GridPoint(math.nan, 0.0)], {}),
        ([GridPoint(0, 0)], {"speed_m_s": 0.0}),
        ([GridPoint(0, 0)], {"cut_m": -1.0}),
        ([GridPoint(0, 0), GridPoint(5, 0)], {"begin_speed_m_s": 6.0}),  # needs 9 m to stop
        ([GridPoint(0, 0), GridPoint(50, 0)], {"begin_speed_m_s": 7.0}),
    ],
)
def test_path_that_cannot_be_flown_is_refused(corners, how):
    with pytest.raises(ValueError, match=r"path|positive"):
        rounded_path(corners, 0.0, **{"speed_m_s": 6.0, **how})  # type: ignore[arg-type]
