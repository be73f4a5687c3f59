"""What the strategies decide in situations that can be checked by eye."""

from __future__ import annotations

import math
from collections import Counter

import pytest

from missions.lab.arena.arena_run import run
from missions.mapping.tree import Tree
from missions.planning.stepwise import EXPLORERS, Situation
from missions.planning.stepwise.horizon import Retreat
from missions.planning.stepwise.metric import Metric
from missions.units import Cell

START = Cell(0, 0)
NORTH, EAST, SOUTH, WEST = START.neighbours()


def fork(*children: Cell) -> Tree:
    """A root that was looked from, with children that were not."""
    return Tree.rooted(START).looked(START, children)


def decide(name: str, tree: Tree, at: dict[int, Cell], *robots: int, **more: object):
    who = robots or tuple(sorted(at))
    situation = Situation(tree, at, who, **more)  # type: ignore[arg-type]
    return EXPLORERS[name].decide(situation)


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
def test_robots_at_a_fork_part_evenly(
    children: tuple[Cell, ...], robots: int, shares: list[int]
) -> None:
    moves = decide("rdfs", fork(*children), dict.fromkeys(range(1, robots + 1), START)).moves
    assert sorted(Counter(moves.values()).values()) == shares


def test_an_unexplored_child_comes_before_one_under_exploration() -> None:
    tree = fork(NORTH, EAST).looked(NORTH, [Cell(0, 2)])
    assert decide("rdfs", tree, {1: START, 2: NORTH}, 1).moves == {1: EAST}


def test_of_children_under_exploration_the_one_with_fewer_robots_below_it() -> None:
    tree = fork(NORTH, EAST).looked(NORTH, [Cell(0, 2)]).looked(EAST, [Cell(2, 0)])
    at = {1: START, 2: Cell(0, 2), 3: Cell(0, 2), 4: Cell(2, 0)}
    assert decide("rdfs", tree, at, 1).moves == {1: EAST}


def test_from_a_finished_branch_one_goes_up() -> None:
    tree = fork(NORTH, EAST).looked(NORTH, [])
    assert decide("rdfs", tree, {1: NORTH}).moves == {1: START}


def test_the_outermost_of_equal_children_comes_first() -> None:
    tree = Tree.rooted(START)
    for n in range(3):
        tree = tree.looked(Cell(0, n), [Cell(0, n + 1)])
    tree = tree.looked(Cell(0, 3), [Cell(1, 3), Cell(-1, 3), Cell(0, 4)])
    assert decide("rdfs", tree, {1: Cell(0, 3)}).moves == {1: Cell(0, 4)}


def test_when_all_is_explored_home_is_by_the_shortest_way_and_not_up_the_tree() -> None:
    """Round a ring the tree is open at one place, which a robot may cross."""
    ring = [Cell(0, 0), Cell(0, 1), Cell(0, 2), Cell(1, 2), Cell(2, 2), Cell(2, 1), Cell(2, 0),
            Cell(1, 0)]  # fmt: skip
    tree = Tree.rooted(START)
    for cell, after in zip(ring, [*ring[1:], None], strict=True):
        tree = tree.looked(cell, [after] if after else [])
    assert tree.depth == 7
    assert decide("rdfs", tree, {1: Cell(1, 0)}).moves == {1: START}


def test_below_its_anchor_a_robot_goes_on_in_depth() -> None:
    tree = fork(NORTH).looked(NORTH, [Cell(0, 2)])
    there = decide("bfdn", tree, {1: START})
    assert there.moves == {1: NORTH}
    below = decide("bfdn", tree, {1: NORTH}, memory=there.memory)
    assert below.moves == {1: Cell(0, 2)}


def test_as_printed_a_robot_that_comes_alone_takes_the_first_child_wherever_the_others_are() -> (
    None
):
    tree = fork(NORTH, EAST).looked(NORTH, [Cell(0, 2)])
    assert decide("rdfs-paper", tree, {1: START, 2: NORTH}, 1).moves == {1: NORTH}
    group = decide("rdfs-paper", fork(NORTH, EAST, SOUTH), dict.fromkeys((1, 2, 3), START)).moves
    assert [group[r] for r in (1, 2, 3)] == [NORTH, NORTH, EAST]


# --- greedy ----------------------------------------------------------------------------------
def test_greedy_goes_to_the_nearest_and_two_not_to_the_same() -> None:
    tree = fork(NORTH, EAST).looked(NORTH, [Cell(0, 2)])
    assert decide("greedy", tree, {1: NORTH}).moves == {1: Cell(0, 2)}
    both = decide("greedy", tree, {1: NORTH, 2: NORTH}).moves
    assert both == {1: Cell(0, 2), 2: START}  # the second is on its way to the east


def test_in_flight_the_nearest_is_as_the_crow_flies() -> None:
    """Three steps round the corner are 1.4 cells in flight."""
    hook = {START, Cell(1, 0), Cell(1, 1), Cell(0, -1), Cell(0, -2)}
    tree = Tree.rooted(START).looked(START, [Cell(1, 0), Cell(0, -1)])
    tree = tree.looked(Cell(1, 0), [Cell(1, 1)]).looked(Cell(0, -1), [Cell(0, -2)])
    assert set(tree.vertices) == hook
    straight = decide("greedy", tree, {1: START}, metric=Metric(straight=True)).moves
    assert straight == {1: Cell(1, 1)}


