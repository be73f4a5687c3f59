"""Outlines of cells, their neighbours, and their runs in rows."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import affinity
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.polygon import orient

from missions.geo.grid import Grid
from missions.units import Cell

Runs = list[tuple[int, int, int]]
"""Row, first and last column of neighbours in a row."""


def outline(cells: Collection[Cell], grid: Grid) -> Polygon | MultiPolygon:
    """Unite cells in ground metres of the grid's moving frame.

    Exterior rings run counter-clockwise, holes clockwise. Cells that share only a corner are
    separate parts. No cells give an empty polygon.

    >>> from missions.units import LatLon
    >>> shape = outline([Cell(0, 0), Cell(1, 0)], Grid.at(LatLon(48.0, 11.0), cell_m=4.0))
    >>> shape.bounds, len(shape.exterior.coords)
    ((-2.0, -2.0, 6.0, 2.0), 5)
    """
    if not cells:
        return Polygon()
    # on the lattice of half cells, corners are whole numbers and edges meet exactly
    row, first, last = 2.0 * np.array(runs(np.array(list(cells))), dtype=np.float64).T
    united = shapely.union_all(shapely.box(first - 1, row - 1, last + 1, row + 1))
    half_m = grid.cell_m / 2
    scaled = affinity.scale(united, half_m, half_m, origin=(0.0, 0.0))
    parts = []
    for part in getattr(scaled, "geoms", [scaled]):
        outer, *holes = (_corners(ring) for ring in (part.exterior, *part.interiors))
        parts.append(orient(Polygon(outer, holes)))
    return parts[0] if len(parts) == 1 else MultiPolygon(parts)


def runs(cells: NDArray[np.integer]) -> Runs:
    """Return row, first and last column of each run of neighbours.

    >>> runs(np.array([[4, 1], [5, 1], [7, 1], [5, 2]]))
    [(1, 4, 5), (1, 7, 7), (2, 5, 5)]
    """
    if not len(cells):
        return []
    order = np.lexsort((cells[:, 0], cells[:, 1]))
    columns, rows = cells[order].T
    breaks = np.flatnonzero((np.diff(rows) != 0) | (np.diff(columns) != 1))
    first, last = np.r_[0, breaks + 1], np.r_[breaks, len(rows) - 1]
    return list(
        zip(rows[first].tolist(), columns[first].tolist(), columns[last].tolist(), strict=True)
    )


def _corners(ring: shapely.LinearRing) -> NDArray[np.float64]:
    """Return the points at which an axis-parallel ring turns."""
    points = shapely.get_coordinates(ring)[:-1]
    before, after = (np.roll(points, by, axis=0) for by in (1, -1))
    straight = ((before == points) & (points == after)).any(axis=1)
    found: NDArray[np.float64] = points[~straight]
    return found


NEIGHBOURS: Final = np.array([[0, 1], [1, 0], [0, -1], [-1, 0]], np.int32)


def open_sides(cells: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Return for each cell which of its four neighbours are not among the cells, (n, 4).

    >>> open_sides(np.array([[0, 0], [1, 0]], np.int32)).tolist()
    [[True, False, True, True], [True, True, True, False]]
    """
    near = packed((cells[:, None] + NEIGHBOURS).reshape(-1, 2))
    return ~np.isin(near, packed(cells)).reshape(-1, 4)


def packed(cells: NDArray[np.int32]) -> NDArray[np.int64]:
    """Pack each cell into a whole number, in the order of the cells.

    >>> packed(np.array([[0, -1], [0, 1], [1, 0]], np.int32)).argsort().tolist()
    [0, 1, 2]
    """
    found: NDArray[np.int64] = (cells[:, 0].astype(np.int64) << 32) + cells[:, 1]
    return found
