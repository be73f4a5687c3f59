"""The cost of a leg over a drifting ROI, compared with a robot that flies small steps."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from missions.planning.stepwise.interface import Metric
from missions.planning.stepwise.rdfs import drift_factor
from missions.units import Cell

FAST = settings(max_examples=200, deadline=None)

cells = st.builds(Cell, st.integers(-20, 20), st.integers(-20, 20))
metrics = st.builds(
    lambda speed, share, toward: Metric(
        speed, speed * share * math.sin(toward), speed * share * math.cos(toward)
    ),
    st.floats(0.2, 10), st.floats(0, 0.95), st.floats(0, math.tau),
)  # fmt: skip


def flown(metric: Metric, start: Cell, end: Cell) -> float:
    """Return the time at which a robot meets a drifting cell in straight flight.

    Bisect the time, from speeds over ground alone.
    """

    def is_there(t: float) -> bool:
        east = end.east - start.east + metric.drift_east * t
        north = end.north - start.north + metric.drift_north * t
        return math.hypot(east, north) <= metric.speed * t

    low, high = 0.0, 1.0
    while not is_there(high):
        high *= 2
    for _ in range(80):
        middle = (low + high) / 2
        low, high = (low, middle) if is_there(middle) else (middle, high)
    return high


@FAST
@given(metrics, cells, cells)
def test_a_leg_is_as_long_as_it_is_flown(metric, start, end):
    assert metric.leg(start, end) == pytest.approx(flown(metric, start, end), rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(
    ("towards", "cost"), [(Cell(1, 0), 1 / 0.4), (Cell(-1, 0), 1 / 1.6), (Cell(0, 1), 1 / 0.8)]
)
def test_costs_along_the_axes_are_those_of_the_paper(towards, cost):
    """Flight with the drift follows the ROI, flight against it meets the ROI."""
    assert Metric(1.0, drift_east=0.6).leg(Cell(0, 0), towards) == pytest.approx(cost)


@FAST
@given(metrics, cells, cells, cells)
def test_a_detour_never_saves_time(metric, a, b, c):
    assert metric.leg(a, c) <= metric.leg(a, b) + metric.leg(b, c) + 1e-9
    assert metric.tour_leg(a, c) <= metric.tour_leg(a, b) + metric.tour_leg(b, c) + 1e-9


@FAST
@given(metrics, st.lists(cells, min_size=2, max_size=7))
def test_cost_of_a_closed_tour_is_that_of_the_symmetric_part(metric, stops):
    tour = list(itertools.pairwise([*stops, stops[0]]))
    whole = sum(metric.leg(a, b) for a, b in tour)
    assert sum(metric.tour_leg(a, b) for a, b in tour) == pytest.approx(whole, abs=1e-9)
    backwards = sum(metric.leg(b, a) for a, b in tour)
    assert backwards == pytest.approx(whole, abs=1e-9)


@FAST
@given(metrics, cells, cells)
def test_a_closed_tour_costs_between_least_and_most_per_length(metric, a, b):
    length = math.dist(a, b)
    assert metric.least_per_length * length <= metric.tour_leg(a, b) + 1e-9
    assert metric.tour_leg(a, b) <= metric.most_per_length * length + 1e-9


@FAST
@given(metrics, st.integers(1, 30))
def test_the_limits_per_length_are_reached_across_and_along(metric, length):
    """Therefore no better bound than these holds for all directions."""
    assume(metric.drift_speed > 0.01)
    turned = Metric(metric.speed, drift_east=metric.drift_speed)
    across = turned.tour_leg(Cell(0, 0), Cell(0, length))
    along = turned.tour_leg(Cell(0, 0), Cell(length, 0))
    assert across == pytest.approx(turned.least_per_length * length)
    assert along == pytest.approx(turned.most_per_length * length)


@FAST
@given(st.floats(0.5, 10), st.floats(0, 0.95))
def test_the_drift_factor_is_the_most_per_length_beside_the_resting_one(speed, share):
    metric = Metric(speed, drift_north=speed * share)
    factor = drift_factor(speed, speed * share)
    assert metric.most_per_length * speed == pytest.approx(factor)
    assert factor >= 1.0


@pytest.mark.parametrize(
    ("speed", "east", "north"), [(1.0, 1.0, 0.0), (1.0, 0.8, 0.7), (0.0, 0.0, 0.0), (2.0, 0, -3)]
)
def test_a_robot_must_keep_up_with_the_drift(speed, east, north):
    with pytest.raises(ValueError, match="cannot keep up"):
        Metric(speed, east, north)


# --- from rest to rest -----------------------------------------------------------------------
@pytest.mark.parametrize("speed", [1.0, 5.0])
@pytest.mark.parametrize("distance", np.linspace(0.1, 30.0, 12))
def test_a_leg_from_rest_is_that_of_even_acceleration(speed, distance):
    """A ramp takes speed / accel seconds: half is lost in speeding up, half in braking.
    Short legs are a triangle of speed, long ones a trapezoid."""
    accel = 2.0
    metric = Metric(ramp=speed / accel)
    if distance >= speed**2 / accel:
        expected = distance / speed + speed / accel
    else:
        expected = 2 * math.sqrt(distance / accel)
    assert metric.from_rest(distance / speed) == pytest.approx(expected)
