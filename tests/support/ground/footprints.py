"""Cells that a level picture shows whole: the reference for the judgements of vision."""

from __future__ import annotations

import math

from missions.geo.footprint import TOUCH_M, Footprint
from missions.units import Cell, GridPoint


def whole_cells(
    footprint: Footprint,
    centre: GridPoint,
    bearing_rad: float,
    cell_m: float,
    margin_m: float = 0.0,
) -> tuple[Cell, ...]:
    """Return the cells wholly inside and `margin_m` from the rim, sorted by column and row.

    `centre` is the ground below the camera; the upper edge of the picture points to `bearing_rad`,
    clockwise from grid north.
    """
    cos, sin = math.cos(bearing_rad), math.sin(bearing_rad)
    # extent of a cell from its centre, along either side of the picture
    reach_m = cell_m / 2.0 * (abs(cos) + abs(sin)) + margin_m - TOUCH_M
    across_m, along_m = footprint.across_m / 2.0 - reach_m, footprint.along_m / 2.0 - reach_m
    if across_m < 0.0 or along_m < 0.0:
        return ()
    east_m = abs(cos) * across_m + abs(sin) * along_m
    north_m = abs(sin) * across_m + abs(cos) * along_m
    found = []
    for east in _between(centre.east_m, east_m, cell_m):
        for north in _between(centre.north_m, north_m, cell_m):
            away_e, away_n = east * cell_m - centre.east_m, north * cell_m - centre.north_m
            if (
                abs(away_e * cos - away_n * sin) <= across_m
                and abs(away_e * sin + away_n * cos) <= along_m
            ):
                found.append(Cell(east, north))
    return tuple(found)


def _between(middle_m: float, reach_m: float, cell_m: float) -> range:
    """Return the columns, or rows, whose centre is within a distance of a coordinate."""
    first = math.ceil((middle_m - reach_m) / cell_m)
    return range(first, math.floor((middle_m + reach_m) / cell_m) + 1)
