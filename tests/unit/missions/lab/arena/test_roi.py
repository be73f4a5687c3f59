"""Regions to explore without flying: their growth, and promises of their shape."""

from __future__ import annotations

import numpy as np
import pytest

from missions.errors import RoiError
from missions.lab.arena.roi import (
    KINDS,
    MAX_CELLS,
    boundary,
    component,
    eden,
    grown,
    ragged,
    rectangle,
    thin,
)
from missions.mapping.tree import distances
from missions.units import Cell

START = Cell(0, 0)
SEEDS = range(10)


def edges(cells: set[Cell] | frozenset[Cell]) -> int:
    """Return the number of pairs of cells that lie side by side."""
    return sum(near in cells for cell in cells for near in cell.neighbours()) // 2


# --- what all growths promise ----------------------------------------------------------------
@pytest.mark.parametrize("kind", ["eden", "ragged", "rectangle"])
@pytest.mark.parametrize("size", [1, 2, 17, 120])
def test_a_growth_has_as_many_cells_as_asked_for(kind, size):
    assert len(KINDS[kind](size, np.random.default_rng(3))) == size


# --- their shapes ----------------------------------------------------------------------------
@pytest.mark.parametrize("seed", SEEDS)
def test_a_thin_region_has_no_cycle_and_is_long_and_an_eden_is_round(seed):
    narrow = thin(80, np.random.default_rng(seed))
    compact = eden(len(narrow), np.random.default_rng(seed))
    assert edges(narrow) == len(narrow) - 1 < edges(compact)
    assert max(distances(narrow, START).values()) >= max(distances(compact, START).values())


def holes(cells: set[Cell]) -> int:
    """Return the number of cells outside that cannot be reached from far away."""
    east = [c.east for c in cells]
    north = [c.north for c in cells]
    around = {
        Cell(e, n)
        for e in range(min(east) - 1, max(east) + 2)
        for n in range(min(north) - 1, max(north) + 2)
    } - cells
    return len(around) - len(component(around, Cell(min(east) - 1, min(north) - 1)))


def test_ragged_regions_have_holes_and_rectangles_have_none():
    assert sum(holes(ragged(120, np.random.default_rng(s))) for s in SEEDS) > 20
    assert all(holes(rectangle(120, np.random.default_rng(s))) == 0 for s in SEEDS)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("size", [1, 6, 35, 120])
def test_a_rectangle_is_one_but_for_its_last_row(size, seed):
    cells = rectangle(size, np.random.default_rng(seed))
    width = max(c.east for c in cells) + 1
    height = max(c.north for c in cells) + 1
    full = {Cell(e, n) for e in range(width) for n in range(height - 1)}
    assert full <= cells
    last = sorted(c.east for c in cells - full)
    assert last == list(range(len(last)))
    assert width <= 4 * (height + 1) * 2


# --- boundaries and regions ------------------------------------------------------------------
def test_boundary_is_the_cells_that_touch_the_outside():
    block = {Cell(e, n) for e in range(4) for n in range(3)}
    inner = {Cell(1, 1), Cell(2, 1)}
    assert set(boundary(block)) == block - inner
    assert boundary(block) == sorted(block - inner)
    assert boundary([START]) == [START]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_a_grown_region_starts_at_its_rim(kind, seed):
    roi = grown(kind, 50, seed)
    assert roi.start in boundary(roi.cells)
    assert roi.name == f"{kind}:50:{seed}"
    assert roi == grown(kind, 50, seed)
    assert component(roi.cells, roi.start) == roi.cells
    assert START in roi.cells


# --- what is refused -------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("kind", "cells", "message"),
    [
        ("blob", 10, "'blob' is not a kind of ROI; choose one of eden"),
        *(("eden", n, f"a ROI of {n} cells cannot be grown") for n in (0, -1, MAX_CELLS + 1)),
    ],
)
def test_region_that_cannot_be_grown_is_refused(kind, cells, message):
    with pytest.raises(RoiError, match=message):
        grown(kind, cells, 1)
