"""Robots that watch each other, as a picture and as an animation.

Ground over which the line between two robots passed is tinted; pieces of the map are outlined when
they are whole; a line leads from who moves to who watches it.
"""

from __future__ import annotations

import io
import math
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Final

from PIL import Image, ImageDraw

from missions.cooperation.exploration import Exploration, Move, Why
from missions.cooperation.space import Point, between, distance
from missions.cooperation.tracking import Ellipse, Outcome
from uavmap.animation.film import FPS, HOLD_S
from uavmap.animation.writers import mp4, save
from uavmap.offline.cooperation import Report
from uavmap.output.drawing.palette import (
    INK,
    LAND,
    OUTLINE,
    PAPER,
    STATES,
    TRUTH,
    Colour,
    track_colour,
)
from uavmap.output.drawing.raster import font

_LONG_PX: Final = 760
_SMALL_PX: Final = 240
_MARGIN_PX: Final = 16
_TITLE_PX: Final = 46
_FRAMES: Final = 180
_OVERSAMPLING: Final = 2
_SIGMAS: Final = 3.0
_COLOURS: Final = 64
_CORNERS: Final = 48
_EDGE: Final = 1.0 + 1e-9


def write_picture(report: Report, path: Path) -> None:
    """Write it whole as a PNG, with where robots believe to be. Raises `OutputError`."""
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
    first, *rest = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    buffer = io.BytesIO()
    first.save(
        buffer,
        "GIF",
        save_all=True,
        append_images=rest,
        duration=[1000 // FPS] * (len(frames) - 1) + [round(HOLD_S * 1000)],
        loop=0,
        optimize=False,
    )
    save(path, buffer.getvalue())


class _Stage:
    """Draws an exploration on; time is the way that all robots together have gone, in metres."""

    def __init__(self, report: Report) -> None:
        self._report = report
        log: Exploration = report.exploration
        self._moves = list(log.standing())
        self._ends_m = list(accumulate(move.length_m for move, _ in self._moves))
        self.end_m = self._ends_m[-1] if self._ends_m else 0.0
        west, south, east, north = log.space.polygon.bounds
        self._west, self._north = west, north
        self._scale = _LONG_PX * _OVERSAMPLING / max(east - west, north - south)
        self._size = (
            max(round((east - west) * self._scale), _SMALL_PX * _OVERSAMPLING)
            + 2 * _MARGIN_PX * _OVERSAMPLING,
            round((north - south) * self._scale) + (_TITLE_PX + _MARGIN_PX) * _OVERSAMPLING,
        )
        self._lower = Image.new("RGB", self._size, PAPER)
        self._pen = ImageDraw.Draw(self._lower)
        ring, *holes = log.space.rings
        self._fill(self._pen, ring, LAND)
        for hole in holes:
            self._fill(self._pen, hole, PAPER)
        self._done = self._pieces = 0

    def frames(self, times_m: Sequence[float]) -> Iterator[Image.Image]:
        """A frame for each time, which only grow."""
        for time_m in times_m:
            moving = bisect_right(self._ends_m, time_m * (1.0 - 1e-12))
            self._finish(moving)
            image = self._lower.copy()
            pen = ImageDraw.Draw(image)
            if moving < len(self._moves):
                move, standing = self._moves[moving]
                begun = self._ends_m[moving] - move.length_m
                part = _part(move.path, time_m - begun)
                self._swept(pen, move, standing, part)
                places = list(standing)
                places[move.robot] = part[-1]
                watcher = min(
                    (p for i, p in enumerate(standing) if i != move.robot),
                    key=lambda place: distance(place, part[-1]),
                )
                pen.line([self._at(watcher), self._at(part[-1])], TRUTH, 2 * _OVERSAMPLING)
            else:
                places = self._final()
            self._robots(pen, places)
            self._words(
                pen, f"{time_m:.0f} m of {self.end_m:.0f}, move {min(moving + 1, len(self._moves))}"
            )
            yield self._reduced(image)

    def last(self) -> Image.Image:
        """The end, with the ellipses: thick while watched, thin alone."""
        self._finish(len(self._moves))
        image = self._lower.copy()
        pen = ImageDraw.Draw(image)
        final = self._final()
        for outcome, width in ((self._report.alone, 1), (self._report.watched, 2)):
            for robot, place in enumerate(final):
                self._ellipse(pen, outcome, robot, place, width * _OVERSAMPLING)
        self._robots(pen, final)
        numbers = self._report.numbers
        said = f"{numbers.path_m:.0f} m, {numbers.steps} exchanges, {numbers.turns} turns"
        self._words(pen, said, "3 sigma: thick watched, thin alone")
        return self._reduced(image)

    def _finish(self, moves: int) -> None:
        """Draw so many moves for good, and what was mapped with them."""
        for move, standing in self._moves[self._done : moves]:
            self._swept(self._pen, move, standing, move.path)
        self._done = max(self._done, moves)
        self._outline(moves)

    def _final(self) -> list[Point]:
        places = [self._report.exploration.start] * self._report.terms.robots
        for move, _ in self._moves:
            places[move.robot] = move.path[-1]
        return places

    def _swept(
        self, pen: ImageDraw.ImageDraw, move: Move, standing: Sequence[Point], path: Sequence[Point]
    ) -> None:
        """What the lines from a robot to its partners beside it passed over, and its way."""
        if move.why is Why.SWEEP:
            watchers = sorted(
                (place for robot, place in enumerate(standing) if robot != move.robot),
                key=lambda place: distance(place, move.path[-1]),
            )
            for watcher in watchers[:2]:
                if distance(watcher, move.path[-1]) <= self._report.terms.range_m * _EDGE:
                    self._fill(pen, (watcher, *path), _tint(track_colour(move.robot)))
        colour = track_colour(move.robot) if move.why is Why.SWEEP else STATES["non-roi"]
        for a, b in pairwise(path):
            pen.line([self._at(a), self._at(b)], colour, _OVERSAMPLING)

    def _outline(self, moves: int) -> None:
        pieces = self._report.exploration.pieces
        while self._pieces < len(pieces) and pieces[self._pieces].moves <= moves:
            ring = [self._at(point) for point in pieces[self._pieces].outline]
            self._pen.line([*ring, ring[0]], OUTLINE, _OVERSAMPLING)
            self._pieces += 1

    def _robots(self, pen: ImageDraw.ImageDraw, places: Sequence[Point]) -> None:
        r = 5 * _OVERSAMPLING
        for robot, place in enumerate(places):
            x, y = self._at(place)
            pen.ellipse((x - r, y - r, x + r, y + r), track_colour(robot), INK)

    def _ellipse(
        self, pen: ImageDraw.ImageDraw, outcome: Outcome, robot: int, place: Point, width: int
    ) -> None:
        shape: Ellipse = outcome.ellipse(robot)
        tilt = math.radians(shape.angle_deg)
        ring = []
        for i in range(_CORNERS + 1):
            along = _SIGMAS * shape.major_m * math.cos(math.tau * i / _CORNERS)
            across = _SIGMAS * shape.minor_m * math.sin(math.tau * i / _CORNERS)
            east = along * math.cos(tilt) - across * math.sin(tilt)
            north = along * math.sin(tilt) + across * math.cos(tilt)
            ring.append(self._at((place[0] + east, place[1] + north)))
        pen.line(ring, track_colour(robot), width)

    def _words(self, pen: ImageDraw.ImageDraw, *lines: str) -> None:
        terms = self._report.terms
        title = f"{terms.mode}, {terms.robots} robots, range {terms.range_m:g} m"
        for row, text in enumerate((title, "   ·   ".join(lines))):
            at = (_MARGIN_PX * _OVERSAMPLING, (6 + 18 * row) * _OVERSAMPLING)
            pen.text(at, text, INK, font(13 * _OVERSAMPLING))

    def _fill(self, pen: ImageDraw.ImageDraw, ring: Sequence[Point], colour: Colour) -> None:
        if len(ring) > 2:
            pen.polygon([self._at(point) for point in ring], colour)

    def _at(self, point: Point) -> Point:
        """Pixels of a point in metres."""
        return (
            (point[0] - self._west) * self._scale + _MARGIN_PX * _OVERSAMPLING,
            (self._north - point[1]) * self._scale + _TITLE_PX * _OVERSAMPLING,
        )

    @staticmethod
    def _reduced(image: Image.Image) -> Image.Image:
        return image.reduce(_OVERSAMPLING)


def _tint(colour: Colour) -> Colour:
    """A colour, most of it paper."""
    red, green, blue = (round(0.3 * c + 0.7 * p) for c, p in zip(colour, PAPER, strict=True))
    return red, green, blue


def _part(path: Sequence[Point], length_m: float) -> list[Point]:
    """The beginning of a path, so long."""
    found = [path[0]]
    for a, b in pairwise(path):
        leg = distance(a, b)
        if leg >= length_m:
            return [*found, between(a, b, max(length_m, 0.0) / leg if leg else 0.0)]
        found.append(b)
        length_m -= leg
    return found
