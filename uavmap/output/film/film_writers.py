"""The frames of a film, and films and drawings as files: GIF, MP4, PNG, SVG.

A frame shows cells, tree, trails and robots under a caption, grid north up. Cells are a whole
number of pixels wide, so their edges stay sharp.
"""

from __future__ import annotations

import io
import math
import os
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final, TypeVar

import cv2
import numpy as np
from PIL import Image

from missions.errors import OutputError
from missions.units import Cell
from uavmap.output.documents import save
from uavmap.output.drawing import palette
from uavmap.output.drawing.palette import TRACKS, Colour, Style
from uavmap.output.drawing.raster import Canvas, Extent
from uavmap.output.drawing.scene import Box, Dot, Entry, Label, Line, Shape, View
from uavmap.output.drawing.sheet import legend_row, legend_row_width
from uavmap.output.facts.map_model import NOT_ROI
from uavmap.output.film.film import FPS, HOLD_S, Film, Place, Reel, Unit

MARGIN_PX: Final = 16
CAPTION_PX: Final = 74
LEGEND_PX: Final = 34
NARROWEST_PX: Final = 460
_GROUND_PX: Final = (880, 560)
_LARGEST_PX: Final = 1600
_WIDEST_CELL_PX: Final = 40
_SEAM_PX: Final = 5
"""Minimum side of a cell with a seam around it and edges of the tree in it, px."""
_TRAIL_S: Final = 0.8
"""Seconds of the film that a trail shows."""
_TRAIL_PARTS: Final = 4

EDGE: Colour = (88, 98, 92)
KEY_COLOURS: tuple[Colour, ...] = (
    *(palette.PAPER, palette.INK, palette.FAINT, palette.HIDDEN, EDGE),
    *palette.STATES.values(),
)
"""Colours that a picture with a palette must hold exactly."""


