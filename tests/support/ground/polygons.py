"""Polygons with holes, grown by chance: stars, rooms that overlap, and winding passages."""

from __future__ import annotations

import math

import numpy as np
import shapely
from shapely import affinity
from shapely.geometry import LineString, Polygon, box

from missions.lab.cooperation.space import Point, Space

SIZE_M = 100.0
MAX_HOLES = 6


def random_space(seed: int) -> Space:
    """Return a ground of up to about 100 m; rooms have walls along the axes, in whole metres."""
    rng = np.random.default_rng(seed)
    kind = int(rng.integers(3))
    shape = (_star, _rooms, _passage)[kind](rng)
    for _ in range(int(rng.integers(3))):  # bites, some of which divide the ground
        shape = shape.difference(_obstacle(rng, shape, 14.0))
    wanted = int(rng.integers(MAX_HOLES + 1))
    for _ in range(8 * wanted):
        hole = _obstacle(rng, shape, 8.0)
        if wanted and shape.contains(hole.buffer(0.2)):
            shape, wanted = shape.difference(hole), wanted - 1
    parts = [part for part in getattr(shape, "geoms", [shape]) if isinstance(part, Polygon)]
    largest = max(parts, key=lambda part: part.area)
    if kind != 1:
        largest = affinity.rotate(largest, rng.uniform(0.0, 360.0))
    # thinner than a millimetre is no passage, and no wall
    whole = largest.buffer(-0.01, join_style="mitre").buffer(0.01, join_style="mitre")
    if isinstance(whole, Polygon) and not whole.is_empty:
        largest = whole
    return Space(
        list(largest.exterior.coords[:-1]), [list(hole.coords[:-1]) for hole in largest.interiors]
    )


def random_start(space: Space, seed: int) -> Point:
    """Return a corner, or a place in the middle."""
    if seed % 2:
        return space.corners[seed // 2 % len(space.corners)]
    x, y = shapely.get_coordinates(space.polygon.representative_point())[0]
    return round(float(x), 3), round(float(y), 3)


def _around(rng: np.random.Generator, corners: int, least_m: float, most_m: float) -> Polygon:
    angles = np.sort(rng.uniform(0.0, math.tau, corners))
    radii = rng.uniform(least_m, most_m, corners)
    ring = Polygon(np.column_stack([radii * np.cos(angles), radii * np.sin(angles)]))
    return ring if ring.is_valid else ring.convex_hull


def _obstacle(rng: np.random.Generator, shape: Polygon, most_m: float) -> Polygon:
    west, south, east, north = shape.bounds
    x, y = np.round(rng.uniform((west, south), (east, north)))
    return affinity.translate(_around(rng, int(rng.integers(3, 8)), 0.5, most_m), x, y)


def _star(rng: np.random.Generator) -> Polygon:
    return _around(rng, int(rng.integers(5, 25)), SIZE_M / 8.0, SIZE_M / 2.0)


def _rooms(rng: np.random.Generator) -> Polygon:
    corners, sizes = rng.uniform(0, 60, (8, 2)).round(), rng.uniform(5, 40, (8, 2)).round()
    rooms = (box(x, y, x + w, y + h) for (x, y), (w, h) in zip(corners, sizes, strict=True))
    return shapely.union_all(list(rooms))


def _passage(rng: np.random.Generator) -> Polygon:
    way = np.cumsum(rng.normal(0.0, SIZE_M / 8.0, (8, 2)), axis=0)
    return LineString(way).buffer(rng.uniform(2.0, 8.0), quad_segs=2)
