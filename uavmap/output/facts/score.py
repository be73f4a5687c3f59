"""The score of a map against the truth, which only a simulation knows.

Definitions, for cells of the grid and the true region in the grid's moving frame:

* A cell is *truly ROI* when the region covers at least half of it. It is *missed* when it is truly
  ROI and not on the map.
* `iou_cells` is area(map and truth) / area(map or truth), where the map is its ROI cells. For a
  runway rotated against the grid, a perfect cell map reaches at most 0.89.
* A detection is one verdict of the detector for one cell. A *false positive* is a vote for region
  when less than a tenth of the cell is region.
* A *false negative* is a vote against region when at least half of the cell is. Between these
  shares, at the rim, either verdict is right.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry
from shapely.ops import unary_union

from missions.geo.grid import Grid
from missions.mission.schema import Mission, positions
from missions.units import Cell
from uavmap.output.facts.cell_outlines import outline

MISSED_SHARE = 0.5
"""Minimum share at which a cell belongs on the map, and a vote against region is wrong."""
CLEAR_SHARE = 0.1
"""Share below which a vote for region is wrong."""


@dataclass(frozen=True, slots=True)
class Score:
    """A map and its detections against the truth. Shares are 0 to 1, the rest are counts."""

    iou_cells: float
    cells_missed: int
    false_positives: int
    false_negatives: int


def score(
    roi_cells: Collection[Cell],
    truth: BaseGeometry,
    grid: Grid,
    detections: Iterable[tuple[Cell | None, Cell, bool]],
) -> Score:
    """Score a map.

    Args:
        roi_cells: The ROI cells of the map.
        truth: The region in ground metres of the grid's moving frame; valid, may be empty.
        detections: Vantage (None: anywhere), judged cell and verdict of each.
    """
    verdicts = [(target, positive) for _, target, positive in detections]
    near = cells_near(truth, grid)
    shares = shares_of({*near, *(target for target, _ in verdicts)}, truth, grid)
    true_cells = {cell for cell in near if shares[cell] >= MISSED_SHARE}
    mapped = outline(roi_cells, grid)
    union_m2 = mapped.union(truth).area
    return Score(
        # without a region, an empty map is right
        iou_cells=mapped.intersection(truth).area / union_m2 if union_m2 else 1.0,
        cells_missed=len(true_cells - set(roi_cells)),
        false_positives=sum(1 for cell, yes in verdicts if yes and shares[cell] < CLEAR_SHARE),
        false_negatives=sum(
            1 for cell, yes in verdicts if not yes and shares[cell] >= MISSED_SHARE
        ),
    )


def cells_near(truth: BaseGeometry, grid: Grid) -> list[Cell]:
    """Return every cell of the rectangle around the region: columns from the west, northwards."""
    if truth.is_empty:
        return []
    first_east, first_north, last_east, last_north = (
        math.floor(bound / grid.cell_m + 0.5) for bound in truth.bounds
    )
    return [
        Cell(east, north)
        for east in range(first_east, last_east + 1)
        for north in range(first_north, last_north + 1)
    ]


def shares_of(cells: Collection[Cell], truth: BaseGeometry, grid: Grid) -> dict[Cell, float]:
    """Return the part of each cell that the region covers, 0 to 1, in the given order.

    >>> from missions.units import LatLon
    >>> grid = Grid.at(LatLon(48.0, 11.0), cell_m=4.0)
    >>> shares_of([Cell(0, 0)], shapely.box(0, -9, 9, 9), grid)
    {Cell(east=0, north=0): 0.5}
    """
    if not cells:
        return {}
    centres = grid.cell_m * np.array(list(cells), dtype=np.float64)
    half_m = grid.cell_m / 2
    east, north = centres[:, 0], centres[:, 1]
    boxes = shapely.box(east - half_m, north - half_m, east + half_m, north + half_m)
    shapely.prepare(truth)
    # most cells are wholly inside or outside: only the rim needs an intersection
    shares = shapely.contains(truth, boxes).astype(np.float64)
    rim = shapely.intersects(truth, boxes) & (shares == 0.0)
    shares[rim] = shapely.area(shapely.intersection(truth, boxes[rim])) / grid.cell_m**2
    return dict(zip(cells, shares.tolist(), strict=True))


def true_roi(mission: Mission, grid: Grid) -> BaseGeometry:
    """Return the true ROI of a mission's simulated world, in the grid's moving frame."""
    return unary_union(
        [
            Polygon(
                [grid.fixed(p) for p in positions(region.polygon)],
                [[grid.fixed(p) for p in positions(hole)] for hole in region.holes],
            )
            for region in mission.sim.roi
        ]
    )
