"""Two multicopters without satellites: one maps, the other hovers above and tracks it.

The mapper flies a piece of its path while the tracker hovers above and sees the marker on its top.
Then the mapper hovers, and the tracker moves, with the marker always in view. So an error is added
with each hop and not with each metre.

The tracker hovers over the middle of the smallest circle around the next piece. A piece is as long
as the tracker can see this circle. Then its old and its new place are both within reach of the
hovering mapper, and so is the straight way between them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from typing import Final

import shapely
from shapely.geometry import LineString
from shapely.ops import substring

from missions.geo.fence import Fence
from missions.units import GridPoint

Point = tuple[float, float]
"""East and north, in metres."""

_STILL_M: Final = 1e-6
_HALVINGS: Final = 32
MIN_PATH_M: Final = 0.5
"""Shortest path that is flown, m."""


class Role(StrEnum):
    """Vehicles of a step."""

    MAPPER = "mapper"
    TRACKER = "tracker"


@dataclass(frozen=True, slots=True)
class TrackerView:
    """The tracker's view of a marker below, at any heading.

    Attributes:
        hfov_rad: Angle of view across the picture, 0 to pi, open.
        vfov_rad: Angle of view along it.
        above_m: Height of the tracker above the mapper: it is in a layer of its own.
        separation_m: Minimum distance of two vehicles; `above_m` is at least that.
        tag_m: Side of the marker's black square.
        tilt_rad: Maximum tilt of the tracker's camera in flight.
        margin_m: Margin to the edge for errors of both places.
    """

    hfov_rad: float = math.radians(78.0)
    vfov_rad: float = math.radians(62.5)
    above_m: float = 10.0
    separation_m: float = 3.0
    tag_m: float = 0.4
    tilt_rad: float = math.radians(3.0)
    margin_m: float = 0.5

    def __post_init__(self) -> None:
        """Raise `ValueError` for a view that cannot be flown or sees nothing."""
        if not all(0.0 < angle < math.pi for angle in (self.hfov_rad, self.vfov_rad)):
            raise ValueError(f"hfov_rad and vfov_rad are 0 to pi, open: {self}")
        if not (self.tag_m > 0.0 and self.tilt_rad >= 0.0 and self.margin_m >= 0.0):
            raise ValueError(f"tag_m is above 0, tilt_rad and margin_m at least 0: {self}")
        if not 0.0 < self.separation_m <= self.above_m:
            raise ValueError(
                f"above_m is {self.above_m:g}: the tracker crosses above the mapper, so it flies "
                f"at least separation_m = {self.separation_m:g} m higher"
            )
        if not self.reach_m > 0.0:
            raise ValueError(
                f"from {self.above_m:g} m above nothing is left of the picture beside tilt, margin "
                "and marker: fly higher, or take a wider angle of view"
            )

    @property
    def reach_m(self) -> float:
        """Horizontal distance within which the marker's middle is certainly seen, m."""
        half_rad = min(self.hfov_rad, self.vfov_rad) / 2.0 - self.tilt_rad
        if half_rad <= 0.0:
            return 0.0
        # the marker with its white margin, at any turn
        corner_m = self.tag_m * (4.0 / 3.0) * math.sqrt(0.5)
        return self.above_m * math.tan(half_rad) - corner_m - self.margin_m


@dataclass(frozen=True, slots=True)
class Step:
    """A step: one vehicle moves, the other hovers.

    Attributes:
        mover: The vehicle that moves.
        path: Its places, metres east and north, from the first to the last.
        hovering: Place of the other one.
    """

    mover: Role
    path: tuple[Point, ...]
    hovering: Point

    @property
    def start(self) -> Point:
        """Start of the mover."""
        return self.path[0]

    @property
    def end(self) -> Point:
        """End of its path."""
        return self.path[-1]

    @property
    def length_m(self) -> float:
        """Length of its path, m."""
        return sum(map(math.dist, self.path, self.path[1:]))


@dataclass(frozen=True, slots=True)
class Leapfrog:
    """The steps of both vehicles along a path; the tracker begins above the path's start."""

    view: TrackerView
    steps: tuple[Step, ...]

    @property
    def hops(self) -> int:
        """Number of pieces that the mapper flies."""
        return sum(step.mover is Role.MAPPER for step in self.steps)

    def length_m(self, role: Role) -> float:
        """Return the length of all paths of a vehicle, m."""
        return sum(step.length_m for step in self.steps if step.mover is role)


