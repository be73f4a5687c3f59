"""The compiled figures of `rdfs` are those of the strategy that flies."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from missions.errors import RoiError
from missions.lab.arena import arena_run as arena
from missions.lab.arena.arena_run import Run, run
from missions.lab.arena.fast import Lattice, Summary, run_rdfs
from missions.lab.arena.roi import KINDS
from missions.planning.stepwise import EXPLORERS, Decision, rdfs
from missions.planning.stepwise.interface import Metric
from missions.planning.stepwise.rdfs import Rdfs, rdfs_bound_moves
from missions.units import Cell

START = Cell(0, 0)


def ragged(cells: int, rng: np.random.Generator) -> set[Cell]:
    """Draw some cells of a square; cells that are not connected with the start stay unknown."""
    side = round((2 * cells) ** 0.5) + 1
    return {START} | {Cell(e, n) for e in range(side) for n in range(side) if rng.random() < 0.75}


def figures_of(done: Run) -> Summary:
    return Summary(done.makespan, len(done.legs), len(done.tree), done.tree.depth)


ROIS = {**KINDS, "ragged": ragged}
METRICS = {
    "resting": Metric(),
    "drift along an axis": Metric(speed=2.5, drift_east=1.0),
    "drift across, and looks": Metric(speed=3.0, drift_east=-0.7, drift_north=1.1, look=0.2),
}


@settings(max_examples=60, deadline=None)
@given(
    kind=st.sampled_from(sorted(ROIS)),
    cells=st.integers(1, 70),
    robots=st.integers(1, 20),
    metric=st.sampled_from(sorted(METRICS)),
    seed=st.integers(0, 10_000),
)
@example(kind="eden", cells=120, robots=20, metric="resting", seed=1)
@example(kind="eden", cells=120, robots=7, metric="drift along an axis", seed=2)
def test_run_rdfs_gives_the_figures_of_a_run_in_the_arena(kind, cells, robots, metric, seed):
    roi = ROIS[kind](cells, np.random.default_rng(seed))
    slow = run(EXPLORERS["rdfs"], roi, START, robots, metric=METRICS[metric])
    assert run_rdfs(roi, START, robots, METRICS[metric]) == figures_of(slow)


@pytest.mark.parametrize("seed", range(12))
def test_plain_is_the_child_rule_alone(seed, monkeypatch):
    def in_order(arena, arrived):
        vertices = arena.minds[0].tree.vertices
        return sorted({arena.at[r] for r in arrived}, key=lambda c: (vertices[c].depth, c))

    class Plain(Rdfs):
        def decide(self, situation):
            after, moves = dict(situation.at), {}
            for robot in situation.robots:
                moves[robot] = after[robot] = self._move(situation.tree, after, robot)
            return Decision(moves)

    monkeypatch.setattr(arena._Arena, "_in_order", in_order)
    monkeypatch.setattr(rdfs, "_outermost_first", lambda tree, children: tuple(children))
    rng = np.random.default_rng(seed)
    roi = ROIS[sorted(ROIS)[seed % len(ROIS)]](60, rng)
    robots = int(rng.integers(1, 21))
    slow = run(Plain(), roi, START, robots)
    assert run_rdfs(roi, START, robots, plain=True) == figures_of(slow)
    assert slow.makespan <= rdfs_bound_moves(len(slow.tree), slow.tree.depth, robots) + 1e-9


def test_a_lattice_from_an_array_is_the_one_from_cells():
    roi = sorted(ragged(60, np.random.default_rng(3)))
    one, other = Lattice.from_cells(roi), Lattice.from_cells(np.array(roi[::-1]))
    assert np.array_equal(one.cells, np.array(roi))
    assert np.array_equal(one.near, other.near)
    places = {cell: i for i, cell in enumerate(roi)}
    expected = [[places.get(near, -1) for near in cell.neighbours()] for cell in roi]
    assert one.near.tolist() == expected


def test_a_start_outside_the_roi_is_named():
    with pytest.raises(RoiError, match=r"start \(5, 5\)"):
        run_rdfs([START], Cell(5, 5), 1)


def test_cells_that_are_no_roi_are_refused():
    with pytest.raises(RoiError, match="without cells"):
        run_rdfs([], START, 1)
    with pytest.raises(RoiError, match="not one ROI"):
        run_rdfs([START, Cell(2**40, 2**40)], START, 1)


def test_a_roi_far_away_is_explored_as_one_at_home():
    roi = ragged(40, np.random.default_rng(8))
    far = {Cell(c.east - 10**9, c.north + 10**9) for c in roi}
    there = run_rdfs(far, Cell(-(10**9), 10**9), 3)
    assert there == run_rdfs(roi, START, 3)
