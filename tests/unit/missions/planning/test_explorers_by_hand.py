"""Decisions of the strategies in situations that can be checked by eye."""

from __future__ import annotations

import itertools
import math
from collections import Counter

import pytest

from missions.lab.arena.arena_run import run
from missions.mapping.tree import Tree
from missions.planning.stepwise import EXPLORERS, Situation
from missions.planning.stepwise.horizon import Retreat
from missions.planning.stepwise.interface import Metric
from missions.units import Cell

START = Cell(0, 0)
NORTH, EAST, SOUTH, WEST = START.neighbours()


def fork(*children: Cell) -> Tree:
    """Return a root that was observed, with children that were not."""
    return Tree.rooted(START).with_observation(START, children)


def decide(name: str, tree: Tree, at: dict[int, Cell], *robots: int, **more: object):
    who = robots or tuple(sorted(at))
    situation = Situation(tree, at, who, **more)  # type: ignore[arg-type]
    return EXPLORERS[name].decide(situation)


# --- one decision ----------------------------------------------------------------------------
def grown(*looks: tuple[Cell, list[Cell]]) -> Tree:
    """Return a tree that was observed from some cells, one after the other."""
    tree = Tree.rooted(START)
    for cell, seen in looks:
        tree = tree.with_observation(cell, seen)
    return tree


NORTH_OPEN = fork(NORTH, EAST).with_observation(NORTH, [Cell(0, 2)])
BOTH_OPEN = NORTH_OPEN.with_observation(EAST, [Cell(2, 0)])
COLUMN = [(Cell(0, n), [Cell(0, n + 1)]) for n in range(3)]
RING = [Cell(0, 0), Cell(0, 1), Cell(0, 2), Cell(1, 2), Cell(2, 2), Cell(2, 1), Cell(2, 0),
        Cell(1, 0)]  # fmt: skip
