"""Exploration by robots that watch each other: terms, run and figures."""

from __future__ import annotations

import io
import math
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from PIL import Image

from missions.errors import AreaError
from missions.lab.cooperation import trapezoids, triangulation
from missions.lab.cooperation.exploration import Exploration, Figures, Move, Why, unseen
from missions.lab.cooperation.space import Point, Space, between
from missions.lab.cooperation.tracking import Ellipse, Noise, Outcome, followed
from missions.lab.cooperation.trapezoids import Cover, Pattern
from uavmap.output.documents import save
from uavmap.output.drawing import palette
from uavmap.output.drawing.palette import Colour, Style
from uavmap.output.drawing.raster import Canvas
from uavmap.output.drawing.scene import Area, Dot, Label, Line, Shape, View
from uavmap.output.film.film_writers import gif, mp4

CHECKED_POINTS: Final = 400
"""Number of points that are checked for having been seen, besides all corners."""
_SPACING: Final = 1.0 / 20.0
"""Spacing of robots' places in that check, in ranges."""


class Mode(StrEnum):
    """The parameters of a team's exploration."""

    TRAPEZOID = "trapezoid"
    TRIANGULATION = "triangulation"
    COLUMN = "column"


@dataclass(frozen=True, slots=True)
class Cooperation:
    """The terms of an exploration. `theta_rad` and `cover` are for stripes only."""

    mode: Mode
    robots: int
    range_m: float
    theta_rad: float
    cover: Cover = Cover.TRIANGLES
    seed: int = 1
    """Seed of the noise and of the checked points."""


@dataclass(frozen=True, slots=True)
class Report:
    """The result of an exploration."""

    terms: Cooperation
    exploration: Exploration
    numbers: Figures
    unseen: NDArray[np.float64]
    """Checked points that no robot had within range and sight; shape (n, 2)."""
    checked: int
    watched: Outcome
    alone: Outcome

    @property
    def complete(self) -> bool:
        """True if all of the ground is on the map, and was seen."""
        slack_m2 = 1e-6 * self.exploration.space.area_m2
        return self.numbers.missed_m2 <= slack_m2 and not len(self.unseen)

    def figures(self) -> dict[str, Any]:
        """Return all figures for JSON; the same for the same seed."""
        terms, space = self.terms, self.exploration.space
        stripes = terms.mode is not Mode.TRIANGULATION
        numbers = {key: _rounded(value) for key, value in asdict(self.numbers).items()}
        return {
            "cooperate": terms.mode.value,
            "cover": terms.cover.value if terms.mode is Mode.TRAPEZOID else None,
            "robots": terms.robots,
            "range_m": terms.range_m,
            "theta_deg": round(math.degrees(terms.theta_rad), 6) if stripes else None,
            "seed": terms.seed,
            "start_m": list(self.exploration.start),
            "area_m2": _rounded(space.area_m2),
            "holes": len(space.rings) - 1,
            "reflex_corners": space.reflex_corners,
            "complete": self.complete,
            **numbers,
            "points_looked_at": self.checked,
            "points_unseen": len(self.unseen),
            "final_places": [
                {
                    "robot": robot + 1,
                    "watched": _end(self.watched, robot),
                    "alone": _end(self.alone, robot),
                }
                for robot in range(terms.robots)
            ],
        }


def _rounded(value: float) -> float:
    return round(value, 6)


def _end(outcome: Outcome, robot: int) -> dict[str, float]:
    ellipse = {key: _rounded(value) for key, value in asdict(outcome.ellipse(robot)).items()}
    return {
        "error_m": _rounded(outcome.error_m(robot)),
        "sigma_m": _rounded(outcome.sigma_m(robot)),
        **{f"ellipse_{key}": value for key, value in ellipse.items()},
    }


def cooperate(
    space: Space, terms: Cooperation, start: Point | None = None, noise: Noise | None = None
) -> Report:
    """Explore, check the seen ground, and follow the robots' belief of their places.

    Raises `AreaError` for a start outside of the ground, `StrategyError` for a range that does not
    fit it.
    """
    if start is None:  # the southernmost corner, of several the western
        start = min(space.corners, key=lambda corner: (corner[1], corner[0]))
    if not space.holds(start):
        raise AreaError(f"the start {start[0]:g},{start[1]:g} m is not in the area")
    if terms.mode is Mode.TRIANGULATION:
        exploration = triangulation.explore(space, start, terms.range_m)
    else:
        pattern = Pattern(terms.range_m, terms.theta_rad, terms.robots, terms.cover)
        exploration = trapezoids.explore(space, start, pattern)
    points = _points(space, np.random.default_rng((terms.seed, 2)))
    watched, alone = followed(exploration, noise or Noise(), terms.seed)
    return Report(
        terms,
        exploration,
        exploration.figures(),
        unseen(exploration, points, terms.range_m * _SPACING),
        len(points),
        watched,
        alone,
    )


