"""What a plan looks like on the ground: box, fence, lanes and pads, ready to be drawn."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from missions.mission_file.launch_pads import homes
from missions.mission_file.schema import positions
from missions.state import Setting
from missions.units import GridPoint, LatLon
from uavmap.results.palette import Colour, track_colour
from uavmap.results.picture import BOX, FENCE, INK

HOLE: Colour = (246, 214, 218)
SEARCHED: Colour = (238, 231, 214)
MAP_SIDE_PX = 860
"""Longer side of the drawing."""
SHORTEST_SIDE_PX = 420
_PAD = 0.07
_MOST_LISTED = 6


@dataclass(frozen=True, slots=True)
class Mark:
    """Something to draw: an area, a line, a closed dashed line, a dot, or words."""

    shape: Literal["area", "line", "dashes", "dot", "words"]
    points: tuple[GridPoint, ...]
    colour: Colour
    width_px: float = 0.0
    words: str = ""


class Sample(NamedTuple):
    """A line of the legend; `size_px` is the width of a line, or the length of a dash."""

    shape: Literal["square", "line", "dashes", "dot"]
    colour: Colour
    words: str
    size_px: float = 0.0


@dataclass(frozen=True, slots=True)
class Scene:
    """The marks of a plan in the fixed frame, from the lowest up, and what is in view."""

    title: str
    marks: tuple[Mark, ...]
    legend: tuple[Sample, ...]
    left_m: float
    top_m: float
    px_per_m: float
    width_px: int
    height_px: int

    def pixel(self, point: GridPoint) -> tuple[float, float]:
        """Column and row of a point of the ground, from the upper left corner."""
        return (
            (point.east_m - self.left_m) * self.px_per_m,
            (self.top_m - point.north_m) * self.px_per_m,
        )


def scene_of(setting: Setting) -> Scene:
    """The plan of a mission."""
    mission = setting.mission
    fence = _ring(setting, mission.fence.polygon)
    view = _view(fence)
    marks = tuple(_marks(setting, fence))
    return Scene(mission.name, marks, tuple(_legend(setting)), *view)


def _legend(setting: Setting) -> Iterator[Sample]:
    mission = setting.mission
    heights = [mission.top_altitude_m(i) for i in range(len(mission.vehicles))]
    yield Sample("square", SEARCHED, "search box")
    yield Sample("dashes", FENCE, "geofence", 6.0)
    if mission.fence.holes:
        yield Sample("square", HOLE, "hole of the fence")
    for i, height_m in enumerate(heights[:_MOST_LISTED]):
        yield Sample("line", track_colour(i), f"lanes of vehicle {i + 1}, at {height_m:g} m", 2.0)
    if more := len(heights[_MOST_LISTED:]):
        yield Sample("line", track_colour(0), f"... and {more} vehicles more", 2.0)
    yield Sample("dot", INK, "home" if len(heights) == 1 else "homes, numbered")


def _marks(setting: Setting, fence: tuple[GridPoint, ...]) -> Iterator[Mark]:
    mission = setting.mission
    box = _ring(setting, mission.search.box)
    yield Mark("area", box, SEARCHED)
    for hole in mission.fence.holes:
        yield Mark("area", _ring(setting, hole), HOLE)
    for i, share in enumerate(setting.shares):
        for before, lane in zip((None, *share), share, strict=False):
            if before is not None:
                yield Mark("line", (before[1], lane[0]), track_colour(i), 0.6)
            yield Mark("line", lane, track_colour(i), 2.0)
    yield Mark("line", (*box, box[0]), BOX, 1.6)
    for ring in (fence, *(_ring(setting, hole) for hole in mission.fence.holes)):
        yield Mark("dashes", ring, FENCE, 1.6)
    pads = [setting.grid.fixed(place) for place in homes(mission)]
    for i, pad in enumerate(pads):
        yield Mark("dot", (pad,), INK, 6.0, str(i + 1) if len(pads) > 1 else "")
    yield from _sizes(box)


def _sizes(box: Sequence[GridPoint]) -> Iterator[Mark]:
    """How wide and how high the box is, along its rims."""
    west, south, east, north = bounds(box)
    middle_m = (west + east) / 2.0, (south + north) / 2.0
    yield Mark("words", (GridPoint(middle_m[0], south),), INK, 14.0, f"{east - west:.0f} m")
    yield Mark("words", (GridPoint(west, middle_m[1]),), INK, -30.0, f"{north - south:.0f} m")


def _ring(setting: Setting, ring: Sequence[tuple[float, float]]) -> tuple[GridPoint, ...]:
    places: Sequence[LatLon] = positions(tuple(ring))
    return tuple(setting.grid.fixed(place) for place in places)


def bounds(points: Sequence[GridPoint]) -> tuple[float, float, float, float]:
    """West, south, east and north of points, metres."""
    easts, norths = zip(*points, strict=True)
    return min(easts), min(norths), max(easts), max(norths)


def _view(points: Sequence[GridPoint]) -> tuple[float, float, float, int, int]:
    """Left and top in metres, the scale, width and height in pixels: all of the fence."""
    west, south, east, north = bounds(points)
    longer_m = max(east - west, north - south)
    pad_m = _PAD * longer_m
    px_per_m = MAP_SIDE_PX / (longer_m + 2.0 * pad_m)
    width_px = max(math.ceil((east - west + 2.0 * pad_m) * px_per_m), SHORTEST_SIDE_PX)
    height_px = max(math.ceil((north - south + 2.0 * pad_m) * px_per_m), SHORTEST_SIDE_PX)
    return (
        (west + east) / 2.0 - width_px / px_per_m / 2.0,
        (south + north) / 2.0 + height_px / px_per_m / 2.0,
        px_per_m,
        width_px,
        height_px,
    )
