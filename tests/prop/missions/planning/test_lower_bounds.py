"""Lower bounds against exact search on small ROIs, and against the values of larger sets."""

from __future__ import annotations

import heapq
import json
import math
import os
from collections.abc import Callable, Collection, Iterable
from pathlib import Path

import numpy as np
import pytest

from missions.lab.arena.arena_run import certify, run
from missions.lab.arena.roi import KINDS, Roi, grown
from missions.planning import lower_bounds
from missions.planning.lower_bounds import (
    LowerBounds,
    drift_lower_bound,
    flight_lower_bound,
    one_way_lower_bound,
)
from missions.planning.stepwise import EXPLORERS
from missions.planning.stepwise.interface import Metric
from missions.units import Cell

SHARED = os.environ.get("UAVMAP_SHARED") or Path(__file__).resolve().parents[4] / "../shared"
SETS = sorted((Path(SHARED) / "data/roi").glob("*.json"))


def tours(
    cells: list[Cell], metric: Metric, ways: Callable[[Cell], Iterable[Cell]], *, closed: bool
) -> list[float]:
    """Return for every set of cells (as bits) the least time of a path from cells[0] over it.

    It is Dijkstra's algorithm over (place, visited cells); a look is paid at the first visit.
    """
    names = {cell: i for i, cell in enumerate(cells)}
    best = [math.inf] * (1 << len(cells))
    done: set[tuple[int, int]] = set()
    heap = [(0.0, 0, 1)]
    while heap:
        t, at, seen = heapq.heappop(heap)
        if (at, seen) in done:
            continue
        done.add((at, seen))
        if at == 0 or not closed:
            best[seen] = min(best[seen], t)
        for near in ways(cells[at]):
            if near in names and near != cells[at]:
                to = names[near]
                look = 0.0 if seen >> to & 1 else metric.look
                leg = metric.leg(cells[at], near) + look
                heapq.heappush(heap, (t + leg, to, seen | 1 << to))
    for i in range(len(cells)):  # a path that visits more cells has also visited these
        for seen in range(len(best)):
            if not seen >> i & 1:
                best[seen] = min(best[seen], best[seen | 1 << i])
    return best


def optimum(best: list[float], robots: int) -> float:
    team = best
    for _ in range(robots - 1):
        larger = list(team)
        for seen in range(len(best)):
            part = seen
            while part:
                larger[seen] = min(larger[seen], max(best[part], team[seen ^ part]))
                part = (part - 1) & seen
        team = larger
    return team[-1]


def small(seed: int, most: int) -> tuple[Roi, list[Cell]]:
    rng = np.random.default_rng(seed)
    roi = grown(sorted(KINDS)[seed % len(KINDS)], int(rng.integers(2, most + 1)), seed)
    return roi, [roi.start, *sorted(roi.cells - {roi.start})]


def drifting(seed: int, **values: float | bool) -> Metric:
    rng = np.random.default_rng([seed, 1])
    speed, drift, toward = rng.uniform(0.5, 3.0), rng.uniform(0.0, 0.9), rng.uniform(0.0, 6.3)
    return Metric(
        speed, speed * drift * math.sin(toward), speed * drift * math.cos(toward), **values
    )


# --- steps -----------------------------------------------------------------------------------
@pytest.mark.parametrize("block", range(8))
def test_no_team_beats_the_bound(block):
    tight = 0
    for seed in range(12 * block, 12 * block + 12):
        roi, cells = small(seed, 9)
        bounds = LowerBounds.from_roi(roi.cells, roi.start)
        best = tours(cells, Metric(), Cell.neighbours, closed=True)
        for robots in (1, 2, 3):
            exact = optimum(best, robots)
            assert bounds.moves(robots) <= exact, (roi, robots)
            tight += bounds.moves(robots) == exact
    assert tight > 12  # not by being far too low


@pytest.mark.parametrize("block", range(4))
def test_no_team_beats_the_bound_with_a_drift(block):
    for seed in range(8 * block, 8 * block + 8):
        roi, cells = small(seed, 8)
        metric = drifting(seed)
        best = tours(cells, metric, Cell.neighbours, closed=True)
        for robots in (1, 2):
            lower = drift_lower_bound(
                LowerBounds.from_roi(roi.cells, roi.start).moves(robots), metric
            )
            assert lower <= optimum(best, robots) * (1 + 1e-12)


