"""The promise of the rolling horizon: twice Algorithm 1's bound, wherever it falls back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from missions.lab.arena.arena_run import Comms, Run, run
from missions.lab.arena.roi import component, eden, grown, thin
from missions.mapping.tree import Tree, distances
from missions.planning.stepwise import Decision, Situation
from missions.planning.stepwise.horizon import Horizon, PlannerMemory, Retreat
from missions.planning.stepwise.interface import Metric
from missions.planning.stepwise.rdfs import rdfs_bound_moves
from missions.planning.stepwise.route_planner import Ground, Sites
from missions.units import Cell

START = Cell(0, 0)


def corridor(size: int) -> set[Cell]:
    return {Cell(e, 0) for e in range(-(size // 3), size)}


def comb(size: int) -> set[Cell]:
    return corridor(size) | {Cell(e, n) for e in range(0, size, 2) for n in range(size // 2)}


def star(size: int) -> set[Cell]:
    return {Cell(*c) for k in range(-size, size + 1) for c in ((k, 0), (0, k))}


def spiral(size: int) -> set[Cell]:
    cells, at = {START}, START
    for turn, leg in enumerate(range(2, size)):
        for _ in range(leg):
            at = at.neighbours()[turn % 4]
            cells.add(at)
    return cells


def rings(size: int) -> set[Cell]:
    span = range(-size, size + 1)
    return {Cell(e, n) for e in span for n in span if e % 3 == 0 or n % 3 == 0}


SHAPES: tuple[Callable[[int], set[Cell]], ...] = (corridor, comb, star, spiral, rings)


def roi_of(seed: int) -> tuple[set[Cell], int, np.random.Generator]:
    rng = np.random.default_rng(seed)
    kind = seed % 7
    if kind < 5:
        roi = SHAPES[kind](int(rng.integers(2, 9)))
        lost = [cell for cell in sorted(roi - {START}) if rng.random() < 0.05]
        roi = roi - set(lost)
    else:
        roi = (eden, thin)[kind - 5](int(rng.integers(1, 60)), rng)
    return component(roi, START), 1 + seed // 7 % 20, rng


@dataclass
class Watched:
    """The planner, and the last time of return if it fell back at each decision."""

    explorer: Horizon
    name: str = "horizon"
    home_by: float | None = None
    rounds: int = 0

    def decide(self, situation: Situation) -> Decision:
        decision = self.explorer.decide(situation)
        memory = decision.memory
        assert isinstance(memory, PlannerMemory)
        if self.home_by is None and memory.retreat is not None:
            steps = distances(situation.tree, situation.tree.root)
            self.home_by = self.rounds + max(steps[cell] for cell in situation.at.values())
        self.rounds += 1
        return decision


def explored(result: Run, roi: set[Cell]) -> None:
    assert set(result.tree.vertices) == roi
    assert result.tree.is_explored(START)
    assert set(result.at.values()) == {START}


def bound_of(result: Run, robots: int) -> float:
    return rdfs_bound_moves(len(result.tree), result.tree.depth, robots)


@pytest.mark.parametrize("block", range(4))
def test_planner_keeps_twice_the_bound_of_algorithm_1(block):
    for seed in range(28 * block, 28 * block + 28):
        roi, robots, _ = roi_of(seed)
        result = run(Horizon(), roi, START, robots)
        explored(result, roi)
        bound = Horizon().bound_moves(len(result.tree), result.tree.depth, robots)
        assert bound is not None
        assert result.makespan <= bound + 1e-9


@pytest.mark.parametrize("block", range(4))
def test_algorithm_1_after_a_retreat_at_any_time_takes_at_most_its_bound(block):
    retreats = 0
    for seed in range(1000 + 28 * block, 1028 + 28 * block):
        roi, robots, rng = roi_of(seed)
        watched = Watched(Horizon(until=float(rng.integers(0, 1 + 2 * len(roi) // robots))))
        result = run(watched, roi, START, robots)  # type: ignore[arg-type]
        explored(result, roi)
        if watched.home_by is not None:
            retreats += 1
            assert result.makespan <= watched.home_by + bound_of(result, robots) + 1e-9
    assert retreats > 14


@pytest.mark.parametrize("block", range(4))
def test_a_planner_that_dithers_is_stopped_in_time(block, monkeypatch):
    """With goals drawn at random the planner is hopeless, and its promise still holds."""
    retreats = 0
    for seed in range(2000 + 28 * block, 2028 + 28 * block):
        roi, robots, rng = roi_of(seed)

        def at_random(
            sites: Sites, routes: object, asked: Sequence[int], rng: np.random.Generator = rng
        ) -> dict[int, Cell]:
            known = sorted(sites.tree.vertices)
            elsewhere = {r: [c for c in known if c != sites.places[r]] for r in asked}
            return {r: cells[int(rng.integers(len(cells)))] for r, cells in elsewhere.items()}

        monkeypatch.setattr(Sites, "goals", at_random)
        watched = Watched(Horizon())
        result = run(watched, roi, START, robots)  # type: ignore[arg-type]
        explored(result, roi)
        retreats += watched.home_by is not None
        assert result.makespan <= 2 * bound_of(result, robots) + 1e-9
    assert retreats > 5


@pytest.mark.parametrize("seed", range(14))
def test_robots_that_talk_only_where_they_meet_find_everything(seed):
    roi, _, rng = roi_of(seed)
    until = float(rng.integers(5, 60))
    for planner in (Horizon(), Horizon(until=until)):
        result = run(planner, roi, START, 1 + seed % 4, comms=Comms.MEETING)
        explored(result, roi)


def test_impassable_ground_is_flown_round_along_known_cells():
    """Around a closed ring no robot crosses the middle."""
    roi = component(rings(3), START)

    def along_an_axis(start: Cell, end: Cell) -> bool:
        return start.east == end.east or start.north == end.north

    metric = Metric(straight=True, look=1.0, passable=along_an_axis)
    result = run(Horizon(), roi, START, 3, metric=metric)
    explored(result, roi)
    assert all(along_an_axis(leg.start, leg.end) for leg in result.legs)
    assert any(leg.end not in leg.start.neighbours() for leg in result.legs)


@pytest.mark.parametrize("until", [3.0, 12.0, 30.0])
def test_robots_come_and_go_during_a_retreat(until):
    roi = component(rings(4), START)

    def team(rounds: float, tree: Tree) -> list[int]:
        if tree.is_explored(START):
            return list(range(5))
        return [r for r in range(5) if r == 0 or not 8 * r <= rounds < 8 * r + 12]

    explored(run(Horizon(until=until), roi, START, 5, team=team), roi)


def test_a_cell_found_late_under_a_branch_that_was_dropped_is_visited():
    """A vertex outside T' gets a neighbour after the retreat began."""
    tree = Tree.rooted(START).with_observation(START, [Cell(0, 1), Cell(1, 0)])
    tree = tree.with_observation(Cell(0, 1), [Cell(0, 2)]).with_observation(Cell(0, 2), [])
    retreat = Retreat.from_tree(tree)
    assert Cell(0, 2) in retreat.dropped
    late = tree.with_observation(Cell(0, 2), [Cell(0, 3)]).with_observation(Cell(1, 0), [])
    at, seen = START, []
    while not late.is_explored(START):
        moves, retreat = retreat.moves(Situation(late, {0: at}, (0,)))
        step = moves[0]
        assert step is not None
        at = step
        late = late if late.is_observed(at) else late.with_observation(at, [])
        seen.append(at)
    assert seen[-3:] == [Cell(0, 1), Cell(0, 2), Cell(0, 3)]


