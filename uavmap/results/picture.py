"""map.png: the map as a picture, grid north up.

Drawn at three times the size and shrunk, which smooths every edge. Nothing depends on fonts of the
machine: the letters are Pillow's own.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType

import numpy as np
import shapely
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from shapely.geometry.base import BaseGeometry

from missions.units import GridPoint
from uavmap.results import png
from uavmap.results.atomic import write_bytes
from uavmap.results.canvas import INK, LAND, PAPER, Canvas
from uavmap.results.legend import Entry, draw_legend, legend_height_px
from uavmap.results.model import MapData, State
from uavmap.results.palette import (
    BOUNDARY,
    OUTLINE,
    STATES,
    TRUTH,
    UNSEARCHED,
    Colour,
    track_colour,
)
from uavmap.results.view import View, ground, ring_on_map, track_on_map, view_of

__all__ = ["INK", "LAND", "PAPER", "Base", "Beneath", "base", "draw", "font", "write"]

OVERSAMPLING = 3
MARGIN_PX = 24
TITLE_PX = 70
LEGEND_PX = 230

FAINT: Colour = (120, 126, 132)
BOX: Colour = (120, 90, 40)
FENCE: Colour = (190, 40, 60)

Beneath = Callable[[View], NDArray[np.uint8] | None]
"""The ground of a view: shape (rows, columns, 4), red, green, blue, and 255 where there is any."""


@dataclass(frozen=True, slots=True)
class Base:
    """The lower layers of a map's picture: what has cells and ground to it, and no lines."""

    view: View
    canvas: Canvas
    photographs: bool


def base(data: MapData, beneath: Beneath | None = None) -> Base:
    """The cells, and maybe the ground beneath them: most of the work, apart from the boundary."""
    view = view_of(data)
    canvas = Canvas(view, OVERSAMPLING)
    for state, colour in STATES.items():
        canvas.cells(data.squares[data.table.are(state)], colour)
    ground_image = None if beneath is None else beneath(view)
    if ground_image is not None:
        canvas.lay_beneath(ground_image, data.squares[data.table.roi])
    return Base(view, canvas, beneath is not None)


def write(data: MapData, path: Path, beneath: Beneath | Base | None = None) -> None:
    """Write the picture to `path`, as PNG, maybe with the ground beneath the cells.

    `beneath` is the ground, or the base that was drawn of the same map meanwhile.
    """
    lower = beneath if isinstance(beneath, Base) else base(data, beneath)
    drawn = _drawn(data, lower)
    write_bytes(path, png.encode(np.asarray(drawn)) if lower.photographs else _small(drawn))


def _small(image: Image.Image) -> bytes:
    """PNG of an image of few colours."""
    buffer = io.BytesIO()
    image.save(buffer, "PNG")
    return buffer.getvalue()


def map_corner_px() -> tuple[int, int]:
    """Column and row in the picture of the map's upper left corner."""
    return MARGIN_PX, TITLE_PX


def draw(data: MapData, beneath: Beneath | None = None) -> Image.Image:
    """The whole picture: title, map, legend."""
    return _drawn(data, base(data, beneath))


def _drawn(data: MapData, lower: Base) -> Image.Image:
    """Three images side by side, each drawn large and shrunk: all of it at once would be so much
    memory that getting it takes longer than drawing."""
    view = lower.view
    left, top = map_corner_px()
    entries = list(_entries(data))
    below = max(view.height_px, legend_height_px(len(entries))) + MARGIN_PX
    beside = MARGIN_PX + LEGEND_PX
    _lines(data, lower.canvas)
    picture = Image.new("RGB", (left + view.width_px + beside, top + below), PAPER)
    picture.paste(_title(data, picture.width), (0, 0))
    picture.paste(_legend(entries, beside, view), (left + view.width_px, top))
    picture.paste(lower.canvas.shown(), (left, top))
    frame = (left, top, left + view.width_px - 1, top + view.height_px - 1)
    ImageDraw.Draw(picture).rectangle(frame, outline=FAINT)
    return picture


def _title(data: MapData, width_px: int) -> Image.Image:
    k, left = OVERSAMPLING, MARGIN_PX
    large = Image.new("RGB", (width_px * k, TITLE_PX * k), PAPER)
    pen = ImageDraw.Draw(large)
    pen.text((left * k, 16 * k), data.mission, fill=INK, font=font(26 * k))
    pen.text((left * k, 46 * k), _subtitle(data), fill=FAINT, font=font(14 * k))
    return large.reduce(k)  # the mean of k by k pixels


