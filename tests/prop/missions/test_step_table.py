"""Steps kept from one decision to the next are those counted anew."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.explorers.grid_paths import distances
from missions.explorers.step_table import StepTable
from missions.lab.arena.roi import KINDS, grown
from missions.units import Cell

RIM = 3


@dataclass
class Asked:
    """A region that changes, and what is asked of the table about it."""

    table: StepTable = field(default_factory=StepTable)

    def between(self, region: set[Cell], sites: list[Cell]) -> np.ndarray:
        """As from the arrays of the planner."""
        west, south = (min(c[axis] for c in region) - RIM for axis in (0, 1))
        width, height = (max(c[axis] for c in region) + RIM + 1 - low
                         for axis, low in ((0, west), (1, south)))  # fmt: skip
        places = {c: (c.north - south) * width + c.east - west for c in region}
        cells = np.array(sorted(places.values()), np.int32)
        numbers = np.searchsorted(cells, [places[c] for c in sites]).astype(np.int32)
        return self.table.between(Cell(west, south), width, height, cells, numbers)


def counted(region: set[Cell], sites: list[Cell]) -> list[list[float]]:
    """By a search from every site."""
    by_site = [distances(region, site) for site in sites]
    return [[float(steps.get(cell, -1)) for cell in sites] for steps in by_site]


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    kind=st.sampled_from(sorted(KINDS)),
    size=st.integers(1, 150),
    changes=st.integers(1, 12),
)
def test_after_cells_and_sites_came_and_went_every_way_is_as_long_as_counted_anew(
    seed: int, kind: str, size: int, changes: int
) -> None:
    """Cells leave whose loss opens a ring, makes a detour, or cuts the region in two."""
    rng = np.random.default_rng(seed)
    roi = sorted(grown(kind, size, seed).cells)
    asked = Asked()
    region = {cell for cell in roi if rng.random() < 0.8} or {roi[0]}
    for _ in range(10):
        for i in rng.integers(len(roi), size=changes).tolist():
            region ^= {roi[i]}
        region = region or {roi[0]}
        known = sorted(region)
        sites = [known[i] for i in rng.integers(len(known), size=int(rng.integers(1, 12)))]
        assert asked.between(region, sites).tolist() == counted(region, sites)


def test_a_table_grows_with_the_region_and_its_sites() -> None:
    """Beyond its frame in every direction, its cells and its columns."""
    asked = Asked()
    for size in (1, 4, 12, 30, 31, 13):
        region = {Cell(e, n) for e in range(-size, size + 1) for n in range(-size, size + 1)}
        region -= {Cell(e, 0) for e in range(1 - size, size)}
        sites = sorted(region)[:: max(1, len(region) // (4 * size))]
        assert asked.between(region, sites).tolist() == counted(region, sites)


def test_two_lines_of_decisions_may_share_a_table() -> None:
    asked = Asked()
    row = {Cell(e, 0) for e in range(40)}
    ring = row | {Cell(e, n) for e in (0, 39) for n in (1, 2)} | {Cell(e, 3) for e in range(40)}
    ends = [Cell(0, 0), Cell(39, 0), Cell(20, 0)]
    for region in (row, ring, row, ring - {Cell(10, 0)}, row, ring):
        assert asked.between(region, ends).tolist() == counted(region, ends)


@pytest.mark.parametrize("gap", range(1, 39))
def test_a_ring_that_opens_is_walked_the_other_way_round(gap: int) -> None:
    asked = Asked()
    far = {Cell(e, 3) for e in range(40)} | {Cell(e, n) for e in (0, 39) for n in (1, 2)}
    ring = far | {Cell(e, 0) for e in range(40)}
    sites = [Cell(0, 0), Cell(39, 0), Cell(13, 3), Cell(0, 2)]
    for region in (ring, ring - {Cell(gap, 0)}, ring):
        assert asked.between(region, sites).tolist() == counted(region, sites)
