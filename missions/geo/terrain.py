"""Ground that is not flat: its heights on a regular lattice, and their effects on a flight.

All else in `missions` uses heights above the ground below. The terrain converts between these and
heights above home, which autopilots understand. `uavmap.mavlink.vehicle_view` adds it to commands
and subtracts it from reports. Flat ground is the absence of a terrain.

Points are in the grid's fixed frame; heights are in metres above the ground at the start.
"""

from __future__ import annotations

import base64
import binascii
import itertools
import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from missions.units import GridPoint

Heights = NDArray[np.float64]

FOLLOW_M = 1.0
"""Maximum variation of the ground on the way to the next target, m.

On a leg a vehicle is at most this far above its layer.
"""
MIN_AHEAD_M = 1.0
"""Minimum distance of a target, m, however steep the ground is."""
CLEAR_M = 5.0
"""Minimum clearance of a vehicle over the ground, m; a lower one climbs before it flies on."""
LEG_CLIMB_M_S = 0.45
"""Rate of climb on a leg over steep ground, m/s.

Targets there lie within `FOLLOW_M`, and a vehicle slows down before each. Simulated: an ArduCopter
0.6, a PX4 0.46.
"""
_AHEAD_M = 60.0
"""Maximum distance of a target, m."""


@dataclass(frozen=True, slots=True, eq=False)
class Terrain:
    """Heights at the points of a lattice, bilinear between them; beyond its edge as on the edge.

    `heights_m[row, column]` is the height at (west_m + column * step_m, south_m + row * step_m).
    At least 2 x 2 finite heights; `step_m` is above 0.

    >>> slope = Terrain(0.0, 0.0, 10.0, np.array([[0.0, 1.0], [0.0, 1.0]]))
    >>> slope.height_m(GridPoint(5.0, 3.0)), slope.height_m(GridPoint(25.0, 3.0))
    (0.5, 1.0)
    """

    west_m: float
    south_m: float
    step_m: float
    heights_m: Heights

    def height_m(self, point: GridPoint) -> float:
        """Return the height of the ground at a point."""
        rows, columns = self.heights_m.shape
        column = min(max((point.east_m - self.west_m) / self.step_m, 0.0), columns - 1.0)
        row = min(max((point.north_m - self.south_m) / self.step_m, 0.0), rows - 1.0)
        i, j = min(int(row), rows - 2), min(int(column), columns - 2)
        up, right = row - i, column - j
        (a, b), (c, d) = self.heights_m[i : i + 2, j : j + 2].tolist()
        south = a + (b - a) * right
        return float(south + (c + (d - c) * right - south) * up)

    def at(self, east_m: Heights, north_m: Heights) -> Heights:
        """Return the heights of the ground at many points: arrays of one shape."""
        rows, columns = self.heights_m.shape
        column = np.clip((east_m - self.west_m) / self.step_m, 0.0, columns - 1.0)
        row = np.clip((north_m - self.south_m) / self.step_m, 0.0, rows - 1.0)
        i = np.minimum(row.astype(np.intp), rows - 2)
        j = np.minimum(column.astype(np.intp), columns - 2)
        up, right, z = row - i, column - j, self.heights_m
        south = z[i, j] + (z[i, j + 1] - z[i, j]) * right
        north = z[i + 1, j] + (z[i + 1, j + 1] - z[i + 1, j]) * right
        return np.asarray(south + (north - south) * up, dtype=np.float64)

    def along(self, start: GridPoint, end: GridPoint) -> Heights:
        """Return the heights along a straight leg, no farther apart than half a step of the
        lattice."""
        count = max(2, math.ceil(2.0 * start.distance_to(end) / self.step_m) + 1)
        return self.at(
            np.linspace(start.east_m, end.east_m, count),
            np.linspace(start.north_m, end.north_m, count),
        )

    def ups_and_downs_m(
        self, points: Sequence[GridPoint], speed_m_s: float = math.inf, climb_m_s: float = 0.0
    ) -> float:
        """Return the metres that a way climbs and descends in all.

        At least it is the climb in the extra time of steep legs (`LEG_CLIMB_M_S`).
        """
        in_all_m = 0.0
        for a, b in itertools.pairwise(points):
            if a == b:
                continue
            rises_m = np.abs(np.diff(self.along(a, b)))
            slower_s = rises_m / LEG_CLIMB_M_S - a.distance_to(b) / len(rises_m) / speed_m_s
            in_all_m += float(np.maximum(rises_m, climb_m_s * slower_s).sum())
        return in_all_m

    def next_target(self, here: GridPoint, end: GridPoint) -> tuple[GridPoint, float]:
        """Return the next target on a straight leg, and the height of the highest ground up to it.

        So a vehicle clears the ground in whatever order it climbs and flies, also if its link is
        lost and it stops there. The target is as far ahead as the ground varies within `FOLLOW_M`.
        """
        whole_m = here.distance_to(end)
        reach_m = min(whole_m, _AHEAD_M)
        if whole_m < 1e-6:
            return end, self.height_m(end)
        steps = max(1, math.ceil(reach_m / min(0.5 * self.step_m, 0.5)))
        ahead_m = np.linspace(0.0, reach_m, steps + 1)
        east = here.east_m + (end.east_m - here.east_m) * ahead_m / whole_m
        north = here.north_m + (end.north_m - here.north_m) * ahead_m / whole_m
        heights = self.at(east, north)
        highest, lowest = np.maximum.accumulate(heights), np.minimum.accumulate(heights)
        near = (highest - lowest <= FOLLOW_M) | (ahead_m <= MIN_AHEAD_M)
        last = int(near.argmin()) - 1 if not near.all() else steps
        last = max(last, 1)
        if last == steps and reach_m == whole_m:
            return end, float(highest[-1])
        return GridPoint(float(east[last]), float(north[last])), float(highest[last])

    def sent_target(
        self, here: GridPoint, above_m: float, target: GridPoint, height_m: float
    ) -> tuple[GridPoint, float]:
        """Return the target and height that are sent to a vehicle `above_m` above the ground on a
        leg.

        The leg leads to `target` at `height_m` above the ground there. A vehicle that is too low to
        clear the ground on its way climbs first.

        >>> slope = Terrain(0.0, 0.0, 10.0, np.array([[0.0, 10.0], [0.0, 10.0]]))
        >>> slope.sent_target(GridPoint(0.0, 0.0), 3.0, GridPoint(0.0, 9.0), 12.0)
        (GridPoint(east_m=0.0, north_m=0.0), 12.0)
        """
        aim, highest_m = self.next_target(here, target)
        here_m = self.height_m(here)
        if above_m + here_m - highest_m < min(CLEAR_M, height_m - FOLLOW_M):
            return here, height_m + highest_m - here_m
        return aim, height_m + highest_m - self.height_m(aim)

    def within(self, area: BaseGeometry) -> Terrain:
        """Return the part of the lattice that holds an area; beyond the lattice, its edge."""
        rows, columns = self.heights_m.shape
        west, south, east, north = area.bounds
        j0 = min(max(math.floor((west - self.west_m) / self.step_m), 0), columns - 2)
        i0 = min(max(math.floor((south - self.south_m) / self.step_m), 0), rows - 2)
        j1 = min(max(math.ceil((east - self.west_m) / self.step_m), j0 + 1), columns - 1)
        i1 = min(max(math.ceil((north - self.south_m) / self.step_m), i0 + 1), rows - 1)
        return Terrain(
            self.west_m + j0 * self.step_m,
            self.south_m + i0 * self.step_m,
            self.step_m,
            self.heights_m[i0 : i1 + 1, j0 : j1 + 1],
        )


