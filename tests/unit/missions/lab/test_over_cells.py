"""An aircraft finds its cell by the boundary of what it has mapped."""

from __future__ import annotations

import numpy as np
import pytest

from missions.errors import LocalizationError
from missions.lab.localization.belief import Noise
from missions.lab.localization.over_cells import anywhere, looked, off_by
from missions.units import Cell

NOISE = Noise(0.03, 0.03)
BOX = [Cell(e, n) for e in range(-8, 9) for n in range(-8, 9)]
# a region with a notch, so that no two places of its boundary are alike for long
REGION = {c for c in BOX if c.east + c.north < 3 and not (c.east in (0, 1) and c.north > -3)}


def verdicts(true: Cell, told: Cell, rng: np.random.Generator) -> dict[Cell, bool]:
    """What a frame over `true` says, told as if it were over `told`."""
    return {
        Cell(told.east + e, told.north + n): (Cell(true.east + e, true.north + n) in REGION)
        != (rng.random() < 0.03)
        for e in (-1, 0, 1)
        for n in (-1, 0, 1)
    }


@pytest.mark.parametrize("off", [(0, 0), (2, -1), (-3, 2)])
def test_some_looks_on_the_way_say_where_it_is(off: tuple[int, int]) -> None:
    rng = np.random.default_rng(5)
    decided = {cell: cell in REGION for cell in BOX}
    true = Cell(-2, 3)
    told = Cell(true.east + off[0], true.north + off[1])
    belief = looked(anywhere(decided, told, 4), verdicts(true, told, rng), told, NOISE)
    for east, north in ((1, 0), (1, 0), (1, 0), (0, -1), (0, -1), (1, 0)):
        true = Cell(true.east + east, true.north + north)
        told = Cell(told.east + east, told.north + north)
        belief = looked(belief.moved(east, north, 0.02), verdicts(true, told, rng), told, NOISE)
    assert off_by(belief, told) == off


def test_inside_the_region_nothing_is_said() -> None:
    decided = dict.fromkeys(BOX, True)
    told = Cell(0, 0)
    belief = anywhere(decided, told, 3)
    for _ in range(5):
        seen = {Cell(e, n): True for e in (-1, 0, 1) for n in (-1, 0, 1)}
        belief = looked(belief, seen, told, NOISE)
    assert off_by(belief, told) is None


def test_without_a_map_there_is_nothing_to_be_found_on() -> None:
    with pytest.raises(LocalizationError, match="nothing is decided within 2 cells"):
        anywhere({Cell(0, 0): True}, Cell(0, 0), 2)


def test_of_two_parts_of_a_map_the_larger_one_counts() -> None:
    decided = {c: c in REGION for c in BOX if not -3 <= c.east <= 0}
    belief = anywhere(decided, Cell(0, 0), 8)
    assert {c.east for c in belief.known.cells} == set(range(2, 8))
