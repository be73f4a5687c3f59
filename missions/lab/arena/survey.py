"""A survey without stopping: every cell of a box, lane beside lane, without decisions in flight.

Lanes lie as far apart as the footprint allows, along the east or the north, begun at any corner.
Each vehicle flies its part of them, from the start and back to it. The flown one is the quickest of
these that shows every cell of the box often enough for a verdict.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from missions.errors import StrategyError
from missions.geo.trajectory import Trajectory, rounded_path
from missions.lab.arena.nonstop import FlightResult, Ground, Team
from missions.lab.arena.roi import Roi
from missions.planning.kernels import worth as kernels
from missions.planning.sweep.paths import Kinematics
from missions.units import Cell, GridPoint

MARGIN_CELLS = 2
"""Margin of the default box around the region."""
CUT_M = 1.0
"""Cut of the corners between lanes, m."""
_INSETS = (0.9, 0.75, 0.6, 0.45, 0.3, 0.15, 0.0)
"""Distances before its last cell at which a lane may end, in half views."""
_TURN_S = 2.5
"""Rough time of a lane's end, s: for the sharing of lanes only."""

_Lane = tuple[GridPoint, GridPoint]


@dataclass(frozen=True, slots=True)
class Box:
    """The cells from a south-west corner to a north-east one, both included."""

    low: Cell
    high: Cell

    @classmethod
    def around(cls, roi: Roi, factor: float | None = None) -> Box:
        """Return the bounding box of a region, two cells wider on each side, or `factor` times."""
        easts, norths = zip(*roi.cells, strict=True)
        east, north = MARGIN_CELLS, MARGIN_CELLS
        if factor is not None:
            east = math.ceil((max(easts) - min(easts) + 1) * (factor - 1.0) / 2.0)
            north = math.ceil((max(norths) - min(norths) + 1) * (factor - 1.0) / 2.0)
        return cls(
            Cell(min(easts) - east, min(norths) - north),
            Cell(max(easts) + east, max(norths) + north),
        )


def surveyed(
    roi: Roi,
    team: Team,
    *,
    box_factor: float | None = None,
    seed: int = 1,
    record: bool = False,
) -> FlightResult:
    """Return a survey of the box around a region, judged as in `missions.lab.arena.nonstop`.

    Raises `StrategyError` for a footprint that never shows a whole cell, or not for long enough.
    """
    ground = team.over(roi, seed, record=record)
    return ground.along(survey_paths(Box.around(roi, box_factor), team.robots, ground))


def survey_paths(box: Box, robots: int, ground: Ground) -> list[Trajectory]:
    """Return the paths of a team, from the start and back, that show every cell of a box.

    Raises `StrategyError` if none do.
    """
    best: list[Trajectory] = []
    best_s = math.inf
    for along_north, flip_along, flip_across in itertools.product((False, True), repeat=3):
        for inset in _INSETS:
            plan = _Lanes(box, ground, along_north, flip_along, flip_across, inset)
            paths = plan.paths(robots)
            end_s = max(path.end_s for path in paths)
            if end_s >= best_s:  # shorter insets take longer
                break
            if _shows(box, paths, ground):
                best, best_s = paths, end_s
                break
    if not best:
        raise StrategyError("no lanes at this speed show every cell often enough for a verdict")
    return best