def test_robot_away_for_a_battery_keeps_no_cell_from_the_others():
    """One cell is left, and robot 1 was bound for it: robot 2 waits unless robot 1 went home."""
    last = Cell(0, 3)
    tree = (
        Tree.rooted(START)
        .with_observation(START, [Cell(0, 1)])
        .with_observation(Cell(0, 1), [Cell(0, 2)])
    )
    tree = tree.with_observation(Cell(0, 2), [last])
    there = Situation(
        tree, {1: last, 2: Cell(0, 2)}, (2,), PlannerMemory(goals={1: last}), Metric(straight=True)
    )
    assert Horizon().decide(there).moves == {2: None}
    assert Horizon().decide(replace(there, away=frozenset({1}))).moves == {2: last}


def test_robots_do_not_wait_for_the_share_of_one_that_is_away():
    """Two cells lie beside the root, robot 1 stands between them: the others take one each."""
    tree = Tree.rooted(START).with_observation(START, [Cell(1, 0), Cell(0, 1), Cell(0, -1)])
    tree = tree.with_observation(Cell(1, 0), [Cell(2, 0)]).with_observation(Cell(2, 0), [])
    at = {1: START, 2: Cell(1, 0), 3: Cell(2, 0)}
    there = Situation(tree, at, (2, 3), None, Metric(straight=True), frozenset({1}))
    assert set(Horizon().decide(there).moves.values()) == {Cell(0, 1), Cell(0, -1)}


@pytest.mark.parametrize("seed", range(5))
def test_no_vertex_is_farther_over_known_cells_than_it_is_deep(seed):
    """The quick check of the promise relies on this all through a run."""
    depths = []

    class Watched(Horizon):
        def decide(self, situation: Situation) -> Decision:
            tree = situation.tree
            farthest = int(Ground.from_tree(tree).steps_from(tree.root).max())
            depths.append((farthest, tree.depth))
            return Horizon.decide(self, situation)

    roi = grown("eden", 60, seed)
    run(Watched(), roi.cells, roi.start, 3)
    assert all(farthest <= depth for farthest, depth in depths)


def test_speeding_up_is_paid_for_by_the_short_legs_most():
    """A vehicle needs 3 s to speed up and brake: a leg of 1 s takes 3.46 s, one of 9 s 12 s."""
    metric = Metric(speed=1.0, straight=True, ramp=3.0)
    tree = Tree.rooted(START).with_observation(START, [Cell(0, 1), Cell(1, 0)])
    sites = Sites.from_situation(
        Situation(tree, {1: START}, (1,), None, metric), Ground.from_tree(tree), {1: START}
    )
    step = 2.0 * 3.0**0.5
    north, east = (sites.nodes.index(cell) for cell in (Cell(0, 1), Cell(1, 0)))
    assert sites.legs[2, north] == pytest.approx(1.0)
    assert sites.legs[north, east] == pytest.approx(2.0 * (3.0 * 2.0**0.5) ** 0.5 / step)
    assert metric.from_rest(9.0) == 12.0
