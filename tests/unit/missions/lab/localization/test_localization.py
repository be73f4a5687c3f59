"""Localization: the paper's grids by hand, the fall-back of the planner, beliefs."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from missions.errors import LocalizationError
from missions.lab.arena.roi import grown
from missions.lab.localization.grid_map import RING, GridMap, chevrons, corridor, studded
from missions.lab.localization.localization_planner import Planner, homing_bound, plan
from missions.lab.localization.localization_run import METHODS, Method, localize
from missions.lab.localization.noisy_run import Belief, Errors, Noise, localize_with_errors
from missions.units import Cell

RNG = np.random.default_rng
FLOWN = Noise(27 / 483, 53 / 483)
"""Counts of Sung and Tokekar in flight."""


# --- the paper's grids -----------------------------------------------------------------------
@pytest.mark.parametrize(("k", "m", "moves"), [(4, 5, 303), (20, 40, 10045)])
def test_homing_on_the_chevrons_of_figure_6(k, m, moves):
    cells, start = chevrons(k, m)
    known = GridMap.from_cells(cells)
    assert known.size == 4 * k * m + 8 * m + 4 * k + 4
    done = localize(known, start, METHODS["homing"], RNG(1))
    assert done.right
    assert done.moves == moves
    assert 0 < moves - m * (12 * k + 7) < 9 * k  # 12 k + 7 around each obstacle, then the border
    if k == 20:
        assert round(done.moves / known.size, 3) == 2.787


@pytest.mark.parametrize("k", [1, 3, 50])
def test_the_studded_squares_of_lemma_8(k):
    known = GridMap.from_cells(studded(k))
    assert known.size == 3 * k**2 + 4 * k + 1
    assert known.circumnavigation == 8 * k**2 + 8 * k
    assert known.labels[0] == 0
    if k == 50:
        assert round(known.circumnavigation / known.size, 3) == 2.649


@pytest.mark.parametrize("cells", [3, 4, 7, 20])
def test_no_method_in_a_corridor_is_faster_than_theorem_3_allows(cells):
    known = GridMap.from_cells(corridor(cells))
    for method in METHODS.values():
        if method.bound is not None:
            for planner in (Planner(known), None)[: 1 if method.needs_map else 2]:
                done = [localize(known, at, method, RNG(1), planner) for at in known.cells]
                assert cells - 3 <= max(one.moves for one in done) <= method.bound(cells)


# --- the planner -----------------------------------------------------------------------------
@pytest.mark.parametrize("spare", [0, 1, 2, 4])
def test_the_planner_hands_over_to_homing_before_the_bound_is_broken(spare):
    """On this map homing may need almost all of the 4 n moves: few are left."""
    known = GridMap.from_cells(grown("rectangle", 60, 3).cells)
    planner, needed = Planner(known), homing_bound(known)
    planner.homing_bound = 4 * known.size - spare
    reported: list[Cell] = []
    for start in known.cells:
        pattern = known.patterns[known.index[start]]
        method = Method(
            "plan", lambda p, of, rng, at=start: plan(p, planner, lambda: reported.append(at)),
            lambda n: 4 * n, "", needs_map=True,
        )  # fmt: skip
        done = localize(known, start, method, RNG(1), planner)
        assert done.right
        assert done.moves <= spare + needed
        if spare == 0 and len(known.alike[pattern]) > 1:
            homing = localize(known, start, METHODS["homing"], RNG(1), planner)
            assert done.moves == homing.moves
            assert reported[-1] == start
    assert reported


def test_the_planner_needs_fewer_moves_than_homing_on_average():
    total = {"plan": 0, "homing": 0}
    for seed in range(3):
        known = GridMap.from_cells(grown("eden", 120, seed).cells)
        planner = Planner(known)
        for name in total:
            total[name] += sum(
                localize(known, at, METHODS[name], RNG(1), planner).moves for at in known.cells
            )
    assert total["plan"] < 0.9 * total["homing"]


# --- maps ------------------------------------------------------------------------------------
def test_grid_that_is_no_map_is_refused():
    with pytest.raises(LocalizationError, match="without cells"):
        GridMap.from_cells([])
    with pytest.raises(LocalizationError, match=r"cell \(5, 0\) cannot be reached from \(0, 0\)"):
        GridMap.from_cells({Cell(0, 0), Cell(5, 0)})


# --- the belief ------------------------------------------------------------------------------
def test_a_belief_is_bayes_rule_by_hand():
    """The belief agrees with every history of a robot in an L, written out."""
    known = GridMap.from_cells({Cell(0, 0), Cell(1, 0), Cell(1, 1)})
    fp, fn, slip = 0.1, 0.2, 0.3

    def likelihood(cell: Cell, seen: int) -> float:
        value = 1.0
        for i, (de, dn) in enumerate(RING):
            free = Cell(cell.east + de, cell.north + dn) in known.index
            expected = bool(seen >> i & 1)
            value *= (1 - fn if expected else fn) if free else (fp if expected else 1 - fp)
        return value

    def landed(cell: Cell, de: int, dn: int) -> Cell:
        there = Cell(cell.east + de, cell.north + dn)
        return there if there in known.index else cell

    first, second = 0b01000100, 0b00000101
    mass = dict.fromkeys(known.cells, 0.0)
    for cell in known.cells:
        before = likelihood(cell, first)
        mass[landed(cell, 1, 0)] += before * (1 - slip)
        for de, dn in ((0, 0), (-1, 0), (0, 1), (0, -1)):
            mass[landed(cell, de, dn)] += before * slip / 4
    for cell in known.cells:
        mass[cell] *= likelihood(cell, second)
    noise = Noise(fp, fn)
    belief = Belief.uniform(known).saw(first, noise).moved(1, 0, slip).saw(second, noise)
    want = np.array([mass[cell] for cell in known.cells])
    assert belief.mass == pytest.approx(want / want.sum())
    assert belief.best == max(mass, key=lambda cell: mass[cell])


def test_a_belief_without_errors_is_the_set_of_cells_that_fit():
    known = GridMap.from_cells(corridor(5))
    belief = Belief.uniform(known).saw(known.patterns[2])
    assert belief.mass.tolist() == [0.0, 1 / 3, 1 / 3, 1 / 3, 0.0]
    belief = belief.moved(-1, 0).saw(known.patterns[0])
    assert (belief.best, belief.confidence) == (Cell(0, 0), 1.0)


def test_a_belief_takes_looks_at_some_neighbours_and_moves_of_several_cells():
    known = GridMap.from_cells(corridor(7))
    belief = Belief.uniform(known).saw(0b100, judged=0b01000100)  # only its west and its east
    assert (belief.best, belief.confidence) == (Cell(6, 0), 1.0)
    assert belief.moved(-4, 0).best == Cell(2, 0)
    assert belief.moved(0, 0, 0.5).mass.tolist() == belief.mass.tolist()


def test_an_aircraft_may_be_beside_the_region():
    """The aircraft has possible places, and a look at the cell below: is it region?"""
    region = {Cell(1, 1), Cell(2, 1)}
    box = {Cell(east, north) for east in range(4) for north in range(3)}
    known = GridMap.from_cells(region, box)
    belief = Belief.uniform(known).saw(0b01000000, own=False)
    assert belief.best == Cell(0, 1)
    assert belief.moved(1, 0).saw(0b01000000, own=True).best == Cell(1, 1)
    unsure = Belief.uniform(known).saw(0b01000000, Noise(0.1, 0.1), own=False)
    assert 0.5 < unsure.confidence < 1.0


def test_observation_that_fits_nowhere_is_reported():
    with pytest.raises(LocalizationError, match="fits no cell of the map"):
        Belief.uniform(GridMap.from_cells(corridor(4))).saw(0b1)


@pytest.mark.parametrize(
    "make",
    [lambda: Noise(0.5, 0.0), lambda: Noise(0.0, -0.1), lambda: Errors(slip=0.95),
     lambda: Errors(confidence=1.0),
     lambda: Belief.uniform(GridMap.from_cells(corridor(2))).moved(1, 0, 1.5)],
)  # fmt: skip
def test_rates_that_are_none_are_refused(make):
    with pytest.raises(LocalizationError, match="expected"):
        make()


# --- with errors -----------------------------------------------------------------------------
@pytest.mark.parametrize(("name", "runs"), [("plan", 150), ("depth-first", 80), ("homing", 30)])
def test_answer_with_95_percent_is_right_that_often(name, runs):
    known = GridMap.from_cells(grown("ragged", 120, 3).cells)
    errors = Errors(FLOWN, slip=0.02)
    done = []
    for seed in range(runs):
        rng = RNG(seed)
        start = known.cells[int(rng.integers(known.size))]
        done.append(localize_with_errors(known, start, METHODS[name], errors, rng))
    assert all(one.confidence >= 0.95 for one in done)
    assert sum(one.right for one in done) >= 0.95 * runs


def test_a_robot_that_does_not_err_is_certain_and_right_with_a_belief_too():
    known = GridMap.from_cells(grown("ragged", 60, 4).cells)
    for method in METHODS.values():
        for seed, start in enumerate(known.cells[::9]):
            done = localize_with_errors(known, start, method, Errors(confidence=0.9999), RNG(seed))
            assert done.right
            assert done.confidence > 0.9999


def test_a_demand_that_is_higher_takes_more_moves():
    known = GridMap.from_cells(grown("eden", 120, 1).cells)

    def moves(confidence: float) -> int:
        errors = Errors(FLOWN, 0.02, confidence)
        return sum(
            localize_with_errors(known, at, METHODS["plan"], errors, RNG(1)).moves
            for at in known.cells[::6]
        )

    assert moves(0.6) < moves(0.95) < moves(0.9995)


PAGE = (Path(__file__).parents[5] / "docs" / "explanation" / "localization.md").read_text("utf-8")


def test_the_example_of_the_page_runs():
    (block,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    exec(compile(block, "page", "exec", dont_inherit=True), {"__name__": "page"})


def test_the_table_has_every_method_with_its_promise():
    rows = re.findall(r"^\| `([a-z-]+)` \| [^|]+ \| ([^|]+) \| [^|]+ \|$", PAGE, re.MULTILINE)
    assert rows == [(m.name, m.promise) for m in METHODS.values()]
