"""Routes of a team: every node once, and no worse for the search."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from missions.planning.kernels.ground import imagine, is_compact
from missions.planning.kernels.routes import (
    Outlays,
    arrange,
    improve,
    improve_alone,
    nearest,
    price,
)


@pytest.mark.parametrize("seed", range(30))
def test_every_node_is_on_one_route_and_searching_pays(seed: int) -> None:
    rng = np.random.default_rng(seed)
    nodes, robots = int(rng.integers(1, 25)), int(rng.integers(1, 7))
    places = rng.random((nodes + robots + 1, 2)) * 20.0
    legs = np.hypot(*(places[:, None, :] - places[None, :, :]).transpose(2, 0, 1))
    outlays = Outlays(legs, rng.random(nodes), rng.integers(0, 3, nodes) * 4.0, 0.3)
    last, counts = np.zeros((robots, 1), np.int32), np.zeros(robots, np.int32)
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
def test_the_nearest_are_the_first_by_cost_then_by_number(
    seed: int, nodes: int, robots: int, part: float
) -> None:
    others = nodes + robots - 1
    many = max(1, round(part * others))
    size = nodes + robots + 1  # the last is home, to which nobody is near
    legs = np.random.default_rng(seed).integers(1, 6, (size, size)).astype(float)  # many ties
    found = nearest(legs, nodes, robots, many)
    for node in range(nodes):
        rest = [other for other in range(nodes + robots) if other != node]
        assert found[node].tolist() == sorted(rest, key=lambda o: (legs[node, o], o))[:many]


@pytest.mark.parametrize("seed", range(30))
def test_the_search_for_one_robot_is_that_for_a_team(seed: int) -> None:
    """`improve_alone` takes what `improve` takes, attempt by attempt. Legs are whole numbers, as on
    a grid: sums of others hang on their order."""
    rng = np.random.default_rng(seed)
    nodes = int(rng.integers(2, 40))
    places = rng.integers(0, 12, (nodes + 2, 2))
    legs = np.abs(places[:, None, :] - places[None, :, :]).sum(axis=2).astype(np.float64)
    outlays = Outlays(legs, rng.integers(0, 3, nodes).astype(np.float64), np.zeros(nodes), 0.3)
    routes, counts = rng.permutation(nodes).astype(np.int32)[None, :], np.array([nodes], np.int32)
    costs = np.array([price(outlays, routes[0], nodes, 0)])
    alone, length = routes[0].copy(), costs[0] ** (1.0 / 6.0) - 1.0
    improve(outlays, routes, counts, costs, 2000, 0.0, seed)
    improve_alone(legs, alone, length, 2000, 0.0, seed)
    assert alone.tolist() == routes[0].tolist()
    assert costs[0] < (length + 1.0) ** 6 or nodes < 4


def test_the_search_for_one_robot_warms_up_as_that_for_a_team() -> None:
    """With heat the two differ in rounding only: in the mean their routes are as long."""
    ends = np.zeros(2)
    for seed in range(30):
        rng = np.random.default_rng(seed)
        places = rng.integers(0, 12, (32, 2))
        legs = np.abs(places[:, None, :] - places[None, :, :]).sum(axis=2).astype(np.float64)
        outlays, counts = Outlays(legs, np.zeros(30), np.zeros(30), 0.3), np.array([30], np.int32)
        routes = rng.permutation(30).astype(np.int32)[None, :]
        costs = np.array([price(outlays, routes[0], 30, 0)])
        alone, length = routes[0].copy(), costs[0] ** (1.0 / 6.0) - 1.0
        improve(outlays, routes, counts, costs, 3000, 0.1, seed)
        improve_alone(legs, alone, length, 3000, 0.1, seed)
        for k, route in enumerate((routes[0], alone)):
            ends[k] += price(outlays, route, 30, 0) ** (1.0 / 6.0) - 1.0
    assert abs(ends[1] / ends[0] - 1.0) < 0.01


def test_a_nook_is_imagined_where_the_roi_is_compact() -> None:
    """Two by two cells that were looked from, then a step whose inner corner nobody has seen."""
    rows = ["00000000", "00000000", "00000000", "00022000", "00022100", "00001000", "00000000"]
    rows += ["00000000", "00000000"]
    picture = np.array([int(c) for row in rows for c in row], np.int8)
    assert is_compact(picture, 8)
    nook = 5 * 8 + 5
    imagine(picture, 8)
    assert picture[nook] == 3
    assert np.count_nonzero(picture == 3) == 1
