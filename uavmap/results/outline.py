"""The outline of a set of cells: their union, with holes and without seams."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import shapely
from shapely import affinity
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.polygon import orient

from missions.ground.grid import Grid
from missions.units import Cell


def outline(cells: Collection[Cell], grid: Grid) -> Polygon | MultiPolygon:
    """The union of cells in ground metres of the grid's moving frame.

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
    corners = 2.0 * np.array(sorted(cells), dtype=np.float64)
    east, north = corners[:, 0], corners[:, 1]
    united = shapely.union_all(shapely.box(east - 1, north - 1, east + 1, north + 1))
    half_m = grid.cell_m / 2
    scaled = affinity.scale(united, half_m, half_m, origin=(0.0, 0.0))
    parts = [_tidy(part) for part in getattr(scaled, "geoms", [scaled])]
    return parts[0] if len(parts) == 1 else MultiPolygon(parts)


def _tidy(part: Polygon) -> Polygon:
    """A polygon without the corners that lie on straight edges."""
    rings = [_corners(ring) for ring in (part.exterior, *part.interiors)]
    return orient(Polygon(rings[0], rings[1:]))


def _corners(ring: shapely.LinearRing) -> list[tuple[float, float]]:
    """The vertices at which an axis-parallel ring turns."""
    points = [(x, y) for x, y, *_ in ring.coords[:-1]]
    around = zip(points[-1:] + points[:-1], points, points[1:] + points[:1], strict=True)
    return [
        here
        for before, here, after in around
        if not (before[0] == here[0] == after[0] or before[1] == here[1] == after[1])
    ]
