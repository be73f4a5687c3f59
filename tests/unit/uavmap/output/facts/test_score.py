"""Scores of maps drawn by hand, on a grid of 4 m cells."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import affinity
from shapely.geometry import Polygon, box

from missions.geo.grid import Grid
from missions.units import Cell, LatLon
from uavmap.output.facts.score import cells_near, score, shares_of

GRID = Grid.at(LatLon(37.2, -80.58), cell_m=4.0)
# columns 0 to 4 wholly, column 5 to a quarter; rows 0 and 1
TRUTH = box(-2.0, -2.0, 19.0, 6.0)
WHOLE = {Cell(column, row) for column in range(5) for row in range(2)}


@pytest.mark.parametrize(
    ("cells", "missed", "iou"),
    [
        (WHOLE, 0, 160 / 168),
        (WHOLE - {Cell(0, 0), Cell(4, 1)}, 2, 128 / 168),
        (WHOLE | {Cell(9, 9)}, 0, 160 / 184),
    ],
    ids=["without faults", "cells left out are missed", "cells too many cost IoU"],
)
def test_map_is_scored_against_the_truth(cells, missed, iou):
    result = score(cells, TRUTH, GRID, [])
    assert result.iou_cells == pytest.approx(iou)
    assert result.cells_missed == missed


def test_half_a_cell_counts_as_region():
    for east_m, missed in ((0.0, 1), (-0.1, 0)):
        assert score([], box(-2.0, -2.0, east_m, 2.0), GRID, []).cells_missed == missed


@pytest.mark.parametrize(
    ("target", "positive", "wrong"),
    [
        (Cell(2, 0), True, None),
        (Cell(2, 0), False, "negative"),
        (Cell(7, 0), True, "positive"),
        (Cell(7, 0), False, None),
        # a quarter is region: either verdict is right
        (Cell(5, 0), True, None),
        (Cell(5, 0), False, None),
    ],
)
def test_verdicts_at_the_rim_are_free(target, positive, wrong):
    result = score(WHOLE, TRUTH, GRID, [(Cell(0, 0), target, positive)] * 3)  # each counts
    assert result.false_positives == 3 * (wrong == "positive")
    assert result.false_negatives == 3 * (wrong == "negative")


def test_hole_is_not_region():
    ring = Polygon(box(-2, -2, 18, 18).exterior, [box(6, 6, 10, 10).exterior])
    assert shares_of([Cell(2, 2)], ring, GRID)[Cell(2, 2)] == 0.0
    assert score([Cell(2, 2)], ring, GRID, [(Cell(2, 1), Cell(2, 2), True)]).false_positives == 1


def test_empty_map_is_right_only_without_a_region():
    result = score([], Polygon(), GRID, [])
    assert result.iou_cells == 1.0
    assert result.cells_missed == 0
    assert score([], TRUTH, GRID, []).iou_cells == 0.0


def test_turned_runway_has_the_published_bests():
    """Of perfect cell maps: any overlap 0.77, a tenth 0.84 (143 cells), half 0.89 (120)."""
    rng = np.random.default_rng(7)
    found = {0.0: [], 0.1: [], 0.5: []}
    for _ in range(30):
        east_m, north_m = rng.uniform(-2, 2, 2)
        runway = affinity.rotate(
            box(-46 + east_m, -10.5 + north_m, 46 + east_m, 10.5 + north_m),
            rng.uniform(15, 75),
            origin=(0, 0),
        )
        shares = shares_of(cells_near(runway, GRID), runway, GRID)
        for least, results in found.items():
            cells = [cell for cell, share in shares.items() if share > 0 and share >= least]
            results.append((score(cells, runway, GRID, []).iou_cells, len(cells)))
    means = {least: np.mean(results, axis=0) for least, results in found.items()}
    assert means[0.0][0] == pytest.approx(0.77, abs=0.015)
    assert means[0.1] == pytest.approx([0.84, 143], rel=0.02)
    assert means[0.5] == pytest.approx([0.89, 120], rel=0.02)


@given(st.floats(-30, 30), st.floats(-30, 30), st.floats(1, 40), st.floats(1, 40), st.floats(0, 90))
def test_shares_add_up_to_the_region(east_m, north_m, width_m, height_m, turn_deg):
    shape = affinity.rotate(
        box(east_m, north_m, east_m + width_m, north_m + height_m), turn_deg, origin="center"
    )
    shares = shares_of(cells_near(shape, GRID), shape, GRID)
    assert all(0.0 <= share <= 1.0 + 1e-9 for share in shares.values())
    assert sum(shares.values()) * 16.0 == pytest.approx(shape.area, rel=1e-6)