def plan_leapfrog(path: Sequence[Point], view: TrackerView) -> Leapfrog:
    """Return the plan with the fewest hops along the mapper's path.

    The path has two or more corners in metres east and north. Each vehicle is in view while it or
    the other moves. Raises ValueError if the path is not valid.

    >>> plan = plan_leapfrog([(0.0, 0.0), (30.0, 0.0)], TrackerView())
    >>> [(str(step.mover), round(step.end[0], 1)) for step in plan.steps][:4]
    [('tracker', 4.5), ('mapper', 9.0), ('tracker', 13.5), ('mapper', 18.0)]
    """
    if len(path) < 2 or not all(math.isfinite(value) for place in path for value in place):
        raise ValueError(f"a path has two places at least, in metres: {list(path)}")
    line = LineString(path)
    if line.length <= _STILL_M:
        raise ValueError("the path has no length: all its places are one")
    steps: list[Step] = []
    mapper = tracker = (float(path[0][0]), float(path[0][1]))
    flown = 0.0
    while flown < line.length - _STILL_M:
        until = _farthest(line, flown, view.reach_m)
        piece = _piece(line, flown, until)
        middle = shapely.minimum_bounding_circle(piece).centroid
        centre = (float(middle.x), float(middle.y))
        if math.dist(tracker, centre) > _STILL_M:
            steps.append(Step(Role.TRACKER, (tracker, centre), mapper))
            tracker = centre
        way = _part(line, flown, until)
        steps.append(Step(Role.MAPPER, way, tracker))
        mapper, flown = way[-1], until
    return Leapfrog(view, tuple(steps))


def _farthest(line: LineString, flown_m: float, reach_m: float) -> float:
    """Return the farthest end of a piece from `flown_m`: its circle only grows with it."""

    def fits(until_m: float) -> bool:
        piece = _piece(line, flown_m, until_m)
        return float(shapely.minimum_bounding_radius(piece)) <= reach_m

    length_m = float(line.length)
    if fits(length_m):
        return length_m
    # a piece as long as the circle is wide fits, whatever its bends
    low, high = min(length_m, flown_m + 2.0 * reach_m * (1.0 - 1e-9)), length_m
    for _ in range(_HALVINGS):
        middle = (low + high) / 2.0
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low


def _piece(line: LineString, start_m: float, end_m: float) -> LineString:
    piece = substring(line, start_m, end_m)
    if not isinstance(piece, LineString):
        raise AssertionError("a piece has a length")
    return piece


def steps_along(fence: Fence, view: TrackerView, way: list[GridPoint]) -> tuple[Step, ...]:
    """Return the moves of both vehicles, in turn, for a mapper that flies `way` inside a fence.

    If the shortest ways of the tracker would leave the fence, it flies along the mapper's way.
    """
    path = [(float(east), float(north)) for east, north in way]
    length_m = sum(math.dist(a, b) for a, b in pairwise(path))
    if length_m <= MIN_PATH_M:
        return ()
    plan = plan_leapfrog(path, view)
    inside = all(
        fence.allows_leg(GridPoint(*step.start), GridPoint(*step.end))
        for step in plan.steps
        if step.mover is Role.TRACKER
    )
    return plan.steps if inside else _above_path(path, view)


def _above_path(path: list[tuple[float, float]], view: TrackerView) -> tuple[Step, ...]:
    """Return steps whose tracker hovers above the middle of each piece, and flies along the
    path."""
    line = LineString(path)
    count = math.ceil(line.length / (2.0 * view.reach_m))
    piece_m = line.length / count
    steps: list[Step] = []
    mapper, above_m = path[0], 0.0
    for k in range(count):
        middle_m = (k + 0.5) * piece_m
        steps.append(Step(Role.TRACKER, _part(line, above_m, middle_m), mapper))
        above_m = middle_m
        way = _part(line, k * piece_m, (k + 1) * piece_m)
        steps.append(Step(Role.MAPPER, way, steps[-1].end))
        mapper = way[-1]
    return tuple(steps)


def _part(line: LineString, start_m: float, end_m: float) -> tuple[tuple[float, float], ...]:
    places = substring(line, start_m, end_m).coords
    return tuple((float(east), float(north)) for east, north in places)