@dataclass(frozen=True, slots=True)
class Relief:
    """The extremes of the ground in an area, in metres above the start."""

    lowest_m: float
    highest_m: float
    steepest: float
    """Steepest slope, as rise over run: 0.1 is 10 %."""
    steepest_at: GridPoint


def relief_of(terrain: Terrain, area: BaseGeometry) -> Relief:
    """Return the relief of an area: of all meshes of the lattice that touch it."""
    part = terrain.within(area)
    z, step_m = part.heights_m, part.step_m
    rows, columns = z.shape
    west = part.west_m + step_m * np.arange(columns - 1)
    south = part.south_m + step_m * np.arange(rows - 1)
    left, low = np.meshgrid(west, south)
    shapely.prepare(area)
    touched = shapely.intersects(shapely.box(left, low, left + step_m, low + step_m), area)
    if not touched.any():  # all of it lies beyond the lattice
        touched = np.ones_like(touched)
    corners = np.stack([z[:-1, :-1], z[:-1, 1:], z[1:, :-1], z[1:, 1:]])
    along_east = np.abs(np.diff(z, axis=1)) / step_m
    along_north = np.abs(np.diff(z, axis=0)) / step_m
    slope = np.hypot(
        np.maximum(along_east[:-1], along_east[1:]),
        np.maximum(along_north[:, :-1], along_north[:, 1:]),
    )
    slope = np.where(touched, slope, -1.0)
    i, j = np.unravel_index(int(slope.argmax()), slope.shape)
    return Relief(
        float(corners.min(axis=0)[touched].min()),
        float(corners.max(axis=0)[touched].max()),
        float(slope.max()),
        GridPoint(float(west[j]) + step_m / 2.0, float(south[i]) + step_m / 2.0),
    )


# --- as text ------------------------------------------------------------------------------------
def encoded(heights_m: Heights) -> str:
    """Return heights as text: centimetres, the difference of each to the one before, compressed.

    >>> decoded(encoded(np.array([[0.0, 1.254], [2.0, -3.0]])), 2, 2).tolist()
    [[0.0, 1.25], [2.0, -3.0]]
    """
    steps = np.diff(np.round(heights_m.ravel() * 100.0).astype(np.int64), prepend=0)
    return base64.b64encode(zlib.compress(steps.astype("<i4").tobytes(), 9)).decode("ascii")


def decoded(text: str, rows: int, columns: int) -> Heights:
    """Return the heights of a text of `encoded`. Raises ValueError if their number differs."""
    try:
        packed = zlib.decompressobj()
        content = packed.decompress(base64.b64decode(text, validate=True), 4 * rows * columns + 1)
    except (binascii.Error, zlib.error) as error:
        raise ValueError(f"the heights are damaged ({error})") from None
    if len(content) != 4 * rows * columns:
        raise ValueError(f"there are not {rows} x {columns} heights")
    steps = np.frombuffer(content, "<i4").astype(np.int64)
    heights: Heights = np.cumsum(steps).reshape(rows, columns) / 100.0
    return heights