@dataclass(frozen=True, slots=True)
class _Lanes:
    """Lanes over a box in one direction, from one corner."""

    box: Box
    ground: Ground
    along_north: bool
    flip_along: bool
    flip_across: bool
    inset: float

    def paths(self, robots: int) -> list[Trajectory]:
        """Return the path of each vehicle; one without a lane stays where it is."""
        kin: Kinematics = self.ground.kinematics
        home = self.ground.home
        found = []
        for lanes in self._shares(self._lanes(), robots):
            # the first lane of a vehicle leads away from the corner
            turned = [(b, a) if i % 2 else (a, b) for i, (a, b) in enumerate(lanes)]
            points = [home, *itertools.chain.from_iterable(turned), home] if lanes else [home]
            found.append(
                rounded_path(
                    points, 0.0, speed_m_s=kin.speed_m_s, cut_m=CUT_M, accel_m_s2=kin.accel_m_s2
                )
            )
        return found

    def _lanes(self) -> list[_Lane]:
        low, high, kin = self.box.low, self.box.high, self.ground.kinematics
        cell_m = self.ground.cell_m
        if self.along_north:
            begin, end, first, last = low.north, high.north, low.east, high.east
            half_along_m, half_m = kin.half_north_m, kin.half_east_m
        else:
            begin, end, first, last = low.east, high.east, low.north, high.north
            half_along_m, half_m = kin.half_east_m, kin.half_north_m
        inset_m = min(self.inset * half_along_m, 0.5 * (end - begin) * cell_m)
        ends_m = [begin * cell_m + inset_m, end * cell_m - inset_m]
        if self.flip_along:
            ends_m.reverse()
        rows = math.floor(2.0 * half_m / cell_m + 1e-9) + 1
        found = []
        for row in range(first, last + 1, rows):
            least = max(first, min(row, last + 1 - rows))
            across_m = 0.5 * (least + min(least + rows - 1, last)) * cell_m
            pair = [(end_m, across_m) for end_m in ends_m]
            if self.along_north:
                pair = [(across_m, end_m) for end_m in ends_m]
            found.append((GridPoint(*pair[0]), GridPoint(*pair[1])))
        return found[::-1] if self.flip_across else found

    def _shares(self, lanes: Sequence[_Lane], robots: int) -> Iterator[Sequence[_Lane]]:
        """Yield neighbouring lanes for each vehicle, so that the last is done about soonest."""
        longest_s = max(self._about_s([lane]) for lane in lanes)
        low_s, high_s = longest_s, max(longest_s, self._about_s(lanes))
        for _ in range(30):
            middle_s = 0.5 * (low_s + high_s)
            if len(self._cut(lanes, middle_s)) <= robots:
                high_s = middle_s
            else:
                low_s = middle_s
        parts = self._cut(lanes, high_s)
        yield from parts
        for _ in range(robots - len(parts)):
            yield ()

    def _cut(self, lanes: Sequence[_Lane], most_s: float) -> list[Sequence[_Lane]]:
        """Return parts of at most about `most_s` seconds, but at least one lane."""
        parts, begin = [], 0
        for end in range(1, len(lanes) + 1):
            if end == len(lanes) or self._about_s(lanes[begin : end + 1]) > most_s:
                parts.append(lanes[begin:end])
                begin = end
        return parts

    def _about_s(self, lanes: Sequence[_Lane]) -> float:
        home = self.ground.home
        way_m = home.distance_to(lanes[0][0]) + home.distance_to(lanes[-1][1])
        way_m += sum(a.distance_to(b) for a, b in lanes)
        return way_m / self.ground.kinematics.speed_m_s + _TURN_S * len(lanes)


def _shows(box: Box, paths: Sequence[Trajectory], ground: Ground) -> bool:
    """Return whether frames without errors along the paths decide every cell of a box."""
    columns, rows = box.high.east - box.low.east + 1, box.high.north - box.low.north + 1
    yes, no, nothing = (np.zeros(columns * rows, np.int64) for _ in range(3))
    grid = (box.low.east, box.low.north, columns, rows, ground.cell_m)
    camera, kin = ground.camera, ground.kinematics
    for path in paths:
        for tick in range(math.floor(path.end_s / camera.frame_s + 1e-9) + 1):
            place = path.place_at(tick * camera.frame_s)
            kernels.see(
                place.east_m, place.north_m, kin.half_east_m, kin.half_north_m, grid,
                nothing, nothing, yes, no, camera.frames, camera.majority,
            )  # fmt: skip
    return bool((no >= camera.against).all())
