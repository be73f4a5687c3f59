"""What every explorer must do, and the bound that `rdfs` keeps."""

from __future__ import annotations

import numpy as np
import pytest

from missions.arena import Run, look, run
from missions.bounds import drift_factor, rdfs_bound_moves
from missions.explorers import EXPLORERS, Situation
from missions.roi import KINDS, component
from missions.tree import Tree
from missions.units import Cell

NAMES = sorted(EXPLORERS)
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
@pytest.mark.parametrize("seed", range(20))
def test_everything_is_explored_and_everybody_returns(name: str, seed: int) -> None:
    roi, rng = roi_of(seed)
    robots = int(rng.integers(1, 21))
    result = run(EXPLORERS[name], roi, START, robots)
    whole(result, roi)
    assert set(result.at.values()) == {START}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", range(6))
def test_the_same_situation_gives_the_same_moves(name: str, seed: int) -> None:
    roi, rng = roi_of(seed)
    robots = int(rng.integers(1, 9))
    once, again = (run(EXPLORERS[name], roi, START, robots) for _ in range(2))
    assert once.legs == again.legs


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", range(10))
def test_robots_drop_out_and_join(name: str, seed: int) -> None:
    """One robot at a time is missing for a while, one joins late, one is gone for good."""
    roi, rng = roi_of(seed)
    absent = {int(r): int(rng.integers(5, 40)) for r in range(1, 5)}

    def team(rounds: float, tree: Tree) -> list[int]:
        if tree.is_explored(START):
            return list(range(6))
        return [r for r in range(6) if not (r in absent and absent[r] <= rounds < absent[r] + 15)]

    result = run(EXPLORERS[name], roi, START, 6, team=team)
    whole(result, roi)
    assert set(result.at.values()) == {START}

    def lonely(rounds: float, tree: Tree) -> list[int]:
        return [0, 1, 2] if rounds < 12 or tree.is_explored(START) else [0]

    whole(run(EXPLORERS[name], roi, START, 3, team=lonely), roi)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", range(6))
def test_a_restart_from_the_tree_alone_finishes_the_job(name: str, seed: int) -> None:
    roi, _ = roi_of(seed, cells=40)
    tree = Tree.rooted(START)
    for _ in range(10):
        todo = [c for c in tree.vertices if not tree.has_looked(c)]
        if todo:
            tree = look(tree, todo[-1], roi)
    whole(run(EXPLORERS[name], roi, START, 3, tree=tree), roi)


@pytest.mark.parametrize("name", NAMES)
def test_a_late_positive_is_visited(name: str) -> None:
    """A neighbour turns out to be ROI when everything else is explored already."""
    roi = {Cell(0, n) for n in range(4)}
    done = run(EXPLORERS[name], roi, START, 2).tree
    late = done.looked(Cell(0, 2), [Cell(1, 2)])
    assert not late.is_explored(START)
    result = run(EXPLORERS[name], roi | {Cell(1, 2), Cell(2, 2)}, START, 2, tree=late)
    assert {Cell(1, 2), Cell(2, 2)} <= set(result.tree.vertices)
    assert result.tree.is_explored(START)


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


def test_the_literal_listing_breaks_lemma_1() -> None:
    assert violations("rdfs-paper", range(1000, 1060)) > 0


def test_one_robot_walks_every_edge_twice() -> None:
    roi, _ = roi_of(5, cells=40)
    result = run(EXPLORERS["rdfs"], roi, START, 1)
    assert result.makespan == rdfs_bound_moves(len(result.tree), result.tree.depth, 1)


def test_a_drift_lengthens_a_move_and_its_way_back() -> None:
    there, back = 1 / (5.0 - 2.0), 1 / (5.0 + 2.0)
    assert drift_factor(5.0, 2.0) == pytest.approx((there + back) / (2 / 5.0))
