"""Where things lie in the picture of a map: ground metres to pixels, and what to show."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from missions.units import GridPoint, LatLon
from uavmap.results.model import MapData, Track

MAP_SIDE_PX = 900
"""Longer side of the map itself."""

SHORTEST_SIDE_PX = 520
"""The map is never narrower: its legend stands beside it."""

_PAD = 0.05
_FENCE_ROOM = 2.2
"""A fence is shown whole while that makes the map at most this many times larger."""


@dataclass(frozen=True, slots=True)
class View:
    """The rectangle of ground that the map shows, grid north up, in the fixed frame.

    `left_m` and `top_m` are its corner, `width_px` and `height_px` the size of the map.
    """

    left_m: float
    top_m: float
    px_per_m: float
    width_px: int
    height_px: int

    def pixel(self, point: GridPoint) -> tuple[float, float]:
        """Column and row of a point of the ground, from the map's upper left corner.

        >>> View(-10.0, 10.0, 2.0, 40, 40).pixel(GridPoint(0.0, 5.0))
        (20.0, 10.0)
        """
        return (
            (point.east_m - self.left_m) * self.px_per_m,
            (self.top_m - point.north_m) * self.px_per_m,
        )

    def squares_px(self, squares: NDArray[np.float64]) -> NDArray[np.float64]:
        """Left, upper, right and lower edges of squares given as west, south, east, north."""
        west, south, east, north = squares.T
        left, right = ((x - self.left_m) * self.px_per_m for x in (west, east))
        top, bottom = ((self.top_m - y) * self.px_per_m for y in (north, south))
        return np.column_stack([left, top, right, bottom])

    @property
    def ground(self) -> BaseGeometry:
        """The ground in view, with a little around it."""
        width_m, height_m = self.width_px / self.px_per_m, self.height_px / self.px_per_m
        return shapely.box(
            self.left_m - 1, self.top_m - height_m - 1, self.left_m + width_m + 1, self.top_m + 1
        )


def view_of(data: MapData) -> View:
    """The view that shows cells, tracks, truth, box and start, and the fence if it is near."""
    points = _two_corners(data.squares)
    points += [point for track in data.tracks for point in track_on_map(data, track)]
    points += ring_on_map(data, data.box)
    points.append(data.grid.fixed(data.start))
    if data.truth is not None and not data.truth.is_empty:
        west, south, east, north = data.truth.bounds
        points += [ground(data, GridPoint(west, south)), ground(data, GridPoint(east, north))]
    near = _bounds(points)
    whole = _bounds([*points, *ring_on_map(data, data.fence)])
    west, south, east, north = whole if _area(whole) <= _FENCE_ROOM * _area(near) else near
    pad_m = max(_PAD * max(east - west, north - south), data.grid.cell_m)
    width_m, height_m = east - west + 2 * pad_m, north - south + 2 * pad_m
    px_per_m = MAP_SIDE_PX / max(width_m, height_m)
    width_px = max(round(width_m * px_per_m), SHORTEST_SIDE_PX)
    height_px = max(round(height_m * px_per_m), SHORTEST_SIDE_PX)
    return View(
        (west + east) / 2 - width_px / px_per_m / 2,
        (south + north) / 2 + height_px / px_per_m / 2,
        px_per_m,
        width_px,
        height_px,
    )


def ground(data: MapData, point: GridPoint) -> GridPoint:
    """Where a point of the region is at the time of the map."""
    return data.grid.to_fixed(point, data.t_s)


def ring_on_map(data: MapData, ring: Iterable[LatLon]) -> list[GridPoint]:
    """A ring that is tied to the ground."""
    return [data.grid.fixed(place) for place in ring]


def track_on_map(data: MapData, track: Track) -> list[GridPoint]:
    """A track as seen from the region, which may drift: over the cells that it was flown for."""
    grid = data.grid
    return [ground(data, grid.to_moving(grid.fixed(place), t_s)) for t_s, place, _ in track.points]


def _two_corners(squares: NDArray[np.float64]) -> list[GridPoint]:
    """The south-western and the north-eastern corner of all squares; none of none."""
    if not len(squares):
        return []
    low, high = squares[:, :2].min(axis=0), squares[:, 2:].max(axis=0)
    return [GridPoint(*low.tolist()), GridPoint(*high.tolist())]


def _bounds(points: Iterable[GridPoint]) -> tuple[float, float, float, float]:
    easts, norths = zip(*points, strict=True)
    return min(easts), min(norths), max(easts), max(norths)


def _area(bounds: tuple[float, float, float, float]) -> float:
    return (bounds[2] - bounds[0]) * (bounds[3] - bounds[1])
