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


# --- what a route costs ----------------------------------------------------------------------
def sites(seed: int, nodes: int, robots: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    places = rng.random((nodes + robots + 1, 2)) * 20.0
    legs = np.hypot(*(places[:, None, :] - places[None, :, :]).transpose(2, 0, 1))
    return legs, rng.random(nodes), rng.integers(0, 3, nodes) * 4.0


@pytest.mark.parametrize("nodes", [2, 4, 6])
@pytest.mark.parametrize("seed", range(4))
def test_on_few_sites_the_search_finds_the_shortest_round(seed: int, nodes: int) -> None:
    """Against every order there is."""
    legs, loads, _ = sites(seed, nodes, 1)
    outlays = routing.Outlays(legs, loads, np.zeros(nodes), 0.0)
    none, empty = np.zeros((1, 1), np.int32), np.zeros(1, np.int32)
    routes, counts = routing.arrange(outlays, none, empty, 4000, 0.05, seed)

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
