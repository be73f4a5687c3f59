"""A scene as a complete picture: title, map, legend, scale, north arrow, notes."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from uavmap.base.atomic_write import write_bytes
from uavmap.output.drawing.palette import FAINT, INK, LAND, PAPER, Style
from uavmap.output.drawing.raster import Canvas, cell_picture, encode_png, picture, text_width
from uavmap.output.drawing.scene import (
    Area,
    Box,
    Dot,
    Entry,
    Label,
    Line,
    Place,
    Scene,
    Shape,
    View,
)

LEGEND_ROW_PX: Final = 26.0
SAMPLE_PX: Final = 30.0
_TEXT_PX: Final = 15.0
_SAMPLE_GAP_PX: Final = 10.0
_SMALL_PX: Final = 13.0
_SQUARE_PX: Final = 16.0


def legend_sample(
    entry: Entry, left: float, middle: float, width: float = SAMPLE_PX
) -> Iterator[Shape]:
    """Draw the sample of an entry of the legend, `width` pixels wide."""
    centre = left + width / 2.0
    if isinstance(entry.sample, Style):
        yield Line.through([(left, middle), (left + width, middle)], entry.sample)
    elif isinstance(entry.sample[0], tuple):
        yield Dot((centre, middle), entry.sample)
    else:
        half = min(width, _SQUARE_PX) / 2.0
        for side, colour in ((half, FAINT), (half - 1.0, entry.sample)):
            corners = (centre - side, middle - side), (centre + side, middle + side)
            yield Box(*corners, colour)


def legend_column(entries: Iterable[Entry], corner: Place) -> Iterator[Shape]:
    """Draw a legend downwards from its upper left corner, an entry every `LEGEND_ROW_PX` pixels."""
    x, y = corner
    for number, entry in enumerate(entries):
        middle = y + (number + 0.5) * LEGEND_ROW_PX
        yield from legend_sample(entry, x, middle)
        yield Label((x + SAMPLE_PX + _SAMPLE_GAP_PX, middle), entry.text, _TEXT_PX, INK)


def legend_width(entries: Iterable[Entry]) -> float:
    """Return the width of a legend in one column, px."""
    longest = max((text_width(entry.text, _TEXT_PX) for entry in entries), default=0.0)
    return SAMPLE_PX + _SAMPLE_GAP_PX + longest


def legend_row(entries: Iterable[Entry], left: float, middle: float) -> Iterator[Shape]:
    """Draw a legend in one line, from a column rightwards."""
    for entry in entries:
        yield from legend_sample(entry, left, middle, 14.0)
        yield Label((left + 20.0, middle), entry.text, _SMALL_PX, FAINT)
        left += legend_row_width([entry])


def legend_row_width(entries: Iterable[Entry]) -> float:
    """Return the width of a legend in one line, px."""
    return sum(36.0 + text_width(entry.text, _SMALL_PX) for entry in entries)


# --- scale and north ------------------------------------------------------------------------------
LONGEST_PX: Final = 190.0
"""Maximum length of a scale bar, px."""
BAR_HEIGHT_PX: Final = 26.0
ARROW_HEIGHT_PX: Final = 40.0
_MIDDLE_PX: Final = 110.0
"""Minimum length of a scale bar with a label in its middle, px."""
_STEPS: Final = (1.0, 2.0, 5.0, 10.0)
_SLACK: Final = 1e-6


def step_down(longest: float) -> float:
    """Return the largest round step that is at most `longest`.

    >>> step_down(37.0), step_down(5.0), step_down(1900.0)
    (20.0, 5.0, 1000.0)
    """
    power = 10.0 ** math.floor(math.log10(longest))
    return max(step * power for step in _STEPS if step * power <= longest * (1.0 + _SLACK))


def step_up(least: float) -> float:
    """Return the smallest round step that is at least `least`.

    >>> step_up(0.00031), step_up(0.7), step_up(3.0)
    (0.0005, 1.0, 5.0)
    """
    power = 10.0 ** math.floor(math.log10(least))
    return min(step * power for step in _STEPS if step * power >= least * (1.0 - _SLACK))


def step_near(about: float) -> float:
    """Return the round step nearest to `about`, by ratio.

    >>> step_near(1.9), step_near(0.27), step_near(26.0)
    (2.0, 0.2, 20.0)
    """
    power = 10.0 ** math.floor(math.log10(about))
    nearest = min(_STEPS, key=lambda step: abs(math.log(step * power / about)))
    return round(nearest * power, 6)


def scale_bar(corner: Place, px_per_m: float) -> Iterator[Shape]:
    """Draw a bar of a round length, rightwards and downwards from a corner."""
    x, y = corner
    length_m = step_down(LONGEST_PX / px_per_m)
    right, low = x + length_m * px_per_m, y + 6.0
    yield Box((x - 1.0, y - 1.0), (right + 1.0, low + 1.0), INK)
    yield Box(((x + right) / 2.0, y), (right, low), PAPER)
    yield Label((x, low + 12.0), "0", 13.0, INK)
    if right - x >= _MIDDLE_PX:
        yield Label(((x + right) / 2.0, low + 12.0), f"{length_m / 2.0:g}", 13.0, INK, "middle")
    yield Label((right, low + 12.0), f"{length_m:g} m", 13.0, INK, "end")


def north_arrow(corner: Place) -> Iterator[Shape]:
    """Draw an arrow upwards, half dark, with a label on its right."""
    x, y = corner
    base, notch = y + ARROW_HEIGHT_PX, y + ARROW_HEIGHT_PX - 9.0
    tip = (x + 12.0, y)
    right = (tip, (x + 21.0, base), (x + 12.0, notch))
    yield Area((tip, (x + 3.0, base), (x + 12.0, notch)), INK)
    yield Area(right, PAPER)
    yield Line.through(right, Style(INK, 1.0), closed=True)
    yield Label((x + 32.0, y + 16.0), "N", 17.0, INK)
    yield Label((x + 32.0, y + 34.0), "grid north", 13.0, FAINT)


LEFT_PX: Final = 84
"""Left margin of a map, px: the labels of a graticule stand there."""
RIGHT_PX: Final = 24
ABOVE_PX: Final = 8 + int(ARROW_HEIGHT_PX)
BELOW_PX: Final = 36 + int(BAR_HEIGHT_PX)


def around_map(view: View) -> Iterator[Shape]:
    """Draw frame, scale and north arrow of a map, in pixels from its upper left corner."""
    wide, high = float(view.width_px), float(view.height_px)
    frame = [(0.0, 0.0), (wide, 0.0), (wide, high), (0.0, high)]
    yield Line.through(frame, Style(FAINT, 1.0), closed=True)
    yield from scale_bar((0.0, high + 30.0), view.px_per_m)
    yield from north_arrow((wide - 100.0, -ARROW_HEIGHT_PX - 4.0))


# --- the sheet ------------------------------------------------------------------------------------
MARGIN_PX: Final = 24
TITLE_PX: Final = 70
_TITLE_SIZE_PX: Final = 26.0
_SUBTITLE_SIZE_PX: Final = 14.0
_NOTE_SIZE_PX: Final = 13.0
_NOTE_PX: Final = 20.0
_NOTE_LETTERS: Final = 52
_GAP_PX: Final = 24.0
_NARROWEST_PX: Final = 206.0
"""Minimum width of the column beside the map, px: the scale bar fits."""


def write_sheet(scene: Scene, path: Path, photograph: NDArray[np.uint8] | None = None) -> None:
    """Write the picture of a scene as PNG; `photograph` is as in `cell_picture`."""
    write_bytes(path, encode_png(draw_sheet(scene, photograph), photograph=photograph is not None))


def draw_sheet(scene: Scene, photograph: NDArray[np.uint8] | None = None) -> Image.Image:
    """Draw the picture of a scene."""
    view = scene.view
    wrapped = (textwrap.wrap(n, _NOTE_LETTERS, subsequent_indent="   ") for n in scene.notes)
    notes = [line for lines in wrapped for line in lines]
    wide = max(
        _NARROWEST_PX,
        legend_width(scene.legend),
        *(text_width(line, _NOTE_SIZE_PX) for line in notes),
    )
    fixed = 3 * _GAP_PX + BAR_HEIGHT_PX + ARROW_HEIGHT_PX
    high = len(scene.legend) * LEGEND_ROW_PX + fixed + len(notes) * _NOTE_PX
    beside = View.page(MARGIN_PX + wide + MARGIN_PX, high)
    head = [
        Label((MARGIN_PX, 30.0), scene.title, _TITLE_SIZE_PX, INK),
        Label((MARGIN_PX, 54.0), scene.subtitle, _SUBTITLE_SIZE_PX, FAINT),
    ]
    width = max(
        MARGIN_PX + view.width_px + beside.width_px,
        *(round(text_width(line.text, line.size_px)) + 2 * MARGIN_PX for line in head),
    )
    below = max(view.height_px, beside.height_px) + MARGIN_PX
    sheet = Image.new("RGB", (width, TITLE_PX + below), PAPER)
    sheet.paste(picture(View.page(width, TITLE_PX), head), (0, 0))
    sheet.paste(_map(scene, photograph), (MARGIN_PX, TITLE_PX))
    column = picture(beside, _side(scene, notes))
    sheet.paste(column, (MARGIN_PX + view.width_px, TITLE_PX))
    return sheet


def _map(scene: Scene, photograph: NDArray[np.uint8] | None) -> Image.Image:
    view = scene.view
    wide, high = view.width_px, view.height_px
    ground = None if scene.cells is None else cell_picture(scene.cells, view, LAND, photograph)
    canvas = Canvas((wide, high), LAND, ground)
    for shape in scene.shapes:
        canvas.draw(shape, view)
    frame = [(0.5, 0.5), (wide - 0.5, 0.5), (wide - 0.5, high - 0.5), (0.5, high - 0.5)]
    canvas.draw(Line.through(frame, Style(FAINT, 1.0), closed=True), View.page(wide, high))
    return canvas.shown()


def _side(scene: Scene, notes: list[str]) -> Iterator[Shape]:
    left, low = float(MARGIN_PX), len(scene.legend) * LEGEND_ROW_PX
    yield from legend_column(scene.legend, (left, 0.0))
    low += _GAP_PX
    yield from scale_bar((left, low), scene.view.px_per_m)
    low += BAR_HEIGHT_PX + _GAP_PX
    yield from north_arrow((left, low))
    low += ARROW_HEIGHT_PX + _GAP_PX
    for number, line in enumerate(notes):
        yield Label((left, low + (number + 0.5) * _NOTE_PX), line, _NOTE_SIZE_PX, INK)
