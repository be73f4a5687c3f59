"""Ways over known cells, lengths of legs, and assignments, against plain searches."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.lab.arena.roi import KINDS
from missions.lab.strategies.hungarian import assign
from missions.lab.strategies.leg_costs import Ways
from missions.mapping.tree import (
    Tree,
    distances,
    neighbours_in,
    reached,
    step_towards,
)
from missions.planning.stepwise.interface import Metric
from missions.units import Cell

FAST = settings(max_examples=100, deadline=None)
START = Cell(0, 0)


def floyd(cells: set[Cell]) -> dict[tuple[Cell, Cell], float]:
    """Return all distances at once, by trying every cell in between."""
    order = sorted(cells)
    far = {
        (a, b): 0.0 if a == b else 1.0 if b in a.neighbours() else math.inf
        for a in order
        for b in order
    }
    for via in order:
        for a in order:
            for b in order:
                far[a, b] = min(far[a, b], far[a, via] + far[via, b])
    return far


def known(seed: int, most: int = 24) -> set[Cell]:
    rng = np.random.default_rng(seed)
    return KINDS[sorted(KINDS)[seed % len(KINDS)]](int(rng.integers(2, most)), rng)


def tree_of(cells: set[Cell], looks: int | None = None) -> Tree:
    """Return a tree of the cells, breadth first; the first ones were observed."""
    tree = Tree.rooted(START)
    for cell in list(distances(cells, START))[: looks if looks is not None else len(cells)]:
        tree = tree.with_observation(cell, [n for n in cell.neighbours() if n in cells])
    return tree


# --- breadth first ---------------------------------------------------------------------------
@pytest.mark.parametrize("seed", range(8))
def test_distances_are_those_of_trying_everything(seed: int) -> None:
    cells = known(seed)
    far = floyd(cells)
    for start in sorted(cells)[:5]:
        steps = distances(cells, start)
        assert steps == {c: far[start, c] for c in cells if far[start, c] < math.inf}
        assert list(steps.values()) == sorted(steps.values())  # nearest first


def test_a_search_ends_at_the_ring_of_the_nearest_goal() -> None:
    """The search finds all cells of that ring, and none beyond."""
    row = {Cell(e, 0) for e in range(-9, 10)}
    steps = reached(neighbours_in(row), START, until=[Cell(3, 0), Cell(-8, 0)])
    assert set(steps) == {Cell(e, 0) for e in range(-3, 4)}


# --- single steps ----------------------------------------------------------------------------
@pytest.mark.parametrize("seed", range(8))
def test_goal_is_reached_in_the_least_number_of_steps(seed: int) -> None:
    cells = known(seed)
    far = floyd(cells)
    for start, goal in itertools.product(sorted(cells)[:4], sorted(cells)[-4:]):
        at, count = start, 0
        while at != goal:
            at = step_towards(cells, at, goal)
            count += 1
            assert at in cells
        assert count == far[start, goal]


def test_first_of_north_east_south_west_is_chosen_of_equal_steps() -> None:
    block = {Cell(e, n) for e in range(3) for n in range(3)}
    assert step_towards(block, Cell(1, 1), Cell(0, 0)) == Cell(1, 0)  # south before west
    assert step_towards(block, Cell(0, 0), Cell(2, 2)) == Cell(0, 1)  # north before east
    assert step_towards(block, Cell(1, 1), Cell(1, 1)) == Cell(1, 1)


# --- lengths of legs -------------------------------------------------------------------------
@pytest.mark.parametrize("seed", range(6))
def test_length_in_flight_is_a_straight_line_in_cells(seed: int) -> None:
    tree = tree_of(known(seed))
    ways = Ways(tree, Metric(speed=3.0, straight=True))
    lengths = ways.lengths(START, sorted(tree.vertices))
    for goal, length in lengths.items():
        assert length == pytest.approx(math.dist(START, goal))
    assert list(lengths.values()) == sorted(lengths.values())


def test_length_in_a_drift_is_its_share_of_a_closed_tour() -> None:
    tree = tree_of({Cell(e, 0) for e in range(4)} | {Cell(0, n) for n in range(4)})
    metric = Metric(speed=2.0, drift_east=1.2, straight=True)
    lengths = Ways(tree, metric).lengths(START, [Cell(3, 0), Cell(0, 3)])
    assert lengths[Cell(3, 0)] == pytest.approx(2.0 * metric.tour_leg(START, Cell(3, 0)))
    assert lengths[Cell(3, 0)] > lengths[Cell(0, 3)] > 3.0


def test_a_leg_that_is_not_allowed_is_as_long_as_the_way_over_known_cells() -> None:
    corner = {Cell(0, 0), Cell(0, 1), Cell(0, 2), Cell(1, 2), Cell(2, 2)}
    tree = tree_of(corner)
    free = Ways(tree, Metric(straight=True))
    fenced = Ways(
        tree, Metric(straight=True, passable=lambda a, b: a.east == b.east or a.north == b.north)
    )
    goal = Cell(2, 2)
    assert free.lengths(START, [goal])[goal] == pytest.approx(math.sqrt(8))
    assert fenced.lengths(START, [goal])[goal] == 4.0
    assert free.next_stop(START, goal) == goal
    assert fenced.next_stop(START, goal) == Cell(0, 1)


def test_open_cells_are_in_the_order_in_which_they_were_found() -> None:
    tree = tree_of({Cell(e, n) for e in range(3) for n in range(2)}, looks=1)
    assert Ways(tree, Metric()).unvisited == [Cell(0, 1), Cell(1, 0)]
    tree = tree.with_observation(Cell(1, 0), [Cell(2, 0), Cell(1, 1)])
    assert set(Ways(tree, Metric()).unvisited) == {Cell(0, 1), Cell(2, 0), Cell(1, 1)}


@pytest.mark.parametrize("straight", [False, True])
def test_the_nearest_are_all_those_at_the_least_length(straight: bool) -> None:
    cross = {START, Cell(0, 1), Cell(0, 2), Cell(1, 0), Cell(2, 0), Cell(-1, 0), Cell(-1, 1)}
    ways = Ways(tree_of(cross), Metric(straight=straight))
    assert set(ways.nearest(START, [Cell(0, 2), Cell(2, 0)])) == {Cell(0, 2), Cell(2, 0)}
    goals = [Cell(0, 2), Cell(-1, 1)]
    # two steps each, but the diagonal is shorter in flight
    assert set(ways.nearest(START, goals)) == ({Cell(-1, 1)} if straight else set(goals))


# --- assignments -----------------------------------------------------------------------------
matrices = st.integers(1, 4).flatmap(
    lambda rows: st.integers(rows, 6).flatmap(
        lambda columns: st.lists(
            st.lists(st.integers(-20, 20).map(float), min_size=columns, max_size=columns),
            min_size=rows,
            max_size=rows,
        )
    )
)


@FAST
@given(matrices)
def test_no_assignment_is_cheaper(costs: list[list[float]]) -> None:
    chosen = assign(costs)
    rows, columns = len(costs), len(costs[0])
    assert len(set(chosen)) == rows
    cost = sum(costs[row][column] for row, column in enumerate(chosen))
    cheapest = min(
        sum(costs[row][column] for row, column in enumerate(order))
        for order in itertools.permutations(range(columns), rows)
    )
    assert cost == cheapest


@pytest.mark.parametrize(
    "costs",
    [[[1.0], [2.0]], [[1.0, 2.0], [3.0]], [[math.inf, math.inf]], [[math.nan]]],
    ids=["more rows than columns", "ragged", "infinite", "not a number"],
)
def test_assignment_that_is_impossible_is_refused(costs: list[list[float]]) -> None:
    with pytest.raises(ValueError, match=r"rows|finite"):
        assign(costs)