@pytest.mark.parametrize("block", range(5))
def test_no_team_beats_the_bound_in_straight_flight(block):
    for seed in range(6 * block, 6 * block + 6):
        roi, cells = small(seed, 7)
        metric = drifting(seed, straight=True, look=float(seed % 3))
        back = tours(cells, metric, lambda _, cells=cells: cells, closed=True)
        away = tours(cells, metric, lambda _, cells=cells: cells, closed=False)
        for robots in (1, 2, 3):
            room = 1 + 1e-12
            lower = flight_lower_bound(roi.cells, roi.start, robots, metric)
            assert lower <= optimum(back, robots) * room
            one_way = one_way_lower_bound(roi.cells, roi.start, robots, metric)
            assert one_way <= optimum(away, robots) * room
            for breaks in (1, 2):
                broken = one_way_lower_bound(roi.cells, roi.start, robots, metric, breaks)
                assert broken <= one_way


def test_a_break_saves_a_leg_and_the_way_from_the_start():
    row = [Cell(i, 0) for i in range(6)]
    metric = Metric(straight=True)
    assert one_way_lower_bound(row, row[0], 1, metric) == 5.0
    assert one_way_lower_bound(row, row[0], 1, metric, breaks=1) == 3.0
    assert one_way_lower_bound(row, row[0], 1, metric, breaks=9) == 0.0


@pytest.mark.skipif(not SETS, reason="the ROI sets are not here")
@pytest.mark.parametrize("path", SETS, ids=lambda path: path.stem)
def test_bounds_of_the_shared_sets(path):
    for number, values in enumerate(json.loads(path.read_text("utf-8"))["rois"]):
        cells: Collection[Cell] = {Cell(*cell) for cell in values["cells"]}
        bounds = LowerBounds.from_roi(cells, Cell(*values["start"]))
        assert values["lower_bound"]
        for robots, moves in values["lower_bound"].items():
            assert bounds.moves(int(robots)) == moves, (number, robots)


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_bounds_are_the_same_compiled_or_not(kind, monkeypatch):
    for seed, cells in enumerate((2, 9, 60, 400)):
        roi = grown(kind, cells, seed)
        found = []
        for compiled_from in (1, 10**9):
            monkeypatch.setattr(lower_bounds, "COMPILED_FROM", compiled_from)
            found.append(LowerBounds.from_roi(roi.cells, roi.start))
        assert found[0] == found[1]
        assert all(type(shell.block_steps) is int for shell in found[0].shells)


# --- certificates ----------------------------------------------------------------------------
@pytest.mark.parametrize("seed", range(12))
def test_a_run_lies_between_its_bounds(seed):
    roi = grown(sorted(KINDS)[seed % len(KINDS)], 50, seed)
    robots = seed % 5 + 1
    metric = drifting(seed) if seed % 2 else Metric()
    bounds = LowerBounds.from_roi(roi.cells, roi.start)
    for name in ("rdfs", "rdfs-paper"):
        done = run(EXPLORERS[name], roi.cells, roi.start, robots, metric=metric)
        certificate = certify(done, EXPLORERS[name], robots, metric, bounds)
        assert certificate.makespan >= certificate.lower_bound > 0.0
        assert certificate.cells == 50
        assert certificate.bound_held is (True if name == "rdfs" else None)
    assert certificate.lower_bound >= flight_lower_bound(roi.cells, roi.start, robots, metric)


TERMS = {
    "resting": Metric(speed=2.0),
    "drifting": Metric(speed=2.0, drift_east=0.7),
    "with looks": Metric(look=1.5),
    "straight": Metric(straight=True),
}


@pytest.mark.parametrize(
    ("name", "robots", "stated"),
    [
        ("bfdn", 1, {"resting", "drifting", "with looks", "straight"}),
        ("bfdn", 3, {"resting", "straight"}),  # it never leaves the tree, so its moves are equal
        ("greedy", 1, {"resting", "drifting", "with looks"}),
        ("greedy", 3, set()),
        ("smartdfs", 1, {"resting", "drifting", "with looks", "straight"}),
        ("rdfs", 3, {"resting", "drifting", "with looks", "straight"}),
        ("hungarian", 1, set()),
    ],
)
def test_bound_is_stated_where_its_theorem_holds(name, robots, stated):
    roi = grown("ragged", 40, 5)
    bounds = LowerBounds.from_roi(roi.cells, roi.start)
    for terms, metric in TERMS.items():
        done = run(EXPLORERS[name], roi.cells, roi.start, robots, metric=metric)
        certificate = certify(done, EXPLORERS[name], robots, metric, bounds)
        assert certificate.bound_held is (True if terms in stated else None), terms


def test_region_of_the_start_alone_takes_no_time():
    start = Cell(0, 0)
    done = run(EXPLORERS["rdfs"], {start}, start, 2)
    certificate = certify(
        done, EXPLORERS["rdfs"], 2, Metric(), LowerBounds.from_roi({start}, start)
    )
    assert (certificate.makespan, certificate.lower_bound) == (0.0, 0.0)
    assert certificate.bound_held
