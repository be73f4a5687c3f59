"""Lower bounds, certificates and conformance by hand, on regions that can be drawn on a napkin."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.geo.trajectory import least_s
from missions.lab.arena.arena_run import Certificate, certify, run
from missions.lab.arena.roi import grown
from missions.lab.arena.time_bounds import lower_bound_s
from missions.mapping.tree import Tree
from missions.planning.lower_bounds import (
    LowerBounds,
    Shell,
    drift_lower_bound,
    flight_lower_bound,
    one_way_lower_bound,
)
from missions.planning.stepwise import EXPLORERS
from missions.planning.stepwise.interface import Metric, bound_time, promised_moves
from missions.planning.sweep.paths import Kinematics
from missions.units import Cell

START = Cell(0, 0)


def row(length: int) -> set[Cell]:
    return {Cell(e, 0) for e in range(length)}


def block(width: int, depth: int) -> set[Cell]:
    return {Cell(e, n) for e in range(width) for n in range(depth)}


# --- steps -----------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("cells", "robots", "moves"),
    [
        (row(1), 3, 0),
        (row(2) | {Cell(9, 9)}, 1, 2),  # cells out of reach do not count
        ({Cell(e, 0) for e in range(-5, 6)}, 1, 20),
        ({Cell(e, 0) for e in range(-5, 6)}, 2, 10),
        (row(2), 1, 2),
        (row(2), 9, 2),  # no robot can be quicker than there and back
        (row(10), 1, 18),
        (row(10), 4, 18),  # in a corridor others do not help
        (block(2, 2), 1, 4),
        (block(2, 5), 1, 10),  # once round
        (block(3, 3), 1, 10),  # nine cells: one has to be passed twice
        (block(4, 4), 1, 16),
    ],
)
def test_bounds_of_regions_that_one_can_draw(cells, robots, moves):
    assert LowerBounds.from_roi(cells, START).moves(robots) == moves


def test_a_star_is_shared_by_its_arms():
    star = {START, *(Cell(d * e, d * n) for e, n in START.neighbours() for d in range(1, 4))}
    bounds = LowerBounds.from_roi(star, START)
    assert bounds.moves(1) == 2 * 12
    assert bounds.moves(2) == 12
    assert bounds.moves(4) == 6
    assert bounds.moves(40) == 6


def test_shells_count_the_cells_at_a_distance_or_farther():
    bounds = LowerBounds.from_roi(row(4), START)
    assert bounds.shells == (Shell(1, 2, 6), Shell(2, 1, 4), Shell(3, 1, 2))


@settings(max_examples=60, deadline=None)
@given(st.integers(2, 60), st.integers(0, 999))
def test_one_robot_on_a_tree_walks_every_edge_twice(size, seed):
    """There the bound is the optimum, for any shape."""
    roi = grown("thin", size, seed)
    assert LowerBounds.from_roi(roi.cells, roi.start).moves(1) == 2 * (len(roi.cells) - 1)


# --- drift and flight ------------------------------------------------------------------------
def test_a_drift_stretches_every_step_at_least_as_across():
    assert drift_lower_bound(30, Metric(1.0)) == 30.0
    assert drift_lower_bound(30, Metric(1.0, drift_north=0.8)) == pytest.approx(50.0)
    assert drift_lower_bound(30, Metric(2.0)) == 15.0


def test_bound_in_flight_counts_the_farthest_cell_there_and_back():
    metric = Metric(straight=True)
    assert flight_lower_bound(row(6), START, 1, metric) == 10.0
    assert flight_lower_bound([START, Cell(3, 4)], START, 1, metric) == 10.0
    assert flight_lower_bound([START], START, 1, metric) == 0.0


def test_looks_are_paid_for_each_cell_but_the_start():
    """Five looks, and a path from a neighbour over four legs back to one.

    This bound does not know that all six cells lie in a row."""
    looking = Metric(straight=True, look=7.0)
    assert flight_lower_bound(row(6), START, 1, looking) == 5 * 7.0 + 1 + 4 + 1
    assert flight_lower_bound([START], START, 1, looking) == 0.0


def test_one_way_may_lead_with_the_drift():
    """Against a moving ROI a cell takes 1 / (Sr + Sp), which no closed tour can reach."""
    drifting = Metric(1.0, drift_east=0.5, straight=True)
    assert one_way_lower_bound(row(6), START, 1, drifting) == pytest.approx(5.0 / 1.5)
    assert flight_lower_bound(row(6), START, 1, drifting) == pytest.approx(10 / math.sqrt(0.75))


# --- certificates ----------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("makespan", "bound", "held"),
    [(30.0, 38.0, True), (38.0, 38.0, True), (38.0 + 1e-12, 38.0, True), (38.1, 38.0, False),
     (30.0, None, None)],
)  # fmt: skip
def test_a_bound_is_held_up_to_a_rounding(makespan, bound, held):
    certificate = Certificate(makespan, 20.0, bound, tree_depth=9, cells=20)
    assert certificate.bound_held is held


def test_a_bound_in_moves_becomes_one_in_time():
    assert bound_time(10.0, Metric()) == 10.0
    assert bound_time(10.0, Metric(speed=2.0)) == 5.0
    assert bound_time(10.0, Metric(look=4.0)) == 30.0  # every second move ends with a look
    assert bound_time(None, Metric()) is None


def test_promises_are_for_the_tree_that_came_out():
    tree = Tree.rooted(START).with_observation(START, list(START.neighbours()))
    assert promised_moves(EXPLORERS["rdfs"], tree, 1, Metric()) == 8.0
    assert promised_moves(EXPLORERS["rdfs-paper"], tree, 1, Metric()) is None


def test_bound_in_steps_does_not_count_in_straight_flight():
    """A diagonal is two steps on foot and 1.4 cells in flight."""
    stairs = {START, Cell(1, 0), Cell(1, 1), Cell(2, 1), Cell(2, 2)}
    static = LowerBounds.from_roi(stairs, START)
    for metric in (Metric(), Metric(straight=True)):
        done = run(EXPLORERS["greedy"], stairs, START, 1, metric=metric)
        certificate = certify(done, EXPLORERS["greedy"], 1, metric, static)
        assert certificate.lower_bound <= certificate.makespan
        assert (certificate.lower_bound >= static.moves(1)) is (not metric.straight)


# --- seconds --------------------------------------------------------------------------------------
KINEMATICS = Kinematics(6.0, 2.0, 0.2, half_east_m=5.5, half_north_m=5.5)


def test_region_with_nothing_to_see_takes_no_time():
    assert lower_bound_s([], Cell(0, 0), 1, 4.0, KINEMATICS) == 0.0
    assert lower_bound_s([Cell(0, 0), Cell(1, 1)], Cell(0, 0), 1, 4.0, KINEMATICS) == 0.0


def test_the_farthest_cell_is_flown_to_and_back_from_rest_to_rest():
    # its view begins at 40 - 5.5 m; the speed along that line is zero at its end
    expected = 2.0 * ((40.0 - 5.5) / 6.0 + 6.0 / 2.0)
    assert lower_bound_s([Cell(10, 0)], Cell(0, 0), 5, 4.0, KINEMATICS) == pytest.approx(expected)


def test_many_cells_are_swept_by_the_diagonal():
    field = [Cell(i, j) for i in range(-20, 20) for j in range(-20, 20)]
    length_m = (1600 * 16.0 - 225.0) / (15.0 * math.sqrt(2.0))
    assert lower_bound_s(field, Cell(0, 0), 1, 4.0, KINEMATICS) >= least_s(length_m, 6.0, 2.0)
    both = [lower_bound_s(field, Cell(0, 0), robots, 4.0, KINEMATICS) for robots in (1, 2, 4)]
    assert both == sorted(both, reverse=True)


def test_far_cells_are_swept_after_the_way_to_them():
    field = [Cell(100 + i, j) for i in range(20) for j in range(20)]
    near = min(4.0 * c.east - 5.5 for c in field)
    length_m = 2.0 * near + (400 * 16.0 - 225.0) / (15.0 * math.sqrt(2.0))
    assert lower_bound_s(field, Cell(0, 0), 1, 4.0, KINEMATICS) >= least_s(length_m, 6.0, 2.0) - 1