def _legend(entries: Sequence[Entry], width_px: int, view: View) -> Image.Image:
    k = OVERSAMPLING
    large = Image.new("RGB", (width_px * k, legend_height_px(len(entries)) * k), PAPER)
    draw_legend(ImageDraw.Draw(large), (MARGIN_PX * k, 0), entries, view.px_per_m * k, k)
    return large.reduce(k)


def _subtitle(data: MapData) -> str:
    cells, minutes = np.count_nonzero(data.table.roi), divmod(round(data.t_s), 60)
    after = f"after {minutes[0]}:{minutes[1]:02d} min"
    if data.pictures is not None:
        after = f"from {data.pictures} pictures"
    area_m2 = cells * data.grid.cell_m**2
    drift = data.grid.drift_speed_m_s
    return f"{cells} cells of {data.grid.cell_m:g} m, {area_m2:,.0f} sq m  ·  {after}" + (
        f"  ·  drifting {drift:g} m/s; tracks as seen from the region" if drift else ""
    )


@lru_cache(maxsize=8)
def font(size_px: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Pillow's built-in letters."""
    return ImageFont.load_default(size_px)


# --- the map ---------------------------------------------------------------------------------
def _lines(data: MapData, canvas: Canvas) -> None:
    """What is drawn over cells and ground."""
    drift_m = np.array(ground(data, GridPoint(0.0, 0.0)))
    for ring in _rings(data.outline):
        canvas.line(ring + drift_m, OUTLINE, 2.5)
    if data.boundary is not None:
        for ring in _rings(data.boundary):
            canvas.line(ring + drift_m, BOUNDARY, 1.3)
    for track in data.tracks:
        points = np.array(track_on_map(data, track)).reshape(-1, 2)
        canvas.line(points, track_colour(track.vehicle), 1.3, alpha=200)
    if data.truth is not None:
        for ring in _rings(data.truth):
            canvas.line(ring + drift_m, TRUTH, 2.0)
    for lane in data.unsearched:
        canvas.line(np.array(ring_on_map(data, lane)), UNSEARCHED, 3.0)
    canvas.dashes(ring_on_map(data, data.box), BOX, dash_px=9)
    for hole in (data.fence, *data.fence_holes):
        canvas.dashes(ring_on_map(data, hole), FENCE, dash_px=4)
    canvas.flag(data.grid.fixed(data.start))


def _rings(shape: BaseGeometry) -> Iterator[NDArray[np.float64]]:
    """Every ring of a polygon or of many, closed; shape (n, 2)."""
    for part in shapely.get_parts(shape):
        if part.geom_type == "Polygon" and not part.is_empty:
            for ring in (part.exterior, *part.interiors):
                points = shapely.get_coordinates(ring)
                yield np.vstack([points, points[1]])  # past the seam: its corner is round as well


NAMES: Mapping[State, str] = MappingProxyType(
    {
        "non-roi": "not region",
        "provisional": "region so far",
        "provisional non-roi": "not region so far",
        "skipped": "skipped by the operator",
    }
)
"""Of states whose own names would not be understood."""


# --- the legend ------------------------------------------------------------------------------
def _entries(data: MapData) -> Iterator[Entry]:
    counts = data.table.counts()
    for state, colour in STATES.items():
        if count := counts.get(state, 0):
            name = NAMES.get(state, state)
            if data.pictures is not None and state == "explored":
                name = "region"  # nobody was there
            yield Entry("square", colour, f"{name} ({count})")
    yield Entry("line", OUTLINE, "outline of the map", 2.5)
    if data.boundary is not None:
        yield Entry("line", BOUNDARY, "boundary by pixels", 1.3)
    if data.truth is not None:
        yield Entry("line", TRUTH, "true region", 2.0)
    for track in data.tracks:
        label = "track" if len(data.tracks) == 1 else f"track of vehicle {track.vehicle}"
        yield Entry("line", track_colour(track.vehicle), label, 1.6)
    if data.unsearched:
        yield Entry("line", UNSEARCHED, "search lane without a judged frame", 3.0)
    yield Entry("dashes", BOX, "search box", 9)
    yield Entry("dashes", FENCE, "geofence", 4)
    yield Entry("dot", INK, "start")
