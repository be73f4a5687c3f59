"""What single strategies promise beyond conformance."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import pytest

from missions.lab.arena.arena_run import run
from missions.lab.arena.roi import KINDS, component, eden, thin
from missions.lab.strategies.walks import Lrv, RandomWalk, mix
from missions.mapping.tree import Tree
from missions.planning.stepwise import EXPLORERS, Situation
from missions.planning.stepwise.metric import Metric
from missions.units import Cell

START = Cell(0, 0)


# --- smartdfs --------------------------------------------------------------------------------
def simple_from_rim(seed: int) -> set[Cell]:
    """A ROI whose holes are filled, moved so that the start is a cell of its rim."""
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
def test_smartdfs_keeps_the_bound_of_simple_polygons(block: int) -> None:
    for seed in range(30 * block, 30 * block + 30):
        roi = simple_from_rim(seed)
        edges = sum(n not in roi for c in roi for n in c.neighbours())
        moves = run(EXPLORERS["smartdfs"], roi, START, 1).makespan
        assert moves <= len(roi) + edges / 2 - 3, seed


# --- bfdn ------------------------------------------------------------------------------------
def test_bfdn_is_a_depth_first_search_for_one_robot() -> None:
    roi = eden(50, np.random.default_rng(3))
    assert run(EXPLORERS["bfdn"], roi, START, 1).makespan == 2 * (len(roi) - 1)


@pytest.mark.parametrize("robots", [2, 5, 12])
def test_bfdn_keeps_its_bound_on_a_star_of_corridors(robots: int) -> None:
    """Shallow and wide, where the bound is the best that is known."""
    roi = {Cell(e, n) for e in range(-30, 31) for n in (0, 1, 2)}
    result = run(EXPLORERS["bfdn"], roi, START, robots)
    bound = EXPLORERS["bfdn"].bound_moves(len(roi), result.tree.depth, robots)
    assert bound is not None
    assert result.makespan <= bound


# --- node-local ones -------------------------------------------------------------------------
def test_lrv_walks_a_tree_in_two_moves_an_edge() -> None:
    for seed in range(20):
        roi = thin(40, np.random.default_rng(seed))
        assert run(Lrv(), roi, START, 1).makespan <= 2 * (len(roi) - 1)


def test_lrv_needs_the_arrivals_for_that() -> None:
    roi = thin(40, np.random.default_rng(0))
    assert run(Lrv(arrivals=False), roi, START, 1).makespan > 2 * (len(roi) - 1)


def test_a_rotor_lets_the_directions_take_turns() -> None:
    tree = Tree.rooted(START)
    for cell in (START, *START.neighbours()):
        tree = tree.looked(cell, [START, *START.neighbours()] if cell == START else [])
    tree = tree.looked(Cell(0, 1), [Cell(0, 2)])  # something is left to do
    memory, seen = None, []
    for _ in range(8):
        decision = Lrv(arrivals=False).decide(Situation(tree, {0: START}, (0,), memory))
        memory = decision.memory
        seen.append(decision.moves[0])
    assert seen == [*START.neighbours()] * 2


def test_lrta_follows_its_weights() -> None:
    """A corridor: the weights left behind send the robot back over it only once."""
    roi = {Cell(east, 0) for east in range(-2, 4)}
    legs = run(EXPLORERS["lrta"], roi, START, 1).legs
    assert [leg.end.east for leg in legs][:3] == [1, 2, 3]
    assert len(legs) <= 16


def test_a_random_walk_hangs_on_its_seed_alone() -> None:
    roi = eden(10, np.random.default_rng(1))
    ways = [run(RandomWalk(seed=seed), roi, START, 2).legs for seed in (1, 1, 2)]
    assert ways[0] == ways[1]
    assert ways[0] != ways[2]


def test_a_random_walk_takes_every_direction_about_as_often() -> None:
    counts = np.bincount([mix(7, step, robot) % 4 for step in range(500) for robot in range(4)])
    assert ((counts > 430) & (counts < 570)).all()


# --- in flight -------------------------------------------------------------------------------
@dataclass(frozen=True)
class Barred:
    """No straight way leads to some cells."""

    cells: frozenset[Cell]

    def __call__(self, start: Cell, end: Cell) -> bool:
        return start not in self.cells and end not in self.cells


def bow() -> Tree:
    """A known bow around a gap, whose far end is open."""
    bend = [Cell(0, 1), Cell(0, 2), Cell(1, 2), Cell(2, 2), Cell(2, 1), Cell(2, 0)]
    tree = Tree.rooted(START)
    for here, there in itertools.pairwise([START, *bend]):
        tree = tree.looked(here, [there])
    return tree


@pytest.mark.parametrize("name", ["greedy", "hungarian"])
def test_in_flight_the_straight_way_is_taken_where_it_is_allowed(name: str) -> None:
    def move(metric: Metric) -> Cell | None:
        return EXPLORERS[name].decide(Situation(bow(), {1: START}, (1,), None, metric)).moves[1]

    assert move(Metric()) == Cell(0, 1)
    assert move(Metric(straight=True)) == Cell(2, 0)
    barred = Barred(frozenset({Cell(2, 0)}))
    assert move(Metric(straight=True, passable=barred)) == Cell(0, 1)


@pytest.mark.parametrize("name", ["greedy", "hungarian", "smartdfs"])
def test_two_robots_part(name: str) -> None:
    tree = Tree.rooted(START).looked(START, START.neighbours())
    moves = EXPLORERS[name].decide(Situation(tree, {1: START, 2: START}, (1, 2))).moves
    assert len(set(moves.values())) == 2
