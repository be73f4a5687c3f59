"""A scene as a picture of its own: title, map, legend, scale, north arrow, notes."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from uavmap.base.atomic_write import write_bytes
from uavmap.output.drawing import legend
from uavmap.output.drawing.palette import FAINT, INK, LAND, PAPER, Style
from uavmap.output.drawing.raster import Canvas, cell_picture, encode_png, picture, text_width
from uavmap.output.drawing.scale import ARROW_HEIGHT_PX, BAR_HEIGHT_PX, north_arrow, scale_bar
from uavmap.output.drawing.scene import Label, Line, Scene, Shape, View

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
        legend.column_width(scene.legend),
        *(text_width(line, _NOTE_SIZE_PX) for line in notes),
    )
    fixed = 3 * _GAP_PX + BAR_HEIGHT_PX + ARROW_HEIGHT_PX
    high = len(scene.legend) * legend.ROW_PX + fixed + len(notes) * _NOTE_PX
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
    left, low = float(MARGIN_PX), len(scene.legend) * legend.ROW_PX
    yield from legend.column(scene.legend, (left, 0.0))
    low += _GAP_PX
    yield from scale_bar((left, low), scene.view.px_per_m)
    low += BAR_HEIGHT_PX + _GAP_PX
    yield from north_arrow((left, low))
    low += ARROW_HEIGHT_PX + _GAP_PX
    for number, line in enumerate(notes):
        yield Label((left, low + (number + 0.5) * _NOTE_PX), line, _NOTE_SIZE_PX, INK)
