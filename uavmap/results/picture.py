"""map.png: the map as a picture, grid north up.

Drawn at three times the size and shrunk, which smooths every edge. Nothing depends on fonts of the
machine: the letters are Pillow's own.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType

import numpy as np
import shapely
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from shapely.geometry import LineString
from shapely.geometry.base import BaseGeometry
from shapely.ops import substring

from missions.units import GridPoint
from uavmap.results.atomic import write_bytes
from uavmap.results.legend import Entry, draw_legend, legend_height_px
from uavmap.results.model import CellRow, MapData, State
from uavmap.results.outline import outline
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

OVERSAMPLING = 3
MARGIN_PX = 24
TITLE_PX = 70
LEGEND_PX = 230

PAPER: Colour = (255, 255, 255)
LAND: Colour = (247, 247, 243)
INK: Colour = (35, 39, 43)
FAINT: Colour = (120, 126, 132)
BOX: Colour = (120, 90, 40)
FENCE: Colour = (190, 40, 60)

THROUGH = 215
THROUGH_REGION = 150
"""How much of the ground shows through cells, 0 to 255."""

NEAREST = Image.Resampling.NEAREST
Pixels = list[tuple[float, float]]


Beneath = Callable[[View], NDArray[np.uint8] | None]
"""The ground of a view: shape (rows, columns, 4), red, green, blue, and 255 where there is any."""


def write(data: MapData, path: Path, beneath: Beneath | None = None) -> None:
    """Write the picture to `path`, as PNG, maybe with the ground beneath the cells."""
    buffer = io.BytesIO()
    # a photograph is noise, which does not become smaller by trying harder
    draw(data, beneath).save(buffer, "PNG", compress_level=6 if beneath is None else 3)
    write_bytes(path, buffer.getvalue())


def map_corner_px() -> tuple[int, int]:
    """Column and row in the picture of the map's upper left corner."""
    return MARGIN_PX, TITLE_PX


def draw(data: MapData, beneath: Beneath | None = None) -> Image.Image:
    """The whole picture: title, map, legend."""
    view, k = view_of(data), OVERSAMPLING
    left, top = map_corner_px()
    entries = list(_entries(data))
    size = (
        left + view.width_px + MARGIN_PX + LEGEND_PX,
        top + max(view.height_px, legend_height_px(len(entries))) + MARGIN_PX,
    )
    picture = Image.new("RGB", (size[0] * k, size[1] * k), PAPER)
    ground_image = None if beneath is None else beneath(view)
    picture.paste(_map(data, view, k, ground_image), (left * k, top * k))
    pen = ImageDraw.Draw(picture)
    pen.rectangle(
        (left * k, top * k, (left + view.width_px) * k, (top + view.height_px) * k),
        outline=FAINT,
        width=k,
    )
    pen.text((left * k, 16 * k), data.mission, fill=INK, font=font(26 * k))
    pen.text((left * k, 46 * k), _subtitle(data), fill=FAINT, font=font(14 * k))
    corner = ((left + view.width_px + MARGIN_PX) * k, top * k)
    draw_legend(pen, corner, entries, view.px_per_m * k, k)
    return picture.resize(size, Image.Resampling.HAMMING)


def _subtitle(data: MapData) -> str:
    cells, minutes = len(data.roi_cells), divmod(round(data.t_s), 60)
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
def _map(data: MapData, view: View, k: int, beneath: NDArray[np.uint8] | None) -> Image.Image:
    canvas = _Canvas(view, k)
    for row in data.cells:
        corners = [ground(data, corner) for corner in data.grid.corners_of(row.cell)]
        canvas.cell(corners[0], corners[2], STATES[row.state])
    if beneath is not None:
        canvas.lay_beneath(beneath, [row for row in data.cells if row.is_roi], data)
    for ring in _rings(outline(data.roi_cells, data.grid)):
        canvas.line([ground(data, point) for point in ring], OUTLINE, 2.5)
    if data.boundary is not None:
        for ring in _rings(data.boundary):
            canvas.line([ground(data, point) for point in ring], BOUNDARY, 1.3)
    for track in data.tracks:
        canvas.line(track_on_map(data, track), track_colour(track.vehicle), 1.3, alpha=190)
    if data.truth is not None:
        for ring in _rings(data.truth):
            canvas.line([ground(data, point) for point in ring], TRUTH, 2.0)
    for lane in data.unsearched:
        canvas.line(ring_on_map(data, lane), UNSEARCHED, 3.0)
    canvas.dashes(ring_on_map(data, data.box), BOX, dash_px=9)
    for hole in (data.fence, *data.fence_holes):
        canvas.dashes(ring_on_map(data, hole), FENCE, dash_px=4)
    canvas.flag(data.grid.fixed(data.start))
    return canvas.image


