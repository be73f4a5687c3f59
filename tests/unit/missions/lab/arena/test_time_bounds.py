"""Lower bounds in seconds by hand."""

from __future__ import annotations

import math

import pytest

from missions.lab.arena.time_bounds import least_s, lower_bound_s
from missions.planning.sweep.planned_team import Kinematics
from missions.units import Cell

KINEMATICS = Kinematics(6.0, 2.0, 0.2, half_east_m=5.5, half_north_m=5.5)


def test_nothing_to_see_takes_no_time() -> None:
    assert lower_bound_s([], Cell(0, 0), 1, 4.0, KINEMATICS) == 0.0
    assert lower_bound_s([Cell(0, 0), Cell(1, 1)], Cell(0, 0), 1, 4.0, KINEMATICS) == 0.0


def test_the_farthest_cell_is_flown_to_and_back_from_rest_to_rest() -> None:
    # its view begins at 40 - 5.5 m; the speed along that line is zero at its end
    expected = 2.0 * ((40.0 - 5.5) / 6.0 + 6.0 / 2.0)
    assert lower_bound_s([Cell(10, 0)], Cell(0, 0), 5, 4.0, KINEMATICS) == pytest.approx(expected)


def test_many_cells_are_swept_by_the_diagonal() -> None:
    field = [Cell(i, j) for i in range(-20, 20) for j in range(-20, 20)]
    length_m = (1600 * 16.0 - 225.0) / (15.0 * math.sqrt(2.0))
    assert lower_bound_s(field, Cell(0, 0), 1, 4.0, KINEMATICS) >= least_s(length_m, 6.0, 2.0)
    both = [lower_bound_s(field, Cell(0, 0), robots, 4.0, KINEMATICS) for robots in (1, 2, 4)]
    assert both == sorted(both, reverse=True)


def test_far_cells_are_swept_after_the_way_to_them() -> None:
    field = [Cell(100 + i, j) for i in range(20) for j in range(20)]
    near = min(4.0 * c.east - 5.5 for c in field)
    length_m = 2.0 * near + (400 * 16.0 - 225.0) / (15.0 * math.sqrt(2.0))
    assert lower_bound_s(field, Cell(0, 0), 1, 4.0, KINEMATICS) >= least_s(length_m, 6.0, 2.0) - 1
