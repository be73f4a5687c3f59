"""Tours past all places: every place has a vehicle, and work of others is left."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from missions.planning.kernels import tour_kernels as kernels
from missions.planning.sweep.chart import Chart
from missions.planning.sweep.paths import Flyer, Kinematics, Tours, Tuning, Valued, Waypoints
from missions.planning.sweep.sweep_planner import Planner
from missions.planning.sweep.tours import lay_tours
from missions.units import Cell, GridPoint

FLOWN = Kinematics(10.0, 2.5, 0.5, 20.0, 15.0)
HOME = GridPoint(0.0, -50.0)


FLYER = Flyer(FLOWN, HOME, HOME)


def rectangle(size: int, moves: int = 700) -> tuple[Chart, np.ndarray, Valued, Planner]:
    """Return chart, work and planner of a square's outline, without frames from below."""
    cells = [Cell(i, j) for i in range(size) for j in range(size)]
    chart = Chart.around(cells, cell_m=10.0)
    wanted = np.zeros(chart.columns * chart.rows, np.uint8)
    for cell in cells:
        if {cell.east, cell.north} & {0, size - 1}:
            wanted[chart.index(cell)] = 1
    planner = Planner(Tuning(moves=moves))
    return chart, wanted, planner.worth_of_all(chart, wanted, 5, 3), planner


def laid(size: int, *delays_s: float, seed: int = 1, before: Waypoints = ()) -> Tours:
    """Return tours past a square's outline for as many vehicles as delays."""
    chart, _, valued, _ = rectangle(size)
    team = [FLYER] * len(delays_s)
    found = lay_tours(chart, team, delays_s, valued, 0.0, seed, before)
    assert found is not None
    return found


def test_all_work_has_a_vehicle_and_two_vehicles_end_sooner_than_one():
    _, wanted, _, _ = rectangle(30)
    one, two, same = laid(30, 0.0), laid(30, 0.0, 0.0), laid(30, 0.0, 0.0)
    assert ((one.mine >= 0) == (wanted == 1)).all()
    assert ((two.mine >= 0) == (wanted == 1)).all()
    assert all(two.waypoints)
    assert two.cost_s < 0.85 * one.cost_s
    assert same.waypoints == two.waypoints


def test_vehicle_that_is_busy_for_long_gets_less():
    assert (laid(30, 0.0, 1000.0).mine == 1).sum() == 0


def test_a_vehicle_that_descends_flies_to_its_first_place_meanwhile() -> None:
    chart, _, valued, _ = rectangle(30)

    def cost_s(blind_s: float, delay_s: float) -> float:
        descends = replace(FLYER, place=GridPoint(150.0, 150.0), blind_s=blind_s)
        found = lay_tours(chart, [descends], [delay_s], valued, 0.0, 1)
        assert found is not None
        return found.cost_s

    at_once, blind, waits = cost_s(0.0, 0.0), cost_s(30.0, 0.0), cost_s(0.0, 30.0)
    # a place is 13 s away and more
    assert at_once + 5.0 < blind < waits - 8.0
    assert cost_s(30.0, 30.0) > waits + 5.0


def test_tours_go_on_unless_others_are_better():
    first = laid(30, 0.0, 0.0)
    again = laid(30, 0.0, 0.0, seed=2, before=first.waypoints)
    assert again.cost_s <= first.cost_s + 1e-6


def test_a_plan_from_tours_is_shorter_than_one_from_nothing():
    chart, _, valued, planner = rectangle(40, moves=50)
    ends_s = []
    for begun in ((), laid(40, 0.0).waypoints):
        plan = planner.plan(chart, [FLYER], valued, 0.0, 1, [0.5], begun)
        assert plan.paths[0] is not None
        ends_s.append(plan.paths[0].end_s)
    assert ends_s[1] < ends_s[0]


def test_little_work_needs_no_tours_and_places_see_all_of_it():
    chart, wanted, valued, _ = rectangle(3)
    assert lay_tours(chart, [FLYER], [0.0], valued, 0.0, seed=1) is None
    places, of = kernels.look_from(wanted, chart.columns, chart.rows, 3, 2, 100)
    assert set(of[wanted == 1].tolist()) == set(range(len(places)))
    steps = [abs(a - b).sum() for a, b in pairwise(places)]
    assert all(step > 0.0 for step in steps)
