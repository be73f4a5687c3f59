"""Routes of a team: every node once, and no worse for the search."""

from __future__ import annotations

import numpy as np
import pytest

from missions.kernels.ground import imagine, is_compact
from missions.kernels.routes import arrange, price


@pytest.mark.parametrize("seed", range(30))
def test_every_node_is_on_one_route_and_searching_pays(seed: int) -> None:
    rng = np.random.default_rng(seed)
    nodes, robots = int(rng.integers(1, 25)), int(rng.integers(1, 7))
    places = rng.random((nodes + robots + 1, 2)) * 20.0
    legs = np.hypot(*(places[:, None, :] - places[None, :, :]).transpose(2, 0, 1))
    loads, behind = rng.random(nodes), rng.integers(0, 3, nodes) * 4.0
    last, counts = np.zeros((robots, 1), np.int32), np.zeros(robots, np.int32)
    costs = []
    for moves in (0, 3000):
        routes, many = arrange(legs, loads, behind, last, counts, moves, 0.02, seed)
        visited = [int(n) for route, count in zip(routes, many, strict=True) for n in route[:count]]
        assert sorted(visited) == list(range(nodes))
        costs.append(
            sum(price(legs, loads, behind, routes[r], int(many[r]), r) for r in range(robots))
        )
        again = arrange(legs, loads, behind, last, counts, moves, 0.02, seed)
        assert (again[0] == routes).all()
    assert costs[1] <= costs[0] * 1.05


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
