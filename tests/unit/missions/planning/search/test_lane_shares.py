"""Lanes are shared by time: the slowest is soonest at home, and nobody crosses another's way."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from missions.planning.search.lanes import longest_m, share_by_time, tour_m
from missions.units import GridPoint


def beside(count: int, apart_m: float, length_m: float) -> list[tuple[GridPoint, GridPoint]]:
    return [(GridPoint(k * apart_m, 0.0), GridPoint(k * apart_m, length_m)) for k in range(count)]


@pytest.mark.parametrize("seed", range(6))
def test_no_other_cuts_have_the_slowest_at_home_sooner(seed: int) -> None:
    rng = np.random.default_rng(seed)
    lanes = beside(7, 40.0, float(rng.uniform(50, 400)))
    pads = sorted(GridPoint(float(x), -5.0) for x in rng.uniform(0, 240, 3))
    blocks = share_by_time(lanes, pads)
    best_m = min(
        longest_m((tuple(lanes[:a]), tuple(lanes[a:b]), tuple(lanes[b:])), pads)
        for a, b in itertools.combinations_with_replacement(range(8), 2)
    )
    assert longest_m(blocks, pads) <= 1.02 * best_m + 1e-6
    flown = {frozenset(lane) for block in blocks for lane in block}
    assert flown == {frozenset(lane) for lane in lanes}


def test_two_lanes_are_flown_out_and_back() -> None:
    way_m, flown = tour_m(GridPoint(0.0, 0.0), beside(2, 30.0, 100.0))
    assert way_m == 260.0
    assert [lane[0].north_m for lane in flown] == [0.0, 100.0]


def test_who_stands_in_the_middle_gets_the_lanes_in_the_middle() -> None:
    lanes = beside(9, 155.0, 1000.0)
    pads = [GridPoint(x, 0.0) for x in (570.0, 670.0, 595.0, 645.0, 620.0)]
    blocks = share_by_time(lanes, pads)
    assert [len(block) for block in blocks] == [2, 2, 2, 2, 1]
    assert blocks[4][0][0].east_m == 620.0
    assert share_by_time((), pads) == ((),) * 5