# --- hungarian -------------------------------------------------------------------------------
def test_the_team_is_assigned_at_once() -> None:
    """The nearer robot leaves the near cell to the other, whom it would cost more."""
    tree = Tree.rooted(START).looked(START, [NORTH, SOUTH])
    tree = tree.looked(NORTH, [Cell(0, 2)]).looked(SOUTH, [Cell(0, -2)])
    tree = tree.looked(Cell(0, 2), [Cell(0, 3)])
    moves = decide("hungarian", tree, {1: START, 2: Cell(0, 2)}).moves
    assert moves == {1: SOUTH, 2: Cell(0, 3)}


def test_when_nothing_is_open_everybody_goes_home() -> None:
    tree = fork(NORTH).looked(NORTH, [])
    for name in EXPLORERS:
        assert decide(name, tree, {1: NORTH, 2: START}).moves == {1: START, 2: None}, name


# --- bfdn ------------------------------------------------------------------------------------
def test_anchors_are_spread_over_the_open_vertices_of_least_depth() -> None:
    tree = fork(NORTH, EAST, WEST)
    for arm in (NORTH, EAST, WEST):
        tree = tree.looked(arm, [Cell(2 * arm.east, 2 * arm.north)])
    moves = decide("bfdn", tree, {1: START, 2: START, 3: START}).moves
    assert set(moves.values()) == {NORTH, EAST, WEST}


@pytest.mark.parametrize(
    ("name", "cells", "depth", "robots", "bound"),
    [("rdfs", 10, 4, 1, 18.0), ("rdfs", 10, 4, 2, 13.0), ("rdfs", 10, 4, 3, 13.0),
     ("rdfs", 10, 4, 4, (9 + 8) * 2 / 3), ("bfdn", 100, 5, 1, 200 + 25 * 3),
     ("bfdn", 100, 5, 4, 50 + 25 * (math.log(4) + 3)),
     ("bfdn", 100, 5, 50, 4 + 25 * (math.log(4) + 3))],
)  # fmt: skip
def test_bounds_by_hand(name: str, cells: int, depth: int, robots: int, bound: float) -> None:
    assert EXPLORERS[name].bound_moves(cells, depth, robots) == pytest.approx(bound)


# --- marks in the world ----------------------------------------------------------------------
def test_lrv_takes_directions_in_turn() -> None:
    """North, then (counted on arrival) east, south, west, and north again."""
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


def test_lrta_leaves_the_weight_of_where_it_goes_and_one_more() -> None:
    row = Tree.rooted(START).looked(START, [EAST]).looked(EAST, [Cell(2, 0)])
    there = decide("lrta", row, {1: START})
    assert there.memory == {START: 1}
    on = decide("lrta", row, {1: EAST}, memory=there.memory)
    assert on.moves == {1: Cell(2, 0)}  # 0 there, 1 where it came from
    assert on.memory == {START: 1, EAST: 1}


def test_lrta_avoids_where_others_are_among_equals() -> None:
    assert decide("lrta", fork(NORTH, EAST), {1: START, 2: NORTH}, 1).moves == {1: EAST}


# --- smartdfs --------------------------------------------------------------------------------
def test_smartdfs_keeps_its_left_hand_at_the_wall() -> None:
    """From the corner of a block it goes round along the rim before it turns in."""
    block = {Cell(e, n) for e in range(4) for n in range(4)}
    done = run(EXPLORERS["smartdfs"], block, START, 1)
    inner = {Cell(1, 1), Cell(2, 1), Cell(1, 2), Cell(2, 2)}
    first_in = next(i for i, leg in enumerate(done.legs) if leg.end in inner)
    assert {START, *(leg.end for leg in done.legs[:first_in])} == block - inner


# --- retreat: home, and over again -----------------------------------------------------------
def test_a_retreat_brings_everybody_home_before_anybody_sets_out() -> None:
    tree = fork(NORTH, EAST).looked(NORTH, [Cell(0, 2)])
    retreat = Retreat.of(tree)
    assert retreat.dropped == frozenset()
    moves, after = retreat.moves(Situation(tree, {1: NORTH, 2: START}, (1, 2)))
    assert moves == {1: START, 2: None}
    assert after.home == {2}
    moves, after = after.moves(Situation(tree, {1: START, 2: START}, (1, 2)))
    assert set(moves.values()) == {NORTH, EAST}
    assert after.home == {1, 2}


def test_a_retreat_leaves_out_what_is_explored() -> None:
    tree = fork(NORTH, EAST).looked(NORTH, [])
    retreat = Retreat.of(tree)
    assert retreat.dropped == {NORTH}
    moves, _ = retreat.moves(Situation(tree, {1: START}, (1,)))
    assert moves == {1: EAST}


# --- what all say of themselves --------------------------------------------------------------
@pytest.mark.parametrize("name", sorted(EXPLORERS))
def test_a_strategy_names_itself_and_a_promise_of_a_bound_is_one(name: str) -> None:
    """Who states T <= or 'at most' for a number of robots gives a number there."""
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
