"""Known cells as arrays, beside the same questions asked of sets of cells."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from missions.lab.arena.roi import KINDS
from missions.mapping.breadth_first import distances
from missions.planning.kernels import routes as routing
from missions.planning.kernels.ground import (
    IMAGINED,
    LOOKED,
    UNLOOKED,
    imagine,
    is_compact,
    spread,
    step_on,
    survey,
    unobserved,
)
from missions.units import Cell

RIM = 3  # empty rows and columns round the picture, as the kernels want them
SEEDS = range(8)


class Drawn:
    """A picture of cells, and where in it each lies."""

    def __init__(self, looked: set[Cell], unlooked: set[Cell]) -> None:
        known = looked | unlooked
        self.west = min(c.east for c in known) - RIM
        self.south = min(c.north for c in known) - RIM
        self.width = max(c.east for c in known) + RIM + 1 - self.west
        height = max(c.north for c in known) + RIM + 1 - self.south
        self.picture = np.zeros(self.width * height, np.int8)
        for cells, value in ((looked, LOOKED), (unlooked, UNLOOKED)):
            for cell in cells:
                self.picture[self.at(cell)] = value

    def at(self, cell: Cell) -> int:
        return (cell.north - self.south) * self.width + cell.east - self.west

    def cell(self, index: int) -> Cell:
        return Cell(index % self.width + self.west, index // self.width + self.south)

    def of(self, value: int) -> set[Cell]:
        return {self.cell(int(i)) for i in np.flatnonzero(self.picture == value)}


def half_explored(seed: int, size: int = 30) -> tuple[set[Cell], set[Cell]]:
    """Cells that were looked from, breadth first, and those that were seen from them."""
    rng = np.random.default_rng(seed)
    roi = KINDS[sorted(KINDS)[seed % len(KINDS)]](size, rng)
    order = list(distances(roi, Cell(0, 0)))
    looked = set(order[: int(rng.integers(1, len(order)))])
    seen = {near for cell in looked for near in cell.neighbours() if near in roi}
    return looked, seen - looked


# --- what nobody can say ---------------------------------------------------------------------
@pytest.mark.parametrize("seed", SEEDS)
def test_unobserved_is_what_lies_beside_no_look(seed: int) -> None:
    looked, unlooked = half_explored(seed)
    drawn = Drawn(looked, unlooked)
    around = {near for cell in looked | unlooked for near in cell.cross()}
    for cell in around:
        nobody_knows = cell not in looked | unlooked and not set(cell.neighbours()) & looked
        assert unobserved(drawn.picture, drawn.width, drawn.at(cell)) == nobody_knows


@pytest.mark.parametrize("seed", SEEDS)
def test_a_survey_numbers_the_known_cells_and_their_neighbours(seed: int) -> None:
    looked, unlooked = half_explored(seed)
    drawn = Drawn(looked, unlooked)
    cells, near, unseen = survey(drawn.picture, drawn.width)
    names = [drawn.cell(int(i)) for i in cells]
    assert set(names) == looked | unlooked
    for number, cell in enumerate(names):
        for side, other in enumerate(cell.neighbours()):
            found = int(near[number, side])
            assert (names[found] if found >= 0 else None) == (other if other in names else None)
        open_sides = {
            n for n in cell.neighbours()
            if n not in looked | unlooked and not set(n.neighbours()) & looked
        }  # fmt: skip
        assert unseen[number] == (len(open_sides) if cell in unlooked else 0)


# --- nooks -----------------------------------------------------------------------------------
def test_a_block_is_compact_and_a_comb_is_not() -> None:
    block = Drawn({Cell(e, n) for e in range(4) for n in range(4)}, set())
    assert is_compact(block.picture, block.width)
    comb = {Cell(e, 0) for e in range(9)} | {Cell(e, n) for e in range(0, 9, 2) for n in range(4)}
    drawn = Drawn(comb, set())
    assert not is_compact(drawn.picture, drawn.width)


def test_a_corner_between_two_open_cells_is_imagined_where_the_region_is_compact() -> None:
    block = {Cell(e, n) for e in range(3) for n in range(3)}
    drawn = Drawn(block, {Cell(3, 0), Cell(3, 1), Cell(0, 3), Cell(1, 3), Cell(2, 3), Cell(3, 2)})
    imagine(drawn.picture, drawn.width)
    assert drawn.of(IMAGINED) == {Cell(3, 3)}


def test_nothing_is_imagined_in_a_corridor() -> None:
    corridor = {Cell(e, 0) for e in range(5)} | {Cell(4, n) for n in range(4)}
    drawn = Drawn(corridor - {Cell(4, 3)}, {Cell(4, 3)})
    imagine(drawn.picture, drawn.width)
    assert drawn.of(IMAGINED) == set()


@pytest.mark.parametrize("seed", SEEDS)
def test_only_what_nobody_can_know_is_imagined(seed: int) -> None:
    looked, unlooked = half_explored(seed, size=60)
    drawn = Drawn(looked, unlooked)
    imagine(drawn.picture, drawn.width)
    assert drawn.of(LOOKED) == looked
    assert drawn.of(UNLOOKED) == unlooked
    for cell in drawn.of(IMAGINED):
        assert not set(cell.neighbours()) & looked


# --- steps -----------------------------------------------------------------------------------
@pytest.mark.parametrize("seed", SEEDS)
def test_steps_are_those_of_a_breadth_first_search(seed: int) -> None:
    looked, unlooked = half_explored(seed)
    drawn = Drawn(looked, unlooked)
    cells, near, _ = survey(drawn.picture, drawn.width)
    names = [drawn.cell(int(i)) for i in cells]
    starts = np.arange(0, len(names), 4, dtype=np.int32)
    found = spread(near, starts)
    for row, start in zip(found, starts, strict=True):
        steps = distances(set(names), names[start])
        assert row.tolist() == [steps.get(cell, -1) for cell in names]


def test_what_hangs_apart_is_at_no_distance() -> None:
    drawn = Drawn({Cell(0, 0), Cell(5, 5)}, set())
    _, near, _ = survey(drawn.picture, drawn.width)
    assert spread(near, np.array([0], np.int32)).tolist() == [[0, -1]]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_step_on_is_on_a_shortest_way_with_the_most_fresh_cells(seed: int) -> None:
    looked, unlooked = half_explored(seed)
    drawn = Drawn(looked, unlooked)
    cells, near, _ = survey(drawn.picture, drawn.width)
    names = [drawn.cell(int(i)) for i in cells]
    number = {cell: i for i, cell in enumerate(names)}
    fresh = np.array([cell in unlooked for cell in names])
    goal = names[-1]
    (steps,) = spread(near, np.array([number[goal]], np.int32))

    def most_fresh(cell: Cell) -> float:
        """By trying every shortest way."""
        ahead = [n for n in cell.neighbours() if n in number and steps[number[n]] ==
                 steps[number[cell]] - 1]  # fmt: skip
        best = max((most_fresh(n) for n in ahead), default=0.0)
        return best + (1.0 if fresh[number[cell]] else 0.0)

    for start in names[::3]:
        if 0 < steps[number[start]] <= 12:
            after = names[step_on(near, steps, fresh, number[start])]
            assert steps[number[after]] == steps[number[start]] - 1
            ahead = [n for n in start.neighbours() if n in number and steps[number[n]] ==
                     steps[number[start]] - 1]  # fmt: skip
            assert most_fresh(after) == max(most_fresh(n) for n in ahead)


# --- what a route costs ----------------------------------------------------------------------
def sites(seed: int, nodes: int, robots: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    places = rng.random((nodes + robots + 1, 2)) * 20.0
    legs = np.hypot(*(places[:, None, :] - places[None, :, :]).transpose(2, 0, 1))
    return legs, rng.random(nodes), rng.integers(0, 3, nodes) * 4.0


@pytest.mark.parametrize("seed", SEEDS)
def test_a_route_costs_the_sixth_power_of_its_length_and_of_what_may_come(seed: int) -> None:
    legs, loads, behind = sites(seed, 6, 2)
    route = np.random.default_rng(seed).permutation(6).astype(np.int32)
    for robot in (0, 1):
        way = [6 + robot, *route[:4].tolist()]
        length, expected = 0.0, 0.0
        for before, node in itertools.pairwise(way):
            length += legs[before, node]
            if behind[node]:
                expected += 0.3 * (length + legs[node, 8] + behind[node] + 1) ** 6
            length += loads[node]
        expected += (length + legs[way[-1], 8] + 1) ** 6
        found = routing.price(legs, loads, behind, 0.3, route, 4, robot)
        assert found == pytest.approx(expected)


def test_a_robot_without_nodes_pays_for_its_way_home() -> None:
    legs, loads, behind = sites(1, 3, 2)
    empty = np.zeros(3, np.int32)
    cost = routing.price(legs, loads, behind, 0.3, empty, 0, 1)
    assert cost == pytest.approx((legs[4, 5] + 1) ** 6)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_node_is_put_where_it_costs_least(seed: int) -> None:
    legs, loads, behind = sites(seed, 5, 2)
    routes = np.zeros((2, 5), np.int32)
    routes[0, :2], routes[1, :2] = (0, 1), (2, 3)
    counts = np.array([2, 2], np.int32)

    def cost(rows: list[list[int]]) -> float:
        return sum(
            routing.price(legs, loads, behind, 0.3, np.array([*row, 0], np.int32), len(row), r)
            for r, row in enumerate(rows)
        )

    costs = np.array(
        [routing.price(legs, loads, behind, 0.3, routes[r], 2, r) for r in (0, 1)], np.float64
    )
    tried = [
        cost([[*row[:place], 4, *row[place:]] if r == robot else row
              for r, row in enumerate([[0, 1], [2, 3]])])
        for robot in (0, 1) for place in range(3)
    ]  # fmt: skip
    routing.insert(legs, loads, behind, 0.3, routes, counts, costs, 4)
    assert counts.sum() == 5
    assert costs.sum() == pytest.approx(min(tried))
    rows = [routes[r, : counts[r]].tolist() for r in (0, 1)]
    assert cost(rows) == pytest.approx(min(tried))


@pytest.mark.parametrize("nodes", [2, 4, 6])
@pytest.mark.parametrize("seed", range(4))
def test_on_few_sites_the_search_finds_the_shortest_round(seed: int, nodes: int) -> None:
    """Against every order there is."""
    legs, loads, _ = sites(seed, nodes, 1)
    nothing = np.zeros(nodes)
    none, empty = np.zeros((1, 1), np.int32), np.zeros(1, np.int32)
    routes, counts = routing.arrange(legs, loads, nothing, 0.0, none, empty, 4000, 0.05, seed)

    def length(order: list[int]) -> float:
        way = [nodes, *order, nodes + 1]
        return sum(legs[a, b] for a, b in itertools.pairwise(way))

    def orders(left: list[int]) -> list[list[int]]:
        if not left:
            return [[]]
        return [[n, *rest] for n in left for rest in orders([m for m in left if m != n])]

    shortest = min(length(order) for order in orders(list(range(nodes))))
    assert length(routes[0, : counts[0]].tolist()) == pytest.approx(shortest)
    assert math.isfinite(shortest)
