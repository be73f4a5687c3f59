"""Duties of every strategy, promises of single ones, and the check that names a fault."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from missions.errors import StrategyError
from missions.lab.arena.arena_run import Run, patience_of, run
from missions.lab.arena.conformance import check, failures
from missions.lab.arena.roi import KINDS, component, eden, thin
from missions.lab.strategies.walks import Lrv, RandomWalk, mix
from missions.mapping.tree import Tree, step_home
from missions.planning.stepwise import EXPLORERS, Decision, Situation
from missions.planning.stepwise.interface import Metric, bound_time
from missions.planning.stepwise.rdfs import rdfs_bound_moves
from missions.units import Cell

Mend = Callable[[Situation, Decision], Decision]


@dataclass
class Wrong:
    mend: Mend
    stated: float | None = None
    name: str = "wrong"
    guarantee: str = "none"
    source: str = "this test"
    when: str = "never"
    calls: list[int] = field(default_factory=list)

    def bound_moves(self, cells: int, depth: int, robots: int) -> float | None:
        return self.stated

    def decide(self, situation: Situation) -> Decision:
        self.calls.append(1)
        return self.mend(situation, EXPLORERS["rdfs"].decide(situation))


def right(situation: Situation, decision: Decision) -> Decision:
    return decision


def waits(situation: Situation, decision: Decision) -> Decision:
    return Decision(dict.fromkeys(situation.robots))


def jumps(situation: Situation, decision: Decision) -> Decision:
    return Decision({r: Cell(cell.east + 1, cell.north + 1) for r, cell in situation.at.items()})


def goes_home_early(situation: Situation, decision: Decision) -> Decision:
    if len(situation.tree) < 6:
        return decision
    return Decision({r: step_home(situation.tree, situation.at[r]) for r in situation.robots})


def forgets_a_robot(situation: Situation, decision: Decision) -> Decision:
    return Decision({r: m for r, m in decision.moves.items() if r != 2 or len(situation.at) < 3})


def changes_its_memory(situation: Situation, decision: Decision) -> Decision:
    memory = situation.memory if isinstance(situation.memory, list) else []
    memory.append(len(situation.tree))
    return replace(decision, memory=memory)


def hangs_on_its_memory(situation: Situation, decision: Decision) -> Decision:
    if situation.memory is None and any(cell != Cell(0, 0) for cell in situation.at.values()):
        raise KeyError("memory")
    return replace(decision, memory="kept")


def fails_at(size: int) -> Mend:
    def divide(situation: Situation, decision: Decision) -> Decision:
        return replace(decision, memory=1 // (len(situation.at) - size))

    return divide


def found(strategy: Wrong) -> dict[str, str]:
    return failures(strategy, cells=9)


def test_right_strategy_passes():
    assert found(Wrong(right)) == {}


@pytest.mark.parametrize(
    ("mend", "check_name", "message"),
    [
        (waits, "explores everything and returns", "all robots wait"),
        (jumps, "explores everything and returns", "moves from"),
        (forgets_a_robot, "a pure function of the situation", "it moves"),
        (changes_its_memory, "a pure function of the situation", "changes its arguments"),
        (fails_at(20), "more robots than cells to visit", "block, 20 robots: ZeroDivisionError"),
        (goes_home_early, "explores everything and returns", ""),
        (goes_home_early, "robots drop out and join", ""),
        (hangs_on_its_memory, "a restart without the memory", "KeyError"),
    ],
)
def test_check_names_the_fault_of_a_wrong_strategy(mend, check_name, message):
    assert message in found(Wrong(mend))[check_name]


def test_strategy_that_keeps_state_between_calls_is_found():
    strategy = Wrong(right)

    def drifts(situation: Situation, decision: Decision) -> Decision:
        home = step_home(situation.tree, situation.at[situation.robots[0]])
        if len(strategy.calls) % 3 == 0 and home is not None:
            return Decision({**decision.moves, situation.robots[0]: home})
        return decision

    strategy.mend = drifts
    assert (
        "two decisions on one situation differ"
        in found(strategy)["a pure function of the situation"]
    )


def test_a_bound_that_does_not_hold_is_found():
    failed = found(Wrong(right, stated=3.0))
    assert list(failed) == ["the stated bound holds"]
    assert "stated 3" in failed["the stated bound holds"]


def test_all_failures_are_reported_at_once():
    with pytest.raises(StrategyError, match=r"wrong does not pass \d+ checks:\n  explores"):
        check(Wrong(waits), cells=9)


NAMES = list(EXPLORERS)
QUICK = [name for name in NAMES if patience_of(EXPLORERS[name]) == 1.0]
"""Strategies with a map; the others walk thousands of moves on ROIs of this size."""
START = Cell(0, 0)


def roi_of(seed: int, cells: int | None = None) -> tuple[set[Cell], np.random.Generator]:
    rng = np.random.default_rng(seed)
    kind = sorted(KINDS)[seed % len(KINDS)]
    return KINDS[kind](cells if cells is not None else int(rng.integers(1, 60)), rng), rng


def whole(result: Run, roi: set[Cell]) -> None:
    assert set(result.tree.vertices) == component(roi, START)
    assert result.tree.is_explored(START)


# --- conformance -----------------------------------------------------------------------------
@pytest.mark.parametrize("name", NAMES)
def test_every_strategy_conforms(name):
    check(EXPLORERS[name], cells=14)


@pytest.mark.parametrize("name", QUICK)
@pytest.mark.parametrize("seed", range(16))
def test_a_team_explores_everything_returns_and_keeps_its_bound(name, seed):
    roi, rng = roi_of(seed)
    robots = int(rng.integers(1, 21))
    result = run(EXPLORERS[name], roi, START, robots)
    whole(result, roi)
    assert set(result.at.values()) == {START}
    bound = EXPLORERS[name].bound_moves(len(result.tree), result.tree.depth, robots)
    assert bound is None or result.makespan <= bound + 1e-9


# --- the bound -------------------------------------------------------------------------------
def violations(name: str, seeds: range) -> int:
    count = 0
    for seed in seeds:
        roi, rng = roi_of(seed)
        robots = int(rng.integers(1, 21))
        result = run(EXPLORERS[name], roi, START, robots)
        bound = rdfs_bound_moves(len(result.tree), result.tree.depth, robots)
        count += result.makespan > bound + 1e-9
    return count


@pytest.mark.parametrize("block", range(6))
def test_rdfs_keeps_lemma_1(block):
    assert violations("rdfs", range(1000 + 60 * block, 1060 + 60 * block)) == 0


@pytest.mark.parametrize("seed", range(12))
def test_rdfs_keeps_its_bound_with_a_drift(seed):
    roi, rng = roi_of(seed)
    robots = int(rng.integers(1, 21))
    drift, toward = float(rng.uniform(0.0, 0.9)), float(rng.uniform(0.0, 6.3))
    metric = Metric(1.0, drift * math.sin(toward), drift * math.cos(toward))
    result = run(EXPLORERS["rdfs"], roi, START, robots, metric=metric)
    bound = bound_time(rdfs_bound_moves(len(result.tree), result.tree.depth, robots), metric)
    assert bound is not None
    assert result.makespan <= bound * (1 + 1e-9)


def test_the_literal_listing_breaks_lemma_1():
    assert violations("rdfs-paper", range(1000, 1060)) > 0


# --- smartdfs --------------------------------------------------------------------------------
def simple_from_rim(seed: int) -> set[Cell]:
    """Return a ROI whose holes are filled, moved so that the start is a cell of its rim."""
    rng = np.random.default_rng(seed)
    roi = KINDS[sorted(KINDS)[seed % len(KINDS)]](int(rng.integers(2, 60)), rng)
    (west, east), (south, north) = (
        (min(axis) - 1, max(axis) + 1) for axis in zip(*roi, strict=True)
    )
    frame = {Cell(e, n) for e in range(west, east + 1) for n in range(south, north + 1)}
    roi = frame - component(frame - roi, Cell(west, south))
    rim = sorted(c for c in roi if any(n not in roi for n in c.neighbours()))
    start = rim[int(rng.integers(len(rim)))]
    return {Cell(c.east - start.east, c.north - start.north) for c in roi}


@pytest.mark.parametrize("block", range(4))
def test_smartdfs_keeps_the_bound_of_simple_polygons(block):
    for seed in range(30 * block, 30 * block + 30):
        roi = simple_from_rim(seed)
        edges = sum(n not in roi for c in roi for n in c.neighbours())
        moves = run(EXPLORERS["smartdfs"], roi, START, 1).makespan
        assert moves <= len(roi) + edges / 2 - 3, seed


# --- bfdn ------------------------------------------------------------------------------------
def test_bfdn_is_a_depth_first_search_for_one_robot():
    roi = eden(50, np.random.default_rng(3))
    assert run(EXPLORERS["bfdn"], roi, START, 1).makespan == 2 * (len(roi) - 1)


# --- node-local ones -------------------------------------------------------------------------
def test_lrv_walks_a_tree_in_two_moves_an_edge():
    for seed in range(20):
        roi = thin(40, np.random.default_rng(seed))
        assert run(Lrv(), roi, START, 1).makespan <= 2 * (len(roi) - 1)


def test_lrv_needs_the_arrivals_for_that():
    roi = thin(40, np.random.default_rng(0))
    assert run(Lrv(arrivals=False), roi, START, 1).makespan > 2 * (len(roi) - 1)


def test_a_rotor_lets_the_directions_take_turns():
    tree = Tree.rooted(START)
    for cell in (START, *START.neighbours()):
        tree = tree.with_observation(cell, [START, *START.neighbours()] if cell == START else [])
    tree = tree.with_observation(Cell(0, 1), [Cell(0, 2)])  # something is left to do
    memory, seen = None, []
    for _ in range(8):
        decision = Lrv(arrivals=False).decide(Situation(tree, {0: START}, (0,), memory))
        memory = decision.memory
        seen.append(decision.moves[0])
    assert seen == [*START.neighbours()] * 2


def test_lrta_follows_its_weights():
    """In a corridor the weights left behind send the robot back only once."""
    roi = {Cell(east, 0) for east in range(-2, 4)}
    legs = run(EXPLORERS["lrta"], roi, START, 1).legs
    assert [leg.end.east for leg in legs][:3] == [1, 2, 3]
    assert len(legs) <= 16


def test_a_random_walk_hangs_on_its_seed_alone():
    roi = eden(10, np.random.default_rng(1))
    ways = [run(RandomWalk(seed=seed), roi, START, 2).legs for seed in (1, 1, 2)]
    assert ways[0] == ways[1]
    assert ways[0] != ways[2]


def test_a_random_walk_takes_every_direction_about_as_often():
    counts = np.bincount([mix(7, step, robot) % 4 for step in range(500) for robot in range(4)])
    assert ((counts > 430) & (counts < 570)).all()


@pytest.mark.parametrize("name", ["greedy", "hungarian", "smartdfs"])
def test_two_robots_part(name):
    tree = Tree.rooted(START).with_observation(START, START.neighbours())
    moves = EXPLORERS[name].decide(Situation(tree, {1: START, 2: START}, (1, 2))).moves
    assert len(set(moves.values())) == 2