class _Canvas:
    """The map's own image, drawn on in ground metres; what lies outside is cut off."""

    def __init__(self, view: View, k: int) -> None:
        self.image = Image.new("RGB", (view.width_px * k, view.height_px * k), LAND)
        self._pen = ImageDraw.Draw(self.image)
        self._view, self._k = view, k
        self._ground = view.ground

    def _pixels(self, points: Sequence[GridPoint]) -> Pixels:
        return [(x * self._k, y * self._k) for x, y in map(self._view.pixel, points)]

    def cell(self, south_west: GridPoint, north_east: GridPoint, colour: Colour) -> None:
        """A square with a fine seam around it."""
        (left, bottom), (right, top) = self._pixels([south_west, north_east])
        seam = tuple(round(0.9 * channel + 0.1 * 255) for channel in colour)
        self._pen.rectangle((left, top, right, bottom), fill=colour, outline=seam, width=self._k)

    def lay_beneath(
        self, beneath: NDArray[np.uint8], region: Sequence[CellRow], data: MapData
    ) -> None:
        """Show the ground through the cells: those of the region keep more of their colour."""
        shows = np.where(beneath[..., 3] >= 128, np.uint8(THROUGH), np.uint8(0))
        for row in region:
            corners = [ground(data, corner) for corner in data.grid.corners_of(row.cell)]
            left, bottom = (max(0, round(p)) for p in self._view.pixel(corners[0]))
            right, top = (max(0, round(p)) for p in self._view.pixel(corners[2]))
            part = shows[top:bottom, left:right]
            part[part > 0] = THROUGH_REGION
        # as large as the drawing, which is made smaller again by as much: nothing is interpolated
        photograph, mask = (
            Image.fromarray(np.ascontiguousarray(layer)).resize(self.image.size, NEAREST)
            for layer in (beneath[..., :3], shows)
        )
        self.image.paste(photograph, (0, 0), mask)

    def line(
        self, points: Sequence[GridPoint], colour: Colour, width_px: float, alpha: int = 255
    ) -> None:
        """A line with round corners; where it crosses itself it gets no darker."""
        if len(points) < 2:
            return
        width, pixels = round(width_px * self._k), self._pixels(points)
        # as large as the line and no larger: most are the outlines of a few cells
        left, top, right, bottom = self._around(pixels, width)
        if left >= right or top >= bottom:
            return
        mask = Image.new("L", (right - left, bottom - top), 0)
        moved = [(x - left, y - top) for x, y in pixels]
        ImageDraw.Draw(mask).line(moved, fill=alpha, width=width, joint="curve")
        self.image.paste(colour, (left, top), mask)

    def _around(self, pixels: Pixels, width: int) -> tuple[int, int, int, int]:
        """The part of the image that a line may touch: left, top, right, bottom."""
        columns, rows = zip(*pixels, strict=True)
        reach, (most_right, most_low) = width + 2, self.image.size
        return (
            max(0, math.floor(min(columns)) - reach),
            max(0, math.floor(min(rows)) - reach),
            min(most_right, math.ceil(max(columns)) + reach),
            min(most_low, math.ceil(max(rows)) + reach),
        )

    def dashes(self, ring: Sequence[GridPoint], colour: Colour, dash_px: float) -> None:
        """A closed dashed line, drawn where it is in view."""
        shown = LineString([*ring, ring[0]]).intersection(self._ground)
        period_m = 2 * dash_px / self._view.px_per_m
        for part in shapely.get_parts(shapely.line_merge(shown)):
            for i in range(math.ceil(part.length / period_m)):
                dash = substring(part, i * period_m, (i + 0.5) * period_m)
                points = [GridPoint(x, y) for x, y, *_ in dash.coords]
                if len(points) > 1:
                    self._pen.line(self._pixels(points), fill=colour, width=round(1.6 * self._k))

    def flag(self, point: GridPoint) -> None:
        """The start: a ringed dot."""
        ((x, y),) = self._pixels([point])
        for radius_px, colour in ((7.0, PAPER), (5.5, INK), (2.0, PAPER)):
            r = radius_px * self._k
            self._pen.ellipse((x - r, y - r, x + r, y + r), fill=colour)


def _rings(shape: BaseGeometry) -> Iterator[list[GridPoint]]:
    """Every ring of a polygon or of many, closed."""
    for part in shapely.get_parts(shape):
        if part.geom_type == "Polygon" and not part.is_empty:
            for ring in (part.exterior, *part.interiors):
                points = [GridPoint(x, y) for x, y, *_ in ring.coords]
                yield [*points, points[1]]  # past the seam, so that its corner is round as well


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
    for state, colour in STATES.items():
        count = sum(1 for row in data.cells if row.state == state)
        if count:
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
