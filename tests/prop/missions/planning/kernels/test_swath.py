"""Flight without stops: rules for every path, frame, plan, run and bound."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from missions.geo.trajectory import Trajectory
from missions.lab.arena.nonstop import Camera, Ground, Run, Team
from missions.lab.arena.roi import KINDS, Roi, grown
from missions.lab.arena.survey import surveyed
from missions.lab.arena.time_bounds import lower_bound_s, reference
from missions.planning.kernels import swath as kernels
from missions.planning.kernels import worth as worths
from missions.planning.kernels.jit import COMPILED
from missions.planning.sweep.chart import Chart
from missions.planning.sweep.kernel_paths import path_of, row_of, segments_of, trajectory_of
from missions.planning.sweep.paths import Flyer, Kinematics, Route, Tuning
from missions.planning.sweep.sweep_planner import Planner
from missions.units import Cell, GridPoint

MAX_CELLS = 40 if COMPILED else 6
QUICK = Tuning(moves=150 if COMPILED else 15)
KINEMATICS = Kinematics(6.0, 2.5, 0.2, 5.5, 5.5)
CAMERA = Camera(15.0, 15.0)

coordinates = st.integers(-30, 30).map(lambda half_cells: 2.0 * half_cells)
waypoints = st.lists(
    st.tuples(coordinates, coordinates, st.sampled_from([0.5, 1.0, 4.0])), min_size=1, max_size=8
)
rois = st.builds(
    grown, st.sampled_from(sorted(KINDS)), st.integers(1, MAX_CELLS), st.integers(0, 10**6)
)


def laid(
    points: list[tuple[float, float, float]], kinematics: Kinematics
) -> tuple[Trajectory, Route]:
    starts = np.zeros((1, kernels.LEADS, 4))
    n_leads = np.full((1, kernels.LEADS), -1, np.int64)
    n_leads[:, kernels.LEADS - 1] = 0
    row = row_of(kinematics, Tuning(), kinematics.frame_s)
    team = kernels.Team(
        row[None], starts, np.zeros((1, kernels.LEADS, 1, kernels.PIECE)), n_leads, np.zeros(1)
    )
    ways = np.zeros((1, kernels.MAX_WAYPOINTS, 3))
    ways[0, : len(points)] = points
    one = np.ones(1, np.int64)
    counts, choices = one * len(points), one * (kernels.LEADS - 1)
    return path_of(team, kernels.Ways(ways, counts, choices, np.zeros(1)), 0, 10.0)


def holds_together(path: Trajectory, kinematics: Kinematics) -> None:
    for piece in path.pieces:
        for part in (0.0, 0.5, 1.0):
            m = piece.after(part * piece.duration_s)
            assert math.hypot(m.v_east_m_s, m.v_north_m_s) <= kinematics.speed_m_s + 1e-6
            assert math.hypot(m.a_east_m_s2, m.a_north_m_s2) <= kinematics.accel_m_s2 * 1.02 + 1e-6
    for one, other in itertools.pairwise(path.pieces):
        end, begin = one.after(one.duration_s), other.after(0.0)
        assert one.begin_s + one.duration_s == pytest.approx(other.begin_s, abs=1e-6)
        assert end.place.distance_to(begin.place) < 1e-6
        speeds = (math.hypot(m.v_east_m_s, m.v_north_m_s) for m in (end, begin))
        assert next(speeds) == pytest.approx(next(speeds), abs=1e-4)
        if math.hypot(end.v_east_m_s, end.v_north_m_s) > 0.1:
            assert end.v_east_m_s == pytest.approx(begin.v_east_m_s, abs=0.1)
            assert end.v_north_m_s == pytest.approx(begin.v_north_m_s, abs=0.1)


@settings(deadline=None)
@given(waypoints, st.floats(2.0, 12.0), st.floats(1.0, 4.0))
@example([(2.0, 0.0, 4.0), (0.0, 4.0, 0.5)], 2.0, 1.0)  # a corner close to where it stands
def test_a_path_keeps_the_limits_and_ends_at_rest_at_its_end(points, speed, accel):
    kinematics = Kinematics(speed, accel, 0.2, 5.5, 5.5)
    path, route = laid(points, kinematics)
    holds_together(path, kinematics)
    end = path.pieces[-1].after(path.pieces[-1].duration_s)
    assert end.place.distance_to(GridPoint(*points[-1][:2])) < 1e-6
    assert math.hypot(end.v_east_m_s, end.v_north_m_s) < 1e-6
    assert path.pieces[0].after(0.0).place.distance_to(GridPoint(0.0, 0.0)) < 1e-9
    assert list(route.passed_m) == sorted(route.passed_m)


@settings(deadline=None)
@given(waypoints)
def test_a_path_becomes_arrays_and_a_path_again(points):
    path, _ = laid(points, KINEMATICS)
    segments = segments_of(path)
    again = trajectory_of(segments, path.begin_s, np.zeros(4))
    assert again.end_s == pytest.approx(path.end_s)
    for t_s in np.linspace(path.begin_s, path.end_s, 9):
        assert again.at(t_s).place.distance_to(path.at(t_s).place) < 1e-6


@settings(deadline=None)
@given(waypoints, st.sampled_from([0.0, 1.2]))
def test_the_frames_that_are_predicted_are_the_frames_that_are_seen(points, tilt):
    kinematics = Kinematics(6.0, 2.5, 0.2, 5.5, 4.5, tilt, 0.1, 2.0, -1.0)
    path, _ = laid(points, kinematics)
    chart = Chart.around([Cell(-16, -16), Cell(16, 16)], 4.0)
    segments = segments_of(path)
    row = row_of(kinematics, Tuning(), 0.2)
    row[kernels.FULL_RATE_S] = np.inf
    cells, times = np.zeros(60_000, np.int32), np.zeros(60_000, np.float32)
    total_s = path.end_s - path.begin_s
    count = kernels.frames(
        row, segments, len(segments), total_s, chart.grid, cells, times, np.zeros(6)
    )
    predicted = np.bincount(cells[:count], minlength=chart.yes.size)
    nothing = np.zeros(chart.yes.size, np.int64)
    judged = Ground(Roi("", Cell(0, 0), frozenset({Cell(0, 0)})), 4.0, kinematics, CAMERA)
    ticks = 0
    while (t_s := 0.2 + 0.2 * ticks) < total_s - 1e-6:
        x, y = judged._middle(path, path.begin_s + t_s)
        worths.see(
            x, y, 5.5, 4.5, chart.grid, nothing, nothing, chart.yes, chart.no, 10**6, 5 * 10**5,
        )  # fmt: skip
        ticks += 1
    # a cell that lies on the very edge of a frame may fall to either side
    assert np.abs(predicted - chart.no).sum() <= 0.02 * predicted.sum() + 9


@settings(max_examples=12, deadline=None)
@given(rois, st.integers(1, 3), st.integers(1, 1000))
@example(grown("eden", 40, 0), 2, 309)  # once, an arc too short to fly bent the line after it
def test_a_run_misses_no_cell_and_is_the_same_again(roi, robots, seed):
    def once():
        ground = Ground(roi, 4.0, KINEMATICS, CAMERA, seed, record=True)
        return Run(ground, robots, Planner(QUICK)).fly()

    run = once()
    assert (run.missed, run.wrong) == (0, 0)
    assert run == once()
    needed = {near for cell in roi.cells for near in cell.cross()}
    assert run.makespan_s >= lower_bound_s(needed, roi.start, robots, 4.0, KINEMATICS)
    home = GridPoint(4.0 * roi.start.east, 4.0 * roi.start.north)
    for paths in run.paths:
        for path in paths:
            holds_together(path, KINEMATICS)
        for one, other in itertools.pairwise(paths):
            before, after = one.at(other.begin_s), other.at(other.begin_s)
            assert before.place.distance_to(after.place) < 1e-6
            assert before.v_east_m_s == pytest.approx(after.v_east_m_s, abs=0.05)
            assert before.v_north_m_s == pytest.approx(after.v_north_m_s, abs=0.05)
        assert paths[-1].at(run.makespan_s + 1.0).place.distance_to(home) < 0.01


@settings(max_examples=10, deadline=None)
@given(rois, st.integers(1, 2), st.integers(1, 1000))
def test_errors_and_losses_cost_time_and_no_cell(roi, robots, seed):
    camera = Camera(15.0, 15.0, error_rate=0.05, loss_rate=0.2)
    ground = Ground(roi, 4.0, KINEMATICS, camera, seed)
    run = Run(ground, robots, Planner(QUICK)).fly()
    # an error about a cell hides the cells behind it, but no believed cell stays open
    yes = ground.chart.yes > ground.chart.no
    root = ground.chart.index(roi.start)
    worth = Planner(QUICK).worth(ground.chart, root, 5, 3)
    assert worth[3] == 0
    assert run.missed == 0 or bool((yes != (ground.truth == 1)).any())


@settings(max_examples=10, deadline=None)
@given(rois, st.integers(1, 4), st.sampled_from([None, 2.5]))
def test_a_survey_misses_no_cell_of_its_box_and_does_not_beat_the_bound(roi, robots, factor):
    run = surveyed(roi, Team(robots, CAMERA), box_factor=factor, record=True)
    if factor is None:
        assert run.missed == 0
    needed = {near for cell in roi.cells for near in cell.cross()}
    if run.missed == 0:
        assert run.makespan_s >= lower_bound_s(needed, roi.start, robots, 4.0, KINEMATICS)
    for (path,) in run.paths:
        holds_together(path, KINEMATICS)


@settings(max_examples=8, deadline=None)
@given(rois, st.integers(1, 2))
def test_the_reference_misses_no_cell_and_does_not_beat_the_bound(roi, robots):
    run = reference(roi, Team(robots, CAMERA), moves_a_cell=20 if COMPILED else 2)
    assert run.missed == 0
    needed = {near for cell in roi.cells for near in cell.cross()}
    assert run.makespan_s >= lower_bound_s(needed, roi.start, robots, 4.0, KINEMATICS)


@settings(deadline=None)
@given(rois, st.lists(st.tuples(coordinates, coordinates), max_size=12), st.randoms())
def test_worth_of_cells_does_not_depend_on_the_order_of_frames(roi, places, shuffle):
    """No ballot here is decided: a decided ballot counts no more votes."""
    found = []
    for _ in range(2):
        ground = Ground(roi, 4.0, KINEMATICS, Camera(15.0, 15.0, frames=99, majority=50))
        for x, y in places:
            worths.see(
                x, y, 5.5, 5.5, ground.chart.grid, ground.truth,
                np.zeros_like(ground.truth), ground.chart.yes, ground.chart.no, 99, 50,
            )  # fmt: skip
        found.append(Planner(QUICK).worth(ground.chart, ground.chart.index(roi.start), 99, 50))
        shuffle.shuffle(places)
    (worth, need, cells, work), (worth2, need2, cells2, work2) = found
    assert np.array_equal(need, need2)
    assert np.allclose(worth, worth2)
    assert (sorted(cells), work) == (sorted(cells2), work2)


def test_plan_keeps_off_forbidden_ground():
    chart = Chart.around([Cell(0, 0), Cell(8, 0)], 4.0)
    chart.fenced = True
    for north in range(chart.south, 6):
        chart.allowed[chart.index(Cell(4, north))] = 0
    for east in range(9):
        chart.yes[chart.index(Cell(east, 0))] = 1
    planner = Planner(Tuning(moves=2000 if COMPILED else 100))
    root = chart.index(Cell(0, 0))
    home = GridPoint(0.0, 0.0)
    team = [Flyer(KINEMATICS, home, home)]
    plan = planner.plan(chart, team, planner.worth(chart, root, 5, 3), 0.0, 1, [0.2])
    (path,) = plan.paths
    assert path is not None
    for t_s in np.arange(0.0, path.end_s, 0.3):
        m = path.at(t_s)
        cell = Cell(math.floor(m.east_m / 4.0 + 0.5), math.floor(m.north_m / 4.0 + 0.5))
        assert chart.allowed[chart.index(cell)]


def test_work_is_never_so_far_away_that_a_plan_leaves_it_undone():
    """All but the far end of a region of one kilometre is decided.

    The path there takes 3 minutes for only a few cells.
    """
    cells = [Cell(east, 0) for east in range(250)]
    chart = Chart.around(cells, 4.0)
    for cell in cells:
        chart.yes[chart.index(cell)] = 3
        for near in cell.neighbours():
            if near not in cells and cell.east < 248:
                chart.no[chart.index(near)] = 3
    planner, home = Planner(QUICK), GridPoint(0.0, 0.0)
    valued = planner.worth(chart, chart.index(cells[0]), 5, 3)
    plan = planner.plan(chart, [Flyer(KINEMATICS, home, home)] * 2, valued, 0.0, 1, [0.2, 0.2])
    farthest = max(point[0] for route in plan.routes for point in route.waypoints)
    assert plan.work == 5
    assert farthest > 4.0 * 247
