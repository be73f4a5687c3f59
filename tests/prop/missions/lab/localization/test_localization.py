"""Localization on random grids: always right, within the bounds, and sooner with a map."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.lab.arena.roi import KINDS, grown
from missions.lab.localization.grid_map import DIRECTIONS, RING, GridMap, cluttered, label, split
from missions.lab.localization.homing import Moves, blum_kozen, homing
from missions.lab.localization.localization_planner import Planner, homing_bound
from missions.lab.localization.localization_run import METHODS, localize

FEW = settings(max_examples=60, deadline=None)


@st.composite
def maps(draw: st.DrawFn, largest: int = 60) -> GridMap:
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    if draw(st.booleans()):
        width, height = draw(st.integers(1, 9)), draw(st.integers(1, 9))
        return GridMap.from_cells(cluttered(width, height, draw(st.floats(0.0, 0.5)), rng))
    kind = draw(st.sampled_from(sorted(KINDS)))
    return GridMap.from_cells(
        grown(kind, draw(st.integers(1, largest)), draw(st.integers(0, 999))).cells
    )


@FEW
@given(maps(), st.data())
def test_every_method_is_right_within_its_bound_and_no_later_with_a_map(known, data):
    start = data.draw(st.sampled_from(known.cells))
    planner = Planner(known)
    for method in METHODS.values():
        seed = np.random.default_rng
        with_map = localize(known, start, method, seed(5), planner)
        done = [with_map]
        if not method.needs_map:
            without = localize(known, start, method, seed(5))
            assert with_map.moves <= without.moves
            done.append(without)
        for one in done:
            assert one.right
            assert one.confidence == 1.0
            assert method.bound is None or one.moves <= method.bound(known.size)


@FEW
@given(maps())
def test_the_lemmas_of_the_paper_hold(known):
    n, c = known.size, known.circumnavigation
    boundary = n - known.labels[0]
    assert sum(known.labels) == n
    assert 3 * c <= 8 * boundary  # Lemma 5
    assert homing_bound(known) <= 4 * n  # Theorem 2
    start, rng = known.cells[n // 2], np.random.default_rng(1)
    assert localize(known, start, METHODS["homing"], rng).moves <= homing_bound(known)  # Lemma 1


def memory(walk: Moves) -> dict[str, object]:
    """Return the variables of a method under way, with those of the parts it is in."""
    kept: dict[str, object] = {}
    while walk is not None:
        for name, value in walk.gi_frame.f_locals.items():
            kept[f"{walk.gi_code.co_name}.{name}"] = value
        walk = walk.gi_yieldfrom  # type: ignore[assignment]
    return kept


@FEW
@given(maps(40), st.sampled_from([homing, blum_kozen]))
def test_homing_and_blum_kozen_remember_counters_only(known, method):
    """O(log n) bits suffice: a fixed number of variables, each below 4 n + 8 or a place."""
    if known.size == 1:
        return
    here = known.size - 1
    walk = method(known.patterns[here])  # type: ignore[operator]
    direction, names = next(walk), set[str]()
    for _ in range(200):
        for name, value in memory(walk).items():
            names.add(name)
            if callable(value):  # which hand is at the obstacle: one of two
                continue
            numbers = value if isinstance(value, tuple) else (value,)
            assert len(numbers) <= 2
            assert all(n is None or abs(n) <= max(4 * known.size + 8, 255) for n in numbers), name
        here = known.steps[direction][here]
        direction = walk.send(known.patterns[here])
    assert len(names) <= 20


@FEW
@given(st.integers(0, 255))
def test_a_label_counts_the_components_of_the_obstructed_neighbours(pattern):
    left = {RING[i] for i in range(8) if not pattern >> i & 1}
    parts = 0
    while left:
        parts += 1
        todo = [left.pop()]
        while todo:
            e, n = todo.pop()
            near = {o for o in left if max(abs(o[0] - e), abs(o[1] - n)) == 1}
            left -= near
            todo += near
    assert label(pattern) == parts


@settings(max_examples=25, deadline=None)
@given(maps(40))
def test_the_best_of_all_plans_is_not_beaten(known):
    """The planner with unlimited look-ahead agrees with a search without any pruning."""

    def least(candidates: tuple[int, ...], moves: int) -> float:
        if len(candidates) == 1:
            return 0.0
        if moves == 0:
            return float("inf")
        free = [d for d in DIRECTIONS if known.steps[d][candidates[0]] >= 0]
        return len(candidates) + min(
            sum(least(group, moves - 1) for group in split(known, candidates, d)) for d in free
        )

    best, quick = Planner(known, exact=known.size), Planner(known)
    rng = np.random.default_rng(1)
    total = sum(localize(known, cell, METHODS["plan"], rng, best).moves for cell in known.cells)
    assert abs(total - best.expected_moves() * known.size) < 1e-6
    assert total <= sum(
        localize(known, cell, METHODS["plan"], rng, quick).moves for cell in known.cells
    )
    for candidates in known.alike.values():
        one = best._best(candidates, 1)[0]
        assert one <= least(candidates, 4) + 1e-9
