"""What every explorer must do, on larger ROIs, and the bounds that they state."""

from __future__ import annotations

import math

import numpy as np
import pytest

from missions.lab.arena.arena_run import Run, patience_of, run
from missions.lab.arena.conformance import check
from missions.lab.arena.roi import KINDS, component
from missions.mapping.tree import Tree
from missions.planning.stepwise import EXPLORERS, Situation
from missions.planning.stepwise.bounds import rdfs_bound_moves
from missions.planning.stepwise.interface import bound_time
from missions.planning.stepwise.metric import Metric
from missions.planning.stepwise.rdfs import drift_factor, rdfs_bound_moves
from missions.units import Cell

NAMES = list(EXPLORERS)
QUICK = [name for name in NAMES if patience_of(EXPLORERS[name]) == 1.0]
"""Those with a map; the others walk thousands of moves on ROIs of this size."""
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
def test_every_strategy_conforms(name: str) -> None:
    check(EXPLORERS[name], cells=14)


@pytest.mark.parametrize("name", QUICK)
@pytest.mark.parametrize("seed", range(16))
def test_a_team_explores_everything_returns_and_keeps_its_bound(name: str, seed: int) -> None:
    roi, rng = roi_of(seed)
    robots = int(rng.integers(1, 21))
    result = run(EXPLORERS[name], roi, START, robots)
    whole(result, roi)
    assert set(result.at.values()) == {START}
    bound = EXPLORERS[name].bound_moves(len(result.tree), result.tree.depth, robots)
    assert bound is None or result.makespan <= bound + 1e-9


@pytest.mark.parametrize("name", NAMES)
def test_a_single_cell_needs_no_move(name: str) -> None:
    assert run(EXPLORERS[name], {START}, START, 3).makespan == 0
    tree = Tree.rooted(START).looked(START, [])
    assert EXPLORERS[name].decide(Situation(tree, {1: START}, (1,))).moves == {1: None}


@pytest.mark.parametrize("name", NAMES)
def test_nobody_is_moved_who_does_not_decide(name: str) -> None:
    tree = Tree.rooted(START).looked(START, [Cell(0, 1), Cell(1, 0)])
    assert set(EXPLORERS[name].decide(Situation(tree, {1: START, 2: START}, (2,))).moves) == {2}


# --- the bound -------------------------------------------------------------------------------
def violations(name: str, seeds: range) -> int:
    """How often Lemma 1 does not hold."""
    count = 0
    for seed in seeds:
        roi, rng = roi_of(seed)
        robots = int(rng.integers(1, 21))
        result = run(EXPLORERS[name], roi, START, robots)
        bound = rdfs_bound_moves(len(result.tree), result.tree.depth, robots)
        count += result.makespan > bound + 1e-9
    return count


@pytest.mark.parametrize("block", range(6))
def test_rdfs_keeps_lemma_1(block: int) -> None:
    assert violations("rdfs", range(1000 + 60 * block, 1060 + 60 * block)) == 0


@pytest.mark.parametrize("seed", range(12))
def test_rdfs_keeps_its_bound_with_a_drift(seed: int) -> None:
    roi, rng = roi_of(seed)
    robots = int(rng.integers(1, 21))
    drift, toward = float(rng.uniform(0.0, 0.9)), float(rng.uniform(0.0, 6.3))
    metric = Metric(1.0, drift * math.sin(toward), drift * math.cos(toward))
    result = run(EXPLORERS["rdfs"], roi, START, robots, metric=metric)
    bound = bound_time(rdfs_bound_moves(len(result.tree), result.tree.depth, robots), metric)
    assert bound is not None
    assert result.makespan <= bound * (1 + 1e-9)


def test_the_literal_listing_breaks_lemma_1() -> None:
    assert violations("rdfs-paper", range(1000, 1060)) > 0