ARMS = [(START, [NORTH, SOUTH]), (NORTH, [Cell(0, 2)]), (SOUTH, [Cell(0, -2)])]
HOOK = [(START, [EAST, SOUTH]), (EAST, [Cell(1, 1)]), (SOUTH, [Cell(0, -2)])]
Moves = dict[int, Cell | None]
DECISIONS: dict[str, tuple[str, Tree, dict[int, Cell], tuple[int, ...], Moves]] = {
    "an unexplored child comes before one under exploration": (
        "rdfs", NORTH_OPEN, {1: START, 2: NORTH}, (1,), {1: EAST},
    ),
    "of children under exploration the one with fewer robots below it": (
        "rdfs", BOTH_OPEN, {1: START, 2: Cell(0, 2), 3: Cell(0, 2), 4: Cell(2, 0)}, (1,), {1: EAST},
    ),
    "from a finished branch one goes up": (
        "rdfs", fork(NORTH, EAST).with_observation(NORTH, []), {1: NORTH}, (1,), {1: START},
    ),
    "the outermost of equal children comes first": (
        "rdfs", grown(*COLUMN, (Cell(0, 3), [Cell(1, 3), Cell(-1, 3), Cell(0, 4)])),
        {1: Cell(0, 3)}, (1,), {1: Cell(0, 4)},
    ),
    # round a ring the tree is open at one place, which a robot may cross
    "home is by the shortest way and not up the tree": (
        "rdfs", grown(*((a, [b]) for a, b in itertools.pairwise(RING)), (RING[-1], [])),
        {1: Cell(1, 0)}, (1,), {1: START},
    ),
    "as printed the first child is taken, wherever the others are": (
        "rdfs-paper", NORTH_OPEN, {1: START, 2: NORTH}, (1,), {1: NORTH},
    ),
    "as printed a group is halved": (
        "rdfs-paper", fork(NORTH, EAST, SOUTH), dict.fromkeys((1, 2, 3), START), (1, 2, 3),
        {1: NORTH, 2: NORTH, 3: EAST},
    ),
    "greedy goes to the nearest": ("greedy", NORTH_OPEN, {1: NORTH}, (1,), {1: Cell(0, 2)}),
    "greedy sends two not to the same": (  # the second is on its way to the east
        "greedy", NORTH_OPEN, {1: NORTH, 2: NORTH}, (1, 2), {1: Cell(0, 2), 2: START},
    ),
    # the nearer robot leaves the near cell to the other, for which the far one costs more
    "hungarian assigns a team at once": (
        "hungarian", grown(*ARMS, (Cell(0, 2), [Cell(0, 3)])), {1: START, 2: Cell(0, 2)}, (1, 2),
        {1: SOUTH, 2: Cell(0, 3)},
    ),
    "lrta avoids where others are among equals": (
        "lrta", fork(NORTH, EAST), {1: START, 2: NORTH}, (1,), {1: EAST},
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", DECISIONS)
def test_a_decision_that_can_be_checked_by_eye(what):
    name, tree, at, robots, moves = DECISIONS[what]
    assert decide(name, tree, at, *robots).moves == moves


def test_nearest_vertex_in_flight_is_by_straight_distance():
    """Three steps round the corner are 1.4 cells in flight."""
    straight = decide("greedy", grown(*HOOK), {1: START}, metric=Metric(straight=True)).moves
    assert straight == {1: Cell(1, 1)}


# --- rdfs: Algorithm 1 -----------------------------------------------------------------------
@pytest.mark.parametrize(
    ("children", "robots", "shares"),
    [
        ((NORTH, EAST), 2, [1, 1]),
        ((NORTH, EAST), 3, [1, 2]),
        # a dummy vertex: two on one side, two on the other, which is a pair of children
        ((NORTH, EAST, SOUTH), 4, [1, 1, 2]),
    ],
)
def test_robots_at_a_fork_part_evenly(children, robots, shares):
    moves = decide("rdfs", fork(*children), dict.fromkeys(range(1, robots + 1), START)).moves
    assert sorted(Counter(moves.values()).values()) == shares


def test_robot_below_its_anchor_continues_in_depth():
    tree = fork(NORTH).with_observation(NORTH, [Cell(0, 2)])
    there = decide("bfdn", tree, {1: START})
    assert there.moves == {1: NORTH}
    below = decide("bfdn", tree, {1: NORTH}, memory=there.memory)
    assert below.moves == {1: Cell(0, 2)}


def test_all_robots_go_home_when_nothing_is_open():
    tree = fork(NORTH).with_observation(NORTH, [])
    for name in EXPLORERS:
        assert decide(name, tree, {1: NORTH, 2: START}).moves == {1: START, 2: None}, name


# --- bfdn ------------------------------------------------------------------------------------
def test_anchors_are_spread_over_the_open_vertices_of_least_depth():
    tree = fork(NORTH, EAST, WEST)
    for arm in (NORTH, EAST, WEST):
        tree = tree.with_observation(arm, [Cell(2 * arm.east, 2 * arm.north)])
    moves = decide("bfdn", tree, {1: START, 2: START, 3: START}).moves
    assert set(moves.values()) == {NORTH, EAST, WEST}


@pytest.mark.parametrize(
    ("name", "cells", "depth", "robots", "bound"),
    [("rdfs", 10, 4, 1, 18.0), ("rdfs", 10, 4, 2, 13.0), ("rdfs", 10, 4, 3, 13.0),
     ("rdfs", 10, 4, 4, (9 + 8) * 2 / 3), ("bfdn", 100, 5, 1, 200 + 25 * 3),
     ("bfdn", 100, 5, 4, 50 + 25 * (math.log(4) + 3)),
     ("bfdn", 100, 5, 50, 4 + 25 * (math.log(4) + 3))],
)  # fmt: skip
def test_bounds_by_hand(name, cells, depth, robots, bound):
    assert EXPLORERS[name].bound_moves(cells, depth, robots) == pytest.approx(bound)


# --- marks in the world ----------------------------------------------------------------------
def test_lrv_takes_directions_in_turn():
    """It moves north, then (counted on arrival) east, south, west, and north again."""
    star = fork(NORTH, EAST, SOUTH, WEST)
    memory: object = None
    taken = []
    for _ in range(8):
        out = decide("lrv", star, {1: START}, memory=memory)
        taken.append(out.moves[1])
        back = decide("lrv", star, {1: out.moves[1]}, memory=out.memory)  # type: ignore[dict-item]
        assert back.moves[1] == START
        memory = back.memory
    assert taken == [NORTH, EAST, SOUTH, WEST] * 2


def test_lrta_leaves_the_weight_of_where_it_goes_and_one_more():
    row = Tree.rooted(START).with_observation(START, [EAST]).with_observation(EAST, [Cell(2, 0)])
    there = decide("lrta", row, {1: START})
    assert there.memory == {START: 1}
    on = decide("lrta", row, {1: EAST}, memory=there.memory)
    assert on.moves == {1: Cell(2, 0)}  # 0 there, 1 where it came from
    assert on.memory == {START: 1, EAST: 1}


# --- smartdfs --------------------------------------------------------------------------------
def test_smartdfs_keeps_its_left_hand_at_the_wall():
    """It moves from the corner of a block along the rim before it turns in."""
    block = {Cell(e, n) for e in range(4) for n in range(4)}
    done = run(EXPLORERS["smartdfs"], block, START, 1)
    inner = {Cell(1, 1), Cell(2, 1), Cell(1, 2), Cell(2, 2)}
    first_in = next(i for i, leg in enumerate(done.legs) if leg.end in inner)
    assert {START, *(leg.end for leg in done.legs[:first_in])} == block - inner


# --- retreat: home, and over again -----------------------------------------------------------
def test_retreat_brings_all_robots_home_before_any_sets_out():
    tree = fork(NORTH, EAST).with_observation(NORTH, [Cell(0, 2)])
    retreat = Retreat.from_tree(tree)
    assert retreat.dropped == frozenset()
    moves, after = retreat.moves(Situation(tree, {1: NORTH, 2: START}, (1, 2)))
    assert moves == {1: START, 2: None}
    assert after.home == {2}
    moves, after = after.moves(Situation(tree, {1: START, 2: START}, (1, 2)))
    assert set(moves.values()) == {NORTH, EAST}
    assert after.home == {1, 2}


def test_retreat_leaves_out_explored_branches():
    tree = fork(NORTH, EAST).with_observation(NORTH, [])
    retreat = Retreat.from_tree(tree)
    assert retreat.dropped == {NORTH}
    moves, _ = retreat.moves(Situation(tree, {1: START}, (1,)))
    assert moves == {1: EAST}


# --- what all say of themselves --------------------------------------------------------------
@pytest.mark.parametrize("name", sorted(EXPLORERS))
def test_strategy_has_its_name_and_a_number_where_it_states_a_bound(name):
    """A strategy that states T <= or 'at most' for a number of robots gives a number there."""
    explorer = EXPLORERS[name]
    assert explorer.name == name
    for line in (explorer.guarantee, explorer.source, explorer.when):
        assert line
        assert "\n" not in line
    bound = explorer.bound_moves(40, 9, 1)
    assert bound is None or bound >= 2 * 9
    if explorer.guarantee.startswith("T <="):
        assert explorer.bound_moves(40, 9, 4) is not None
    if "no bound" in explorer.guarantee:
        assert bound is None
