"""Kernels compared with plain code for the same results."""

from __future__ import annotations

import ast
from collections import deque
from pathlib import Path

import numpy as np
import pytest

from missions.lab.kernels import greedy_kernels as greedy
from missions.lab.kernels import lattice_walks
from missions.lab.kernels.lattice_walks import cover
from missions.planning.kernels import jit


def test_every_run_compiles_without_a_folder_for_compiled_code(monkeypatch):
    def njit(cache):
        def compiled(what):
            if cache:
                raise RuntimeError("cannot cache function: no locator available")
            return "compiled", what

        return compiled

    monkeypatch.setattr(jit, "COMPILED", True)
    monkeypatch.setattr(jit, "njit", njit, raising=False)
    assert jit.kernel(abs) == ("compiled", abs)


def test_functions_that_kernels_of_other_modules_call_never_change():
    """Code that is compiled already would continue with the old values."""
    state = np.array([7], np.int64)
    assert [jit.draw(state, 1000) for _ in range(6)] == [0, 595, 209, 241, 775, 327]
    assert jit.uniform(state) == 0.6048307691723251
    assert jit.team_s(np.array([1.0, 2.0, 6.0]), 0.75) == 0.75 * 6.0 + 0.25 * 9.0 / 3.0


def test_kernels_call_no_others_outside_of_their_module():
    for path in [
        *Path(jit.__file__).parent.glob("*.py"),
        *Path(greedy.__file__).parent.glob("*.py"),
    ]:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("missions"):
                names = {alias.name for alias in node.names}
                shared = node.module == jit.__name__
                assert shared or names <= {"Floats", "Ints"}, f"{path.name}: {names}"


# --- greedy ----------------------------------------------------------------------------------
def plain_greedy(beside: dict[int, set[int]], rank: list[int], start: int) -> int:
    """Return the travel to the nearest unvisited vertex, among equals to the lowest in rank."""
    visited, at, travel = {start}, start, 0
    while len(visited) < len(beside):
        steps = {at: 0}
        queue = deque([at])
        while queue:
            v = queue.popleft()
            for w in beside[v] if v in visited else ():
                if w not in steps:
                    steps[w] = steps[v] + 1
                    queue.append(w)
        at = min((v for v in steps if v not in visited), key=lambda v: (steps[v], rank[v]))
        travel += steps[at]
        visited.add(at)
    return travel


@pytest.mark.parametrize("seed", range(8))
def test_greedy_travel_is_that_of_a_plain_search(seed):
    rng = np.random.default_rng(seed)
    vertices = int(rng.integers(2, 60))
    tree = {(int(rng.integers(v)), v) for v in range(1, vertices)}
    more = {
        tuple(sorted(pair)) for pair in rng.integers(vertices, size=(vertices // 3, 2)).tolist()
    }
    edges = sorted(tree | {(a, b) for a, b in more if a != b})
    rank = rng.permutation(vertices)
    beside = {v: {b for a, b in edges if a == v} | {a for a, b in edges if b == v}
              for v in range(vertices)}  # fmt: skip
    first, order = greedy.adjacency(vertices, np.array(edges, np.int32))
    assert all({*order[first[v] : first[v + 1]].tolist()} == beside[v] for v in beside)
    travel, visited = greedy.greedy_travel(first, order, rank.astype(np.int8), 0)
    assert visited == vertices
    assert travel == plain_greedy(beside, rank.tolist(), 0)


# --- walks on a lattice ----------------------------------------------------------------------
def test_lrv_is_least_counted_first():
    m, coverages = 5, 6
    near, degree = lattice_walks.neighbours(m)
    near = lattice_walks.shuffled(near, degree, 77)
    counts = [[0] * int(d) for d in degree]
    v, steps = 0, []
    for _ in range(coverages):
        visited, taken = {v}, 0
        while len(visited) < m * m:
            turn = counts[v].index(min(counts[v]))
            counts[v][turn] += 1
            v = int(near[v, turn])
            visited.add(v)
            taken += 1
        steps.append(taken)
    assert cover(lattice_walks.LRV, near, degree, coverages, 1) == steps


def test_a_shuffled_lattice_has_the_same_neighbours_in_other_orders():
    near, degree = lattice_walks.neighbours(6)
    other = lattice_walks.shuffled(near, degree, 5)
    assert [{*row[:d].tolist()} for row, d in zip(near, degree, strict=True)] == [
        {*row[:d].tolist()} for row, d in zip(other, degree, strict=True)
    ]
    assert not np.array_equal(near, other)
    assert degree.sum() == 4 * 6 * 5


def test_one_lrta_covers_a_lattice_at_once_in_a_fixed_order():
    near, degree = lattice_walks.neighbours(20)
    assert cover(lattice_walks.LRTA, near, degree, 1, 0) == [20 * 20 - 1]


@pytest.mark.parametrize(
    ("rule", "m", "coverages", "least", "most"),
    [
        (lattice_walks.LRTA, 20, 9, 2 * 20**2, np.inf),
        (lattice_walks.RANDOM, 10, 5, 100 * np.log(100), 2 * 100**2),
    ],
)
def test_a_walk_by_chance_hangs_on_its_seed_and_takes_longer(rule, m, coverages, least, most):
    near, degree = lattice_walks.neighbours(m)
    one, same, other = (cover(rule, near, degree, coverages, seed) for seed in (3, 3, 4))
    assert one == same != other
    assert min(one + other) >= m * m - 1
    assert least < np.mean(one) < most