def _points(space: Space, rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw points all over the ground, after its corners."""
    west, south, east, north = space.polygon.bounds
    found = np.array(space.corners)
    wanted = CHECKED_POINTS + len(found)
    for _ in range(1000):  # few points hit a narrow ground
        some = rng.uniform((west, south), (east, north), (4 * CHECKED_POINTS, 2))
        found = np.vstack([found, some[shapely.contains_xy(space.polygon, some)]])
        if len(found) >= wanted:
            break
    return found[:wanted]


_LONG_PX: Final = 760
_SMALL_PX: Final = 240
_MARGIN_PX: Final = 16
_TITLE_PX: Final = 46
_FRAMES: Final = 180
_SIGMAS: Final = 3.0
_COLOURS: Final = 64
_CORNERS: Final = 48
_EDGE: Final = 1.0 + 1e-9


def write_picture(report: Report, path: Path) -> None:
    """Write a PNG of the whole, with the ellipses of positions. Raises `OutputError`."""
    stage = _Stage(report)
    buffer = io.BytesIO()
    stage.last().quantize(_COLOURS).save(buffer, "PNG", optimize=True)
    save(path, buffer.getvalue())


def write_animation(report: Report, path: Path) -> None:
    """Write the exploration as GIF or MP4, by the end of the name. Raises `OutputError`."""
    stage = _Stage(report)
    times = [stage.end_m * i / (_FRAMES - 1) for i in range(_FRAMES)]
    frames = [*stage.frames(times), stage.last()]
    if path.suffix.lower() == ".mp4":
        save(path, mp4(frames[0].size, frames))
        return
    palette = frames[-1].quantize(_COLOURS)
    save(path, gif([f.quantize(palette=palette, dither=Image.Dither.NONE) for f in frames]))


class _Stage:
    """Draws an exploration; time is the path length of all robots together, m."""

    def __init__(self, report: Report) -> None:
        self._report = report
        log: Exploration = report.exploration
        self._moves = list(log.standing())
        self._ends_m = list(accumulate(move.length_m for move, _ in self._moves))
        self.end_m = self._ends_m[-1] if self._ends_m else 0.0
        west, south, east, north = log.space.polygon.bounds
        scale = _LONG_PX / max(east - west, north - south)
        size = (
            max(round((east - west) * scale), _SMALL_PX) + 2 * _MARGIN_PX,
            round((north - south) * scale) + _TITLE_PX + _MARGIN_PX,
        )
        left_m, top_m = west - _MARGIN_PX / scale, north + _TITLE_PX / scale
        self._view, self._page = View(left_m, top_m, scale, *size), View.page(*size)
        self._lower = Canvas(size)
        ring, *holes = log.space.rings
        self._draw(self._lower, [Area(tuple(ring), palette.LAND)])
        self._draw(self._lower, [Area(tuple(hole), palette.PAPER) for hole in holes])
        self._done = self._pieces = 0

    def frames(self, times_m: Sequence[float]) -> Iterator[Image.Image]:
        """Yield a frame for each time, ascending."""
        for time_m in times_m:
            moving = bisect_right(self._ends_m, time_m * (1.0 - 1e-12))
            self._finish(moving)
            canvas = self._lower.copy()
            places = self._final()
            if moving < len(self._moves):
                move, standing = self._moves[moving]
                begun = self._ends_m[moving] - move.length_m
                part = _part(move.path, time_m - begun)
                self._draw(canvas, self._swept(move, standing, part))
                places = list(standing)
                places[move.robot] = part[-1]
                watcher = min(
                    (p for i, p in enumerate(standing) if i != move.robot),
                    key=lambda place: math.dist(place, part[-1]),
                )
                self._draw(canvas, [Line.through((watcher, part[-1]), Style(palette.TRUTH, 2.0))])
            self._draw(canvas, self._robots(places))
            number = min(moving + 1, len(self._moves))
            self._draw_title(canvas, f"{time_m:.0f} m of {self.end_m:.0f}, move {number}")
            yield canvas.shown()

    def last(self) -> Image.Image:
        """Return the end, with the ellipses: thick while watched, thin alone."""
        self._finish(len(self._moves))
        canvas, final = self._lower.copy(), self._final()
        for outcome, width_px in ((self._report.alone, 1.0), (self._report.watched, 2.0)):
            for robot, place in enumerate(final):
                style = Style(palette.track_colour(robot), width_px)
                self._draw(canvas, [_ellipse(outcome.ellipse(robot), place, style)])
        self._draw(canvas, self._robots(final))
        numbers = self._report.numbers
        text = f"{numbers.path_m:.0f} m, {numbers.steps} exchanges, {numbers.turns} turns"
        self._draw_title(canvas, text, "3 sigma: thick watched, thin alone")
        return canvas.shown()

    def _finish(self, moves: int) -> None:
        for move, standing in self._moves[self._done : moves]:
            self._draw(self._lower, self._swept(move, standing, move.path))
        self._done = max(self._done, moves)
        pieces = self._report.exploration.pieces
        while self._pieces < len(pieces) and pieces[self._pieces].moves <= moves:
            outline = pieces[self._pieces].outline
            self._draw(
                self._lower, [Line.through(outline, Style(palette.OUTLINE, 1.0), closed=True)]
            )
            self._pieces += 1

    def _final(self) -> list[Point]:
        places = [self._report.exploration.start] * self._report.terms.robots
        for move, _ in self._moves:
            places[move.robot] = move.path[-1]
        return places

    def _swept(
        self, move: Move, standing: Sequence[Point], path: Sequence[Point]
    ) -> Iterator[Shape]:
        """Yield the ground that the lines to the partners passed, and the path."""
        colour = palette.STATES["non-roi"]
        if move.why is Why.SWEEP:
            colour = palette.track_colour(move.robot)
            watchers = sorted(
                (place for robot, place in enumerate(standing) if robot != move.robot),
                key=lambda place: math.dist(place, move.path[-1]),
            )
            for watcher in watchers[:2]:
                near = math.dist(watcher, move.path[-1]) <= self._report.terms.range_m * _EDGE
                if near and len(path) > 1:
                    yield Area((watcher, *path), _tint(colour))
        yield Line.through(path, Style(colour, 1.0))

    def _robots(self, places: Sequence[Point]) -> Iterator[Shape]:
        for robot, place in enumerate(places):
            yield Dot(place, ((5.5, palette.INK), (4.5, palette.track_colour(robot))))

    def _draw_title(self, canvas: Canvas, *lines: str) -> None:
        terms = self._report.terms
        title = f"{terms.mode}, {terms.robots} robots, range {terms.range_m:g} m"
        for row, text in enumerate((title, "   ·   ".join(lines))):
            canvas.draw(Label((_MARGIN_PX, 14.0 + 18.0 * row), text, 13.0, palette.INK), self._page)

    def _draw(self, canvas: Canvas, shapes: Iterable[Shape]) -> None:
        for shape in shapes:
            canvas.draw(shape, self._view)


def _ellipse(shape: Ellipse, place: Point, style: Style) -> Line:
    tilt = math.radians(shape.angle_deg)
    angle = math.tau * np.arange(_CORNERS + 1) / _CORNERS
    along, across = _SIGMAS * shape.major_m * np.cos(angle), _SIGMAS * shape.minor_m * np.sin(angle)
    east = along * math.cos(tilt) - across * math.sin(tilt)
    north = along * math.sin(tilt) + across * math.cos(tilt)
    return Line(np.column_stack([east, north]) + place, style)


def _tint(colour: Colour) -> Colour:
    red, green, blue = (
        round(0.3 * c + 0.7 * p) for c, p in zip(colour, palette.PAPER, strict=True)
    )
    return red, green, blue


def _part(path: Sequence[Point], length_m: float) -> list[Point]:
    found = [path[0]]
    for a, b in pairwise(path):
        leg = math.dist(a, b)
        if leg >= length_m:
            return [*found, between(a, b, max(length_m, 0.0) / leg if leg else 0.0)]
        found.append(b)
        length_m -= leg
    return found
