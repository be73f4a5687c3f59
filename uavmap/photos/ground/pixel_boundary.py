"""The boundary of the region at pixel level, with its uncertainty.

    Surface -> lines of P = 0.1, a level between, 0.9 -> polygons with holes -> simplified

Coordinates are ground metres of the grid's moving frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import MultiLineString, MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from uavmap.output.facts.boundary_model import Boundary, Line
from uavmap.photos.ground.surface import Surface
from vision.contours import Contours, Ring
from vision.fusion import MOST
from vision.raster import Raster

HALF: Final = 0.5
"""Probability at the boundary, unless a calibrated detector decides cells at another."""
LOW: Final = 0.1
HIGH: Final = 0.9
TOLERANCE: Final = 0.5
"""Largest error of simplified lines, pixels of the raster."""
LEAST_PART: Final = 0.5
"""Least size of a part of the region, or of a hole in it, in cells."""
_APART: Final = 0.05  # between the level of the boundary and those of its band


def boundary_of(surface: Surface, cell_m: float, level: float = HALF) -> Boundary:
    """Return where P is `level` on a surface, without parts and holes below `LEAST_PART`."""
    level = min(max(level, LOW + _APART), HIGH - _APART)
    raster, least_m2 = surface.raster, LEAST_PART * cell_m**2
    contours = {p: Contours(p * MOST - 0.5, raster.columns) for p in (LOW, level, HIGH)}
    for window, levels in surface.blocks():
        for lines in contours.values():
            lines.add(levels, window.top, window.left)
    rings = {p: list(lines.rings(least_m2 / raster.pitch_m**2)) for p, lines in contours.items()}
    shapes = {p: _polygons(raster, found) for p, found in rings.items()}
    pieces = np.asarray(shapely.linestrings(_open_parts(raster, rings[level])), object)
    open_lines = shapely.line_merge(MultiLineString(list(pieces)))
    return Boundary(
        level,
        shapes[level],
        shapes[HIGH],
        shapes[LOW],
        _many(shapely.difference(shapes[LOW], shapes[HIGH])),
        _lines(shapes[level], shapes[LOW], shapes[HIGH], raster.pitch_m),
        shapely.simplify(open_lines, TOLERANCE * raster.pitch_m),
        raster.pitch_m,
        TOLERANCE * raster.pitch_m,
    )


def _ground(raster: Raster, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return metres east and north of columns and rows."""
    east = raster.west_m + (points[:, 0] + 0.5) * raster.pitch_m
    north = raster.north_m - (points[:, 1] + 0.5) * raster.pitch_m
    return np.column_stack([east, north])


def _polygons(raster: Raster, rings: Sequence[Ring]) -> MultiPolygon:
    """Return polygons of rings, each hole in the smallest ring around it."""
    outer = [r for r in rings if r.area_px > 0.0]
    holes = [r for r in rings if r.area_px < 0.0]
    shells = [Polygon(_ground(raster, ring.points)) for ring in outer]
    owned: list[list[NDArray[np.float64]]] = [[] for _ in shells]
    if holes and shells:
        first = shapely.points([_ground(raster, ring.points)[0] for ring in holes])
        found = shapely.STRtree(shells).query(first, predicate="within")
        around: dict[int, int] = {}
        for hole, shell in found.T.tolist():
            best = around.get(hole)
            if best is None or outer[shell].area_px < outer[best].area_px:
                around[hole] = shell
        for hole, shell in around.items():
            owned[shell].append(_ground(raster, holes[hole].points))
    parts = [Polygon(shell.exterior, inner) for shell, inner in zip(shells, owned, strict=True)]
    return _many(_simplified(MultiPolygon(parts), TOLERANCE * raster.pitch_m))


def _simplified(shape: MultiPolygon, tolerance_m: float) -> BaseGeometry:
    """Return the shape with fewer points; line by line, or, if lines then cross, with care."""
    quick = shapely.simplify(shape, tolerance_m, preserve_topology=False)
    return quick if quick.is_valid else shapely.simplify(shape, tolerance_m)


def _many(shape: BaseGeometry) -> MultiPolygon:
    """Return a shape's polygons: valid, with area, outer rings counter-clockwise."""
    if not shape.is_valid:
        shape = shapely.make_valid(shape)
    parts = [p for p in shapely.get_parts(shape) if p.geom_type == "Polygon" and p.area > 0.0]
    many = shapely.orient_polygons(MultiPolygon(parts))
    assert isinstance(many, MultiPolygon)
    return many


def _lines(
    region: MultiPolygon, low: MultiPolygon, high: MultiPolygon, pitch_m: float
) -> tuple[Line, ...]:
    """Return the region's lines, each point with half the distance from P = 0.1 to P = 0.9."""
    shells = [(part.exterior, False) for part in region.geoms]
    holes = [(ring, True) for part in region.geoms for ring in part.interiors]
    rings = [(shapely.get_coordinates(ring), hole) for ring, hole in (*shells, *holes)]
    if not rings:
        return ()
    points = np.concatenate([ring[:-1] for ring, _ in rings])
    ways = [_distances(points, shape) for shape in (low, high)]
    half = 0.5 * np.maximum(np.add(*ways), pitch_m)
    parts = np.split(half, np.cumsum([len(ring) - 1 for ring, _ in rings])[:-1])
    return tuple(Line(ring, hole, part) for (ring, hole), part in zip(rings, parts, strict=True))


def _distances(points: NDArray[np.float64], shape: MultiPolygon) -> NDArray[np.float64]:
    """Return the distance of each point from the edge of a shape; infinite where there is none."""
    found = np.full(len(points), np.inf)
    edges = [
        np.asarray(shapely.linestrings(np.stack([ring[:-1], ring[1:]], axis=1)), object)
        for part in shape.geoms
        for line in (part.exterior, *part.interiors)
        for ring in (shapely.get_coordinates(line),)
    ]
    if edges:
        tree = shapely.STRtree(np.concatenate(edges))
        (at, _), away = tree.query_nearest(
            shapely.points(points), return_distance=True, all_matches=False
        )
        found[at] = away
    return found


def _open_parts(raster: Raster, rings: Sequence[Ring]) -> NDArray[np.float64]:
    """Return pieces of rings along unseen ground, shape (n, 2, 2), two points each."""
    pieces = [np.zeros((0, 2, 2))]
    for ring in rings:
        both = ring.open & np.roll(ring.open, -1)
        points = _ground(raster, ring.points)
        pieces.append(np.stack([points, np.roll(points, -1, axis=0)], axis=1)[both])
    return np.concatenate(pieces)