class Stage:
    """A stage that draws the frames of a film, from the first to the last.

    It has the ground, a copy of it with moving shapes on top, and the shown frame. Only changed
    parts are copied and shrunk again.
    """

    def __init__(self, film: Film) -> None:
        self._film, self._reel = film, Reel(film)
        west, south, east, north = film.bounds()
        across, up = east - west + 1, north - south + 1
        self.cell_px = max(min(_GROUND_PX[0] // across, _GROUND_PX[1] // up, _WIDEST_CELL_PX), 1)
        if max(across, up) * self.cell_px > _LARGEST_PX:
            raise OutputError(
                f"{across} x {up} cells are too many to show: at most {_LARGEST_PX} along a side"
            )
        entries = list(self._legend())
        wide = max(across * self.cell_px, math.ceil(legend_row_width(entries)))
        width = max(wide + 2 * MARGIN_PX, NARROWEST_PX)
        height = CAPTION_PX + up * self.cell_px + LEGEND_PX
        # video codecs need even sides
        self.size = (width + width % 2, height + height % 2)
        left = (self.size[0] - across * self.cell_px) // 2
        self._page = View.page(*self.size)
        self._view = View(
            west - 0.5 - left / self.cell_px,
            north + 0.5 + CAPTION_PX / self.cell_px,
            self.cell_px,
            *self.size,
        )
        self._cells = film.cells
        self._radius_px = max(film.radius * self.cell_px, 4.5)
        self._tail_t = _TRAIL_S * FPS * film.end_t / len(film.times())
        self._ground = Canvas(self.size)
        for cell in film.roi:
            self._ground.draw(self._tile(cell, palette.HIDDEN), self._view)
        words = Label((MARGIN_PX, 21.0), film.title, 18.0, palette.INK)
        names = legend_row(entries, MARGIN_PX, self.size[1] - LEGEND_PX / 2)
        for shape in (words, *names):
            self._ground.draw(shape, self._page)

    def pixel(self, place: Place) -> tuple[float, float]:
        """Return column and row of a place in the frame."""
        return self._view.pixel(place)

    def frames(self, times: Iterable[float]) -> Iterator[Image.Image]:
        """Yield the frames at some times, ascending."""
        scene, frame = self._ground.copy(), self._ground.shown()
        moved: list[Extent] = []
        for t in times:
            stale = [*moved, *self._forward(t)]
            for extent in stale:
                scene.restore(self._ground, extent)
            moved = [scene.draw(shape, self._page) for shape in self._caption(t)]
            moved += [scene.draw(shape, self._view) for shape in self._moving(t)]
            for extent in dict.fromkeys([*stale, *moved]):
                frame.paste(scene.shown(extent), extent)
            yield frame.copy()

    # --- the ground ------------------------------------------------------------------------
    def _forward(self, t: float) -> list[Extent]:
        """Change the cells to their state at a time; return the changed parts."""
        touched: dict[Cell, None] = {}
        for change in self._reel.forward(t):
            touched[change.cell] = None
            if change.parent is not None:
                touched[change.parent] = None
        states = self._reel.states
        known = [cell for cell in touched if cell in states]
        tiles = [self._tile(cell, palette.STATES[states[cell]]) for cell in known]
        edges = [edge for cell in known for edge in self._edges(cell)]
        shapes: list[Shape] = [*tiles, *edges]
        return [self._ground.draw(shape, self._view) for shape in shapes]

    def _tile(self, cell: Cell, colour: Colour) -> Box:
        side = 1.0 - (1.0 / self.cell_px if self.cell_px >= _SEAM_PX else 0.0)
        west, north = cell.east - 0.5, cell.north + 0.5
        return Box((west, north), (west + side, north - side), colour)

    def _edges(self, cell: Cell) -> Iterator[Line]:
        if self.cell_px < _SEAM_PX:
            return
        parents, style = self._reel.parents, Style(EDGE, max(0.07 * self.cell_px, 1.0))
        for end in cell.neighbours():
            if parents.get(end) == cell or parents.get(cell) == end:
                # from north or east, so that both cells of an edge draw the same pixels
                yield Line.through((max(cell, end), min(cell, end)), style)

    # --- what moves ------------------------------------------------------------------------
    def _moving(self, t: float) -> Iterator[Shape]:
        film = self._film
        radius = max(0.2 * self.cell_px, 4.0)
        yield Dot(
            film.start_at(t),
            ((radius, palette.PAPER), (0.75 * radius, palette.INK), (0.3 * radius, palette.PAPER)),
        )
        for robot in film.tracks:
            yield from self._trail(robot, t)
        if film.footprint is not None:
            for robot in film.tracks:
                place = film.fix(robot, t).place
                half = film.footprint.east / 2, film.footprint.north / 2
                corners = [
                    (place.east + a * half[0], place.north + b * half[1])
                    for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
                ]
                yield Line.through(corners, Style(palette.track_colour(robot), 2.0), closed=True)
        for robot in film.tracks:
            yield self._robot(robot, t)

    def _trail(self, robot: int, t: float) -> Iterator[Line]:
        part_t = self._tail_t / _TRAIL_PARTS
        for part in range(_TRAIL_PARTS):
            since = t - part_t * (_TRAIL_PARTS - part)
            width_px = self._radius_px * (0.25 + 0.15 * part)
            places = self._film.trail(robot, since, since + part_t)
            yield Line.through(places, Style(palette.track_colour(robot), width_px))

    def _robot(self, robot: int, t: float) -> Dot:
        """Return a disc with a rim; white inside while the robot is on the ground."""
        fix, radius, colour = self._film.fix(robot, t), self._radius_px, palette.track_colour(robot)
        rings = (
            (radius + 4 / 3, palette.PAPER),
            (radius + 1 / 3, palette.INK),
            (radius - 2 / 3, colour),
        )
        return Dot(fix.place, (*rings, (radius * 0.55, colour if fix.aloft else palette.PAPER)))

    # --- what is written -------------------------------------------------------------------
    def _caption(self, t: float) -> Iterator[Shape]:
        yield Label((MARGIN_PX, 46.0), caption(self._film, self._reel, t), 14.0, palette.FAINT)
        everything, wide = max(self._cells, 1), self.size[0] - 2 * MARGIN_PX
        yield Box((MARGIN_PX, 60.0), (MARGIN_PX + wide, 64.0), palette.HIDDEN)
        at = 0
        for state in ("explored", "under exploration", "unexplored"):
            if count := self._reel.count(state):
                left, right = (MARGIN_PX + wide * n / everything for n in (at, at + count))
                yield Box((left, 60.0), (right, 64.0), palette.STATES[state])
                at += count

    def _legend(self) -> Iterator[Entry]:
        film = self._film
        seen = {change.state for change in film.changes}
        nonstop = film.footprint is not None
        names = palette.NONSTOP_NAMES if nonstop else palette.STATE_NAMES
        always = palette.STATES.keys() - {"skipped"} - NOT_ROI
        if nonstop:
            always = always - {"unexplored"}
        for state, colour in palette.STATES.items():
            if state in always or state in seen:
                yield Entry(colour, names[state])
        if film.roi:
            yield Entry(palette.HIDDEN, "not seen yet")


def caption(film: Film, reel: Reel, t: float) -> str:
    """Write the progress of a film."""
    visited = reel.count("under exploration", "explored")
    known = visited + reel.count("unexplored")
    if film.footprint is not None:
        decided = reel.count("explored")
        return f"{_time(film, t)}   ·   {known} of {len(film.roi)} cells seen, {decided} decided"
    of_all = f" of {len(film.roi)}" if film.unit is Unit.STEPS else " ROI"
    return f"{_time(film, t)}   ·   {known}{of_all} cells known, {visited} visited"


def _time(film: Film, t: float) -> str:
    if film.unit is Unit.STEPS:
        return f"t = {t:.0f} of {film.end_t:g}"
    (m, s), (end_m, end_s) = divmod(round(t), 60), divmod(round(film.end_t), 60)
    return f"{m}:{s:02d} of {end_m}:{end_s:02d} min"


# --- files ----------------------------------------------------------------------------------------
FILMS: Final = (".gif", ".mp4")
DRAWINGS: Final = (".png", ".svg")
_REPORT_INTERVAL_S: Final = 2.0
_SAMPLES: Final = 4
_UNKNOWN: Final = 255

Report = Callable[[str], None]
T = TypeVar("T")


def check_path(path: Path, suffixes: tuple[str, ...]) -> None:
    """Raise `OutputError` for another ending of the name, and a missing or read-only folder."""
    if path.suffix.lower() not in suffixes:
        raise OutputError(f"{path}: the name must end in {' or '.join(suffixes)}")
    if path.is_dir():
        raise OutputError(f"{path} is a folder, not a file")
    if not path.parent.is_dir():
        raise OutputError(f"{path} cannot be written: there is no folder {path.parent}")
    if not os.access(path.parent, os.W_OK):
        raise OutputError(f"{path} cannot be written: the folder {path.parent} is read-only")


def write_film(film: Film, path: Path, report: Report) -> None:
    """Write a film as GIF or MP4, by the end of the name; report progress every two seconds.

    The same film gives the same GIF, byte for byte. Raises `OutputError`.
    """
    check_path(path, FILMS)
    stage, times = Stage(film), film.times()
    frames = _with_progress(stage.frames(times), f"{path.name}: frame {{}} of {len(times)}", report)
    if path.suffix.lower() == ".gif":
        palette = _Palette(film)
        save(path, gif([palette.convert(frame) for frame in frames]))
    else:
        save(path, mp4(stage.size, frames))


def _with_progress(items: Iterable[T], text: str, report: Report) -> Iterator[T]:
    reported_s = time.monotonic()
    for number, item in enumerate(items, start=1):
        if time.monotonic() - reported_s >= _REPORT_INTERVAL_S:
            reported_s = time.monotonic()
            report(text.format(number))
        yield item


def gif(frames: Sequence[Image.Image]) -> bytes:
    """Encode frames that share a palette as a GIF that loops and holds the last."""
    first, *rest = frames
    buffer = io.BytesIO()
    first.save(
        buffer,
        "GIF",
        save_all=True,
        append_images=rest,
        duration=[1000 // FPS] * len(rest) + [round(HOLD_S * 1000)],
        loop=0,
        optimize=False,
    )
    return buffer.getvalue()


class _Palette:
    """The palette of a film: colours with a meaning are exact, which Pillow would round."""

    def __init__(self, film: Film) -> None:
        keys = list(dict.fromkeys((*KEY_COLOURS, *TRACKS)))
        times = film.times()
        chosen = [times[i * (len(times) - 1) // (_SAMPLES - 1)] for i in range(_SAMPLES)]
        mosaic = np.concatenate([np.asarray(frame) for frame in Stage(film).frames(chosen)])
        # Pillow needs one of 256 colours to mark pixels that a frame does not change
        blends = Image.fromarray(mosaic).quantize(255 - len(keys), Image.Quantize.MEDIANCUT)
        self._flat = [*(c for key in keys for c in key), *(blends.getpalette() or [])][: 3 * 255]
        self._palette = np.array(self._flat, np.int64).reshape(-1, 3)
        # the index of every possible colour
        self._indices = np.full(1 << 24, _UNKNOWN, np.uint8)

    def convert(self, frame: Image.Image) -> Image.Image:
        # red is the lowest byte
        codes = np.asarray(frame.convert("RGBX")).view("<u4")[..., 0] & 0xFFFFFF
        indices = self._indices[codes]
        for code in np.unique(codes[indices == _UNKNOWN]).tolist():
            colour = (code & 255, code >> 8 & 255, code >> 16)
            self._indices[code] = np.argmin(((self._palette - colour) ** 2).sum(axis=1))
        few = Image.fromarray(self._indices[codes] if _UNKNOWN in indices else indices)
        few.putpalette(self._flat)
        return few


def mp4(size: tuple[int, int], frames: Iterable[Image.Image]) -> bytes:
    """Encode frames as MP4 (MPEG-4 part 2). Raises `OutputError` if OpenCV lacks the codec."""
    with tempfile.TemporaryDirectory() as folder:
        name = str(Path(folder) / "film.mp4")
        codec = cv2.VideoWriter.fourcc(*"mp4v")
        video = cv2.VideoWriter(name, codec, float(FPS), size)
        if not video.isOpened():
            raise OutputError("this OpenCV cannot write MP4 (codec mp4v is missing); write a .gif")
        for frame in frames:
            last = frame
            video.write(cv2.cvtColor(np.asarray(frame), cv2.COLOR_RGB2BGR))
        for _ in range(round(HOLD_S * FPS)):
            video.write(cv2.cvtColor(np.asarray(last), cv2.COLOR_RGB2BGR))
        video.release()
        return Path(name).read_bytes()
