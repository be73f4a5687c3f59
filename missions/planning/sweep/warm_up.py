"""Have the planner compiled before somebody is in the air who would have to wait for it."""

from __future__ import annotations

from missions.planning.sweep.chart import Chart
from missions.planning.sweep.planned_team import Flyer, Kinematics, Tuning
from missions.planning.sweep.sweep_planner import Planner
from missions.planning.sweep.tours import lay_tours
from missions.units import Cell, GridPoint


def warm_up() -> None:
    """Make two small plans, one from rest and one from a path under way, and forget them.

    That loads every kernel; the first time on a machine it compiles them, which takes some twenty
    seconds on a fast one. Without numba it takes a fraction of a second.
    """
    planner = Planner(Tuning(moves=20))
    root = Cell(0, 0)
    chart = Chart.around([root], cell_m=4.0)
    chart.yes[chart.index(root)] = 3
    flown = Kinematics(6.0, 2.0, 0.2, 7.0, 5.0)
    valued = planner.worth(chart, chart.index(root), 5, 3)
    home = GridPoint(-20.0, -20.0)
    lay_tours(chart, [Flyer(flown, home, home)], [0.0], valued, 0.0, 1, least=1)
    first = planner.plan(chart, [Flyer(flown, home, home)], valued, 0.0, 1, [0.2])
    under_way = Flyer(flown, home, home, first.paths[0], first.routes[0])
    planner.plan(chart, [under_way], valued, 2.0, 2, [0.2])
