"""Known cells as arrays, beside sets of cells; and routes of a team that pass every node once."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from missions.lab.arena.roi import KINDS
from missions.mapping.tree import distances
from missions.planning.kernels.ground import IMAGINED, LOOKED, UNLOOKED, imagine, is_compact
from missions.planning.kernels.routes import Outlays, arrange, nearest, price
from missions.units import Cell

RIM = 3  # empty rows and columns round the picture, as the kernels want them
SEEDS = range(8)


class Drawn:
    """A raster of cells, and the place of each."""

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

    def cells_of(self, value: int) -> set[Cell]:
        return {self.cell(int(i)) for i in np.flatnonzero(self.picture == value)}


def half_explored(seed: int, size: int = 30) -> tuple[set[Cell], set[Cell]]:
    """Return observed cells, breadth first, and those that were seen from them."""
    rng = np.random.default_rng(seed)
    roi = KINDS[sorted(KINDS)[seed % len(KINDS)]](size, rng)
    order = list(distances(roi, Cell(0, 0)))
    looked = set(order[: int(rng.integers(1, len(order)))])
    seen = {near for cell in looked for near in cell.neighbours() if near in roi}
    return looked, seen - looked


def test_corridor_has_no_imagined_cell():
    corridor = {Cell(e, 0) for e in range(5)} | {Cell(4, n) for n in range(4)}
    drawn = Drawn(corridor - {Cell(4, 3)}, {Cell(4, 3)})
    imagine(drawn.picture, drawn.width)
    assert drawn.cells_of(IMAGINED) == set()


@pytest.mark.parametrize("seed", SEEDS)
def test_only_unknown_cells_are_imagined(seed):
    looked, unlooked = half_explored(seed, size=60)
    drawn = Drawn(looked, unlooked)
    imagine(drawn.picture, drawn.width)
    assert drawn.cells_of(LOOKED) == looked
    assert drawn.cells_of(UNLOOKED) == unlooked
    for cell in drawn.cells_of(IMAGINED):
        assert not set(cell.neighbours()) & looked


# --- what a route costs ----------------------------------------------------------------------
def sites(seed: int, nodes: int, robots: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    places = rng.random((nodes + robots + 1, 2)) * 20.0
    legs = np.hypot(*(places[:, None, :] - places[None, :, :]).transpose(2, 0, 1))
    return legs, rng.random(nodes), rng.integers(0, 3, nodes) * 4.0


@pytest.mark.parametrize("nodes", [2, 4, 6])
@pytest.mark.parametrize("seed", range(4))
def test_search_on_few_sites_finds_the_shortest_round(seed, nodes):
    """The test tries every order."""
    legs, loads, _ = sites(seed, nodes, 1)
    outlays = Outlays(legs, loads, np.zeros(nodes), 0.0)
    none, empty = np.zeros((1, 1), np.int32), np.zeros(1, np.int64)
    routes, counts = arrange(outlays, none, empty, 4000, 0.05, seed)

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


@pytest.mark.parametrize("seed", range(30))
def test_every_node_is_on_one_route_and_searching_pays(seed):
    rng = np.random.default_rng(seed)
    nodes, robots = int(rng.integers(1, 25)), int(rng.integers(1, 7))
    places = rng.random((nodes + robots + 1, 2)) * 20.0
    legs = np.hypot(*(places[:, None, :] - places[None, :, :]).transpose(2, 0, 1))
    outlays = Outlays(legs, rng.random(nodes), rng.integers(0, 3, nodes) * 4.0, 0.3)
    last, counts = np.zeros((robots, 1), np.int32), np.zeros(robots, np.int64)
    costs = []
    for moves in (0, 3000):
        routes, many = arrange(outlays, last, counts, moves, 0.02, seed)
        visited = [int(n) for route, count in zip(routes, many, strict=True) for n in route[:count]]
        assert sorted(visited) == list(range(nodes))
        costs.append(sum(price(outlays, routes[r], int(many[r]), r) for r in range(robots)))
        again = arrange(outlays, last, counts, moves, 0.02, seed)
        assert (again[0] == routes).all()
    assert costs[1] <= costs[0] * 1.05


@given(
    seed=st.integers(0, 10_000),
    nodes=st.integers(1, 12),
    robots=st.integers(1, 4),
    part=st.floats(0.0, 1.0),
)
def test_the_nearest_are_the_first_by_cost_then_by_number(seed, nodes, robots, part):
    others = nodes + robots - 1
    many = max(1, round(part * others))
    size = nodes + robots + 1  # the last is home, which is near to no node
    legs = np.random.default_rng(seed).integers(1, 6, (size, size)).astype(float)  # many ties
    found = nearest(legs, nodes, robots, many)
    for node in range(nodes):
        rest = [other for other in range(nodes + robots) if other != node]
        assert found[node].tolist() == sorted(rest, key=lambda o: (legs[node, o], o))[:many]


def both_searches(
    seed: int, nodes: int, loads: float, moves: int, heat: float
) -> tuple[list[list[int]], list[float]]:
    """Return the routes of `improve_alone` and `improve` from the same start, and their lengths.

    Only `improve` counts work behind a node; with a share of 0 it costs nothing. Legs are whole
    numbers, as on a grid: sums of others depend on their order.
    """
    rng = np.random.default_rng(seed)
    places = rng.integers(0, 12, (nodes + 2, 2))
    legs = np.abs(places[:, None, :] - places[None, :, :]).sum(axis=2).astype(np.float64)
    load = rng.integers(0, 3, nodes) * loads
    last, counts = rng.permutation(nodes).astype(np.int32)[None, :], np.array([nodes], np.int64)
    routes, lengths = [], []
    for behind in (np.zeros(nodes), np.ones(nodes)):
        outlays = Outlays(legs, load, behind, 0.0)
        ((route,), _) = arrange(outlays, last, counts, moves, heat, seed)
        routes.append(route.tolist())
        lengths.append(price(outlays, route, nodes, 0) ** (1.0 / 6.0) - 1.0)
    return routes, lengths


@pytest.mark.parametrize("seed", range(30))
def test_the_search_for_one_robot_is_that_for_a_team(seed):
    nodes = 2 + seed * 37 // 29
    (alone, team), _ = both_searches(seed, nodes, 1.0, 2000, 0.0)
    assert alone == team
    (before, _), _ = both_searches(seed, nodes, 1.0, 0, 0.0)
    assert alone != before or nodes < 4


def test_the_search_for_one_robot_warms_up_as_that_for_a_team():
    """With heat both differ in rounding only: their routes are equally long in the mean."""
    alone, team = np.sum([both_searches(seed, 30, 0.0, 3000, 0.1)[1] for seed in range(30)], axis=0)
    assert abs(alone / team - 1.0) < 0.01


def test_a_nook_is_imagined_where_the_roi_is_compact():
    """Two by two cells were observed, then a step whose inner corner is unseen."""
    rows = ["00000000", "00000000", "00000000", "00022000", "00022100", "00001000", "00000000"]
    rows += ["00000000", "00000000"]
    picture = np.array([int(c) for row in rows for c in row], np.int8)
    assert is_compact(picture, 8)
    nook = 5 * 8 + 5
    imagine(picture, 8)
    assert picture[nook] == 3
    assert np.count_nonzero(picture == 3) == 1
