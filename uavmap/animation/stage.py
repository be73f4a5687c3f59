"""The frames of a film: cells, tree, trails and robots under a caption, grid north up.

Drawn at three times the size and shrunk, which smooths what is round; cells are a whole number of
pixels wide, so their edges stay sharp. Of the ground only what changes is drawn anew.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Final

from PIL import Image, ImageDraw

from missions.errors import OutputError
from missions.units import Cell
from uavmap.animation.film import FPS, Film, Place, Reel, Unit
from uavmap.results.model import NOT_ROI, State
from uavmap.results.palette import STATES, Colour, track_colour
from uavmap.results.picture import FAINT, INK, NAMES, PAPER, font

OVERSAMPLING: Final = 3
MARGIN_PX: Final = 16
CAPTION_PX: Final = 74
LEGEND_PX: Final = 34
NARROWEST_PX: Final = 460
_GROUND_PX: Final = (880, 560)
_LARGEST_PX: Final = 1600
_WIDEST_CELL_PX: Final = 40
_TRAIL_S: Final = 0.8
"""Seconds of the film that a trail shows."""
_TRAIL_PARTS: Final = 4

_STATES_OF_A_TREE: Final[dict[State, str]] = {
    state: state for state in STATES if state not in NOT_ROI and state != "skipped"
}
_STATES_IN_FLIGHT: Final[dict[State, str]] = {
    "explored": "decided",
    "under exploration": "majority so far",
}

Box = tuple[int, int, int, int]
"""Left, top, right and bottom in pixels of the frame; the last two are outside."""

HIDDEN: Colour = (207, 222, 242)
"""A cell of the ROI that nobody has seen yet."""
EDGE: Colour = (88, 98, 92)
KEY_COLOURS: tuple[Colour, ...] = (PAPER, INK, FAINT, HIDDEN, EDGE, *STATES.values())
"""Colours that a picture with few colours must hold exactly."""


class Stage:
    """Draws the frames of a film, from the first to the last.

    Three pictures: the ground (drawn large), a copy of it with what moves on top, and the frame
    (shrunk). Only boxes in which something changed are copied and shrunk again.
    """

    def __init__(self, film: Film) -> None:
        self._film, self._reel = film, Reel(film)
        west, south, east, north = film.bounds()
        across, up = east - west + 1, north - south + 1
        self.cell_px = max(min(_GROUND_PX[0] // across, _GROUND_PX[1] // up, _WIDEST_CELL_PX), 1)
        if max(across, up) * self.cell_px > _LARGEST_PX:
            raise OutputError(
                f"{across} x {up} cells are too many to show; {_LARGEST_PX} a side at most"
            )
        width = max(across * self.cell_px + 2 * MARGIN_PX, NARROWEST_PX)
        height = CAPTION_PX + up * self.cell_px + LEGEND_PX
        # video codecs want even sides
        self.size = (width + width % 2, height + height % 2)
        left = (self.size[0] - across * self.cell_px) // 2
        self._origin = (
            left - (west - 0.5) * self.cell_px,
            CAPTION_PX + (north + 0.5) * self.cell_px,
        )
        self._cells = film.cells
        self._tail_t = _TRAIL_S * FPS * film.end_t / len(film.times())
        k = OVERSAMPLING
        self._ground = Image.new("RGB", (self.size[0] * k, self.size[1] * k), PAPER)
        self._pen = ImageDraw.Draw(self._ground)
        for cell in film.roi:
            self._tile(cell, HIDDEN)
        self._pen.text((MARGIN_PX * k, 12 * k), film.title, fill=INK, font=font(18 * k))
        self._legend()

    def pixel(self, place: Place) -> tuple[float, float]:
        """Column and row in the frame of a place."""
        x, y = self._origin
        return x + place.east * self.cell_px, y - place.north * self.cell_px

    def frames(self, times: Iterable[float]) -> Iterator[Image.Image]:
        """The frames at some times, ascending."""
        scene, picture = self._ground.copy(), self._ground.reduce(OVERSAMPLING)
        pen = ImageDraw.Draw(scene)
        moved: list[Box] = []
        for t in times:
            stale = [*moved, *self._forward(t)]
            for box in stale:
                large = _large(box)
                scene.paste(self._ground.crop(large), large)
            moved = [self._caption(pen, t), self._start(pen, t)]
            moved += [self._trail(pen, robot, t) for robot in self._film.tracks]
            if self._film.footprint is not None:
                moved += [self._frame(pen, robot, t) for robot in self._film.tracks]
            moved += [self._robot(pen, robot, t) for robot in self._film.tracks]
            for box in dict.fromkeys([*stale, *moved]):
                picture.paste(scene.reduce(OVERSAMPLING, _large(box)), box)
            yield picture.copy()

    # --- the ground ------------------------------------------------------------------------
    def _forward(self, t: float) -> list[Box]:
        """Let the cells become what they are at a time; returns where something changed."""
        touched: dict[Cell, None] = {}
        for change in self._reel.forward(t):
            touched[change.cell] = None
            if change.parent is not None:
                touched[change.parent] = None
        known = [cell for cell in touched if cell in self._reel.states]
        for cell in known:
            self._tile(cell, STATES[self._reel.states[cell]])
        for cell in known:
            self._edges(cell)
        corners = [
            (Place(c.east - 0.5, c.north + 0.5), Place(c.east + 0.5, c.north - 0.5))
            for c in touched
        ]
        return [self._box([self.pixel(a), self.pixel(b)], 1.0) for a, b in corners]

    def _tile(self, cell: Cell, colour: Colour) -> None:
        k = OVERSAMPLING
        x, y = self.pixel(Place(cell.east - 0.5, cell.north + 0.5))
        seam = 1 if self.cell_px >= 5 else 0
        left, top, side = round(x) * k, round(y) * k, (self.cell_px - seam) * k
        self._pen.rectangle((left, top, left + side - 1, top + side - 1), fill=colour)

    def _edges(self, cell: Cell) -> None:
        """The edges of the tree that end in a cell."""
        if self.cell_px < 5:
            return
        parents = self._reel.parents
        ends = [n for n in cell.neighbours() if parents.get(n) == cell or parents.get(cell) == n]
        width = max(round(0.07 * self.cell_px * OVERSAMPLING), 3)
        for end in ends:
            # from north or east, so that an edge is the same pixels from whichever cell it is drawn
            high, low = max(cell, end), min(cell, end)
            line = (*self._at(Place(*high)), *self._at(Place(*low)))
            self._pen.line(line, fill=EDGE, width=width)

    def _at(self, place: Place) -> tuple[float, float]:
        """A place in pixels of the picture that is drawn."""
        x, y = self.pixel(place)
        return x * OVERSAMPLING, y * OVERSAMPLING

    def _box(self, pixels: Iterable[tuple[float, float]], pad_px: float) -> Box:
        """The part of the frame around some of its pixels, which may lie outside."""
        xs, ys = zip(*pixels, strict=True)
        across, down = self.size
        left, top = math.floor(min(xs) - pad_px), math.floor(min(ys) - pad_px)
        right, bottom = math.ceil(max(xs) + pad_px), math.ceil(max(ys) + pad_px)
        return (
            min(max(left, 0), across - 1),
            min(max(top, 0), down - 1),
            max(min(right, across), 1),
            max(min(bottom, down), 1),
        )

    # --- what moves ------------------------------------------------------------------------
    def _trail(self, pen: ImageDraw.ImageDraw, robot: int, t: float) -> Box:
        """The way behind a robot, in parts that grow thinner."""
        part_t, pixels = self._tail_t / _TRAIL_PARTS, []
        for part in range(_TRAIL_PARTS):
            since = t - part_t * (_TRAIL_PARTS - part)
            places = self._film.trail(robot, since, since + part_t)
            pixels += [self.pixel(place) for place in places]
            width = self._radius() * (0.25 + 0.15 * part)
            points = [self._at(place) for place in places]
            pen.line(points, fill=track_colour(robot), width=max(round(width), 2), joint="curve")
        return self._box(pixels, self._radius() / OVERSAMPLING + 1.0)

    def _frame(self, pen: ImageDraw.ImageDraw, robot: int, t: float) -> Box:
        """The outline of what a robot sees."""
        place, (east, north) = self._film.fix(robot, t).place, self._film.footprint or Place(0, 0)
        corners = [
            Place(place.east - east / 2, place.north + north / 2),
            Place(place.east + east / 2, place.north - north / 2),
        ]
        low, high = (self._at(corner) for corner in corners)
        width = 2 * OVERSAMPLING
        pen.rectangle((*low, *high), outline=track_colour(robot), width=width)
        return self._box([self.pixel(corner) for corner in corners], width / OVERSAMPLING + 1.0)

    def _robot(self, pen: ImageDraw.ImageDraw, robot: int, t: float) -> Box:
        """A disc with a rim; white inside while the robot is on the ground."""
        fix, radius = self._film.fix(robot, t), self._radius()
        inside = track_colour(robot) if fix.aloft else PAPER
        rings = [(radius + 4, PAPER), (radius + 1, INK), (radius - 2, track_colour(robot))]
        return self._discs(pen, fix.place, [*rings, (radius * 0.55, inside)])

    def _start(self, pen: ImageDraw.ImageDraw, t: float) -> Box:
        """Where all begin: a ringed dot."""
        radius = max(0.2 * self.cell_px, 4.0) * OVERSAMPLING
        rings = [(radius, PAPER), (0.75 * radius, INK), (0.3 * radius, PAPER)]
        return self._discs(pen, self._film.start_at(t), rings)

    def _discs(
        self, pen: ImageDraw.ImageDraw, place: Place, rings: list[tuple[float, Colour]]
    ) -> Box:
        """Discs about a place, the largest first; radii in pixels of the picture drawn."""
        x, y = self._at(place)
        for r, colour in rings:
            pen.ellipse((x - r, y - r, x + r, y + r), fill=colour)
        return self._box([self.pixel(place)], rings[0][0] / OVERSAMPLING + 1.0)

    def _radius(self) -> float:
        """Of a robot's disc, in pixels of the picture that is drawn."""
        return max(self._film.radius * self.cell_px, 4.5) * OVERSAMPLING

    # --- what is written -------------------------------------------------------------------
    def _caption(self, pen: ImageDraw.ImageDraw, t: float) -> Box:
        k, text = OVERSAMPLING, caption(self._film, self._reel, t)
        pen.text((MARGIN_PX * k, 37 * k), text, fill=FAINT, font=font(14 * k))
        self._bar(pen)
        return 0, 35, self.size[0], CAPTION_PX - 6

    def _bar(self, pen: ImageDraw.ImageDraw) -> None:
        """How far it has come: the cells by state, as parts of a bar."""
        k, reel = OVERSAMPLING, self._reel
        everything = max(self._cells, 1)
        left, right = MARGIN_PX * k, (self.size[0] - MARGIN_PX) * k
        top, bottom = 60 * k, 64 * k - 1
        pen.rectangle((left, top, right, bottom), fill=HIDDEN)
        at = 0
        for state in ("explored", "under exploration", "unexplored"):
            count = reel.count(state)
            if count:
                x0, x1 = (left + (right - left) * n // everything for n in (at, at + count))
                pen.rectangle((x0, top, x1, bottom), fill=STATES[state])
            at += count

    def _legend(self) -> None:
        k, letters = OVERSAMPLING, font(12 * OVERSAMPLING)
        x, y = float(MARGIN_PX * k), (self.size[1] - LEGEND_PX / 2) * k
        names = _STATES_IN_FLIGHT if self._film.footprint is not None else _STATES_OF_A_TREE
        entries = [(name, STATES[state]) for state, name in names.items()]
        seen = {change.state for change in self._film.changes} & NOT_ROI
        entries += [(NAMES[s], colour) for s, colour in STATES.items() if s in seen]
        if self._film.roi:
            entries.append(("not seen yet", HIDDEN))
        for name, colour in entries:
            self._pen.rectangle((x, y - 5 * k, x + 10 * k, y + 5 * k), fill=colour)
            self._pen.text((x + 15 * k, y), name, fill=FAINT, font=letters, anchor="lm")
            x += 31 * k + letters.getlength(name)


def _large(box: Box) -> Box:
    """The same box in the picture that is drawn."""
    left, top, right, bottom = (side * OVERSAMPLING for side in box)
    return left, top, right, bottom


def caption(film: Film, reel: Reel, t: float) -> str:
    """How far it has come, in words."""
    visited = reel.count("under exploration", "explored")
    known = visited + reel.count("unexplored")
    if film.footprint is not None:
        decided = reel.count("explored")
        return f"{_time(film, t)}   ·   {known} of {len(film.roi)} cells seen, {decided} decided"
    of_all = f" of {len(film.roi)}" if film.unit is Unit.STEPS else " ROI"
    return f"{_time(film, t)}   ·   {known}{of_all} cells known, {visited} visited"


def _time(film: Film, t: float) -> str:
    """The time and the length of the film, as people read it."""
    if film.unit is Unit.STEPS:
        return f"t = {t:.0f} of {film.end_t:g}"
    (m, s), (end_m, end_s) = divmod(round(t), 60), divmod(round(film.end_t), 60)
    return f"{m}:{s:02d} of {end_m}:{end_s:02d} min"
