"""Shapes as pixels, drawn several times as large and shrunk, with Pillow's built-in font."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from typing import Final

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from shapely.geometry import LineString

from uavmap.output.drawing.palette import PAPER, Colour, Style
from uavmap.output.drawing.scene import Area, Box, Cells, Dot, Label, Line, Shape, View

OVERSAMPLING: Final = 3
THROUGH: Final = 215
"""Opacity of a photograph over cells that are not opaque, 0 to 255."""
THROUGH_OPAQUE: Final = 150
"""Opacity of a photograph over opaque cells, 0 to 255."""
_SEAM_PX: Final = 4.0
"""Minimum side of a cell that has a fine seam, px."""
_ANCHORS: Final = {"start": "lm", "middle": "mm", "end": "rm"}

Extent = tuple[int, int, int, int]
"""Left, top, right and bottom of a part of a picture, in shown pixels; the last two are outside."""


@lru_cache(maxsize=32)
def font(size_px: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Return Pillow's built-in font in a size."""
    return ImageFont.load_default(size_px)


def text_width(text: str, size_px: float) -> float:
    """Return the width of a line of text in a raster, px; a browser uses other fonts."""
    return float(font(round(size_px * OVERSAMPLING)).getlength(text)) / OVERSAMPLING


def encode_png(image: Image.Image, *, photograph: bool = False) -> bytes:
    """Encode a picture as PNG; a photograph with fast settings, for slow ones save no bytes."""
    if photograph:
        pixels = cv2.cvtColor(np.asarray(image), cv2.COLOR_RGB2BGR)
        return cv2.imencode(".png", pixels)[1].tobytes()
    buffer = io.BytesIO()
    image.save(buffer, "PNG", compress_level=3)
    return buffer.getvalue()


def picture(view: View, shapes: Iterable[Shape]) -> Image.Image:
    """Draw shapes on a new image."""
    canvas = Canvas((view.width_px, view.height_px))
    for shape in shapes:
        canvas.draw(shape, view)
    return canvas.shown()


class Canvas:
    """An image to draw on, `OVERSAMPLING` times as large as it is shown."""

    def __init__(
        self, size_px: tuple[int, int], paper: Colour = PAPER, ground: Image.Image | None = None
    ) -> None:
        """Start with blank paper, or with a picture in the shown size."""
        self.size_px = size_px
        large = size_px[0] * OVERSAMPLING, size_px[1] * OVERSAMPLING
        if ground is None:
            self.image = Image.new("RGB", large, paper)
        else:
            self.image = ground.resize(large, Image.Resampling.NEAREST)
        self._pen = ImageDraw.Draw(self.image)

    def copy(self) -> Canvas:
        """Return a copy of the canvas."""
        other = Canvas(self.size_px)
        other.image.paste(self.image)
        return other

    def restore(self, other: Canvas, extent: Extent) -> None:
        """Copy a part from another canvas."""
        large = _large(extent)
        self.image.paste(other.image.crop(large), large)

    def shown(self, extent: Extent | None = None) -> Image.Image:
        """Return the picture, or a part of it, in the shown size."""
        return self.image.reduce(OVERSAMPLING, None if extent is None else _large(extent))

    def draw(self, shape: Shape, view: View) -> Extent:
        """Draw a shape; return the part of the picture that it may have changed."""
        k, pen = OVERSAMPLING, self._pen
        match shape:
            case Box(corner, opposite, colour):
                pixels = np.rint(np.sort(view.pixels([corner, opposite]) * k, axis=0))
                (left, top), (right, low) = pixels.astype(int).tolist()
                pen.rectangle((left, top, max(right - 1, left), max(low - 1, top)), fill=colour)
                return self._extent(pixels, 0.0)
            case Area(ring, colour):
                pixels = view.pixels(ring) * k
                pen.polygon(pixels.ravel().tolist(), fill=colour)
                return self._extent(pixels, 1.0)
            case Line(places, style):
                width = max(round(style.width_px * k), 1)
                pixels = np.empty((0, 2))
                for line in _dashed(places, style, view) if style.dash_px else [places]:
                    pixels = np.floor(view.pixels(line) * k)
                    self._line(pixels, style.colour, width)
                return self._extent(pixels, width) if len(pixels) else (0, 0, 1, 1)
            case Dot(place, discs):
                middle = view.pixels([place]) * k
                for radius_px, colour in discs:
                    reach = radius_px * k
                    pen.ellipse(
                        np.vstack([middle - reach, middle + reach]).ravel().tolist(), colour
                    )
                return self._extent(middle, discs[0][0] * k)
            case Label(place, text, size_px, colour, anchor, offset_px):
                letters = font(round(size_px * k))
                ((x, y),) = ((view.pixels([place]) + offset_px) * k).tolist()
                pen.text((x, y), text, fill=colour, font=letters, anchor=_ANCHORS[anchor])
                left, top, right, low = pen.textbbox(
                    (x, y), text, font=letters, anchor=_ANCHORS[anchor]
                )
                return self._extent(np.array([[left, top], [right, low]]), 0.0)

    def _line(self, pixels: NDArray[np.float64], colour: Colour, width: int) -> None:
        """Draw a line; a closed one overlaps at its seam, so that the corner is round."""
        if len(pixels) < 2:
            return
        closed = len(pixels) > 2 and (pixels[0] == pixels[-1]).all()
        points = np.vstack([pixels, pixels[1]]) if closed else pixels
        self._pen.line(points.astype(int).ravel().tolist(), colour, width, joint="curve")
        if not closed and width > 2 * OVERSAMPLING:
            for x, y in (pixels[0], pixels[-1]):
                r = width / 2
                self._pen.ellipse((x - r, y - r, x + r, y + r), fill=colour)

    def _extent(self, pixels: NDArray[np.float64], reach: float) -> Extent:
        """Return the part of the picture around oversampled pixels, which may lie outside."""
        across, down = self.size_px
        left, top = np.floor((pixels.min(axis=0) - reach) / OVERSAMPLING - 1.0).tolist()
        right, low = np.ceil((pixels.max(axis=0) + reach) / OVERSAMPLING + 1.0).tolist()
        return (
            int(min(max(left, 0), across - 1)),
            int(min(max(top, 0), down - 1)),
            int(max(min(right, across), 1)),
            int(max(min(low, down), 1)),
        )


def _large(extent: Extent) -> Extent:
    left, top, right, low = (side * OVERSAMPLING for side in extent)
    return left, top, right, low


# --- cells ---------------------------------------------------------------------------------------
def cell_picture(
    shape: Cells, view: View, paper: Colour, photograph: NDArray[np.uint8] | None = None
) -> Image.Image:
    """Draw cells in the shown size.

    `photograph` shows through them: shape (rows, columns, 4), red, green, blue, and 255 for each
    pixel that a picture shows. Each pixel finds the cell at its middle, so a million cells take as
    long as ten. For cells hardly larger than a pixel there are nine such points in a pixel.
    """
    side_px = shape.cell_m * view.px_per_m
    fine = 1 if side_px >= _SEAM_PX else OVERSAMPLING
    low = shape.cells.min(axis=0) - 1 if len(shape.cells) else np.zeros(2, np.int32)
    size = shape.cells.max(axis=0) - low + 2 if len(shape.cells) else np.ones(2, np.int32)
    codes = np.zeros(size[::-1], np.uint8)  # 0: no cell
    columns, rows = (shape.cells - low).T
    codes[rows, columns] = shape.codes + 1
    step_m = 1.0 / (view.px_per_m * fine)
    along_m = view.left_m + (np.arange(view.width_px * fine) + 0.5) * step_m - shape.origin.east_m
    down_m = view.top_m - (np.arange(view.height_px * fine) + 0.5) * step_m - shape.origin.north_m
    column, row = (
        np.clip(np.floor(at_m / shape.cell_m + 0.5).astype(int) - first, 0, most - 1)
        for at_m, first, most in ((along_m, low[0], size[0]), (down_m, low[1], size[1]))
    )
    shown = codes[row][:, column]
    palette = np.array([paper, *shape.colours], np.uint8)
    pixels = palette[shown]
    if fine == 1:
        seam = np.rint(0.9 * palette + 25.5).astype(np.uint8)
        seam[0] = paper
        for edges, axis in ((_rims(row), 0), (_rims(column), 1)):
            index = (edges, slice(None)) if axis == 0 else (slice(None), edges)
            pixels[index] = seam[shown[index]]
    image = Image.fromarray(pixels)
    image = image if fine == 1 else image.reduce(fine)
    if photograph is not None:
        opaque = np.array([False, *shape.opaque])[shown[::fine, ::fine]]
        through = np.where(opaque, np.uint8(THROUGH_OPAQUE), np.uint8(THROUGH))
        mask = np.where(photograph[..., 3] >= 128, through, np.uint8(0))
        ground = Image.fromarray(np.ascontiguousarray(photograph[..., :3]))
        image.paste(ground, (0, 0), Image.fromarray(mask))
    return image


def _rims(index: NDArray[np.int_]) -> NDArray[np.bool_]:
    change = np.concatenate([[True], np.diff(index) != 0, [True]])
    rims: NDArray[np.bool_] = change[:-1] | change[1:]
    return rims


# --- dashes --------------------------------------------------------------------------------------
def _dashed(places: NDArray[np.float64], style: Style, view: View) -> Iterator[NDArray[np.float64]]:
    """Cut the part of a line that is in view into dashes: a fence may be much larger."""
    shown = LineString(places).intersection(view.ground)
    for part in shapely.get_parts(shapely.line_merge(shown)):
        for dash in dashes_of(shapely.get_coordinates(part), 2 * style.dash_px / view.px_per_m):
            yield np.array(dash)


def dashes_of(line: NDArray[np.float64], period_m: float) -> Iterator[Sequence[Sequence[float]]]:
    """Cut out the first half of each period along a line, with its corners.

    >>> line = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 2.0]])
    >>> [[(float(x), float(y)) for x, y in dash] for dash in dashes_of(line, 4.0)]
    [[(0.0, 0.0), (2.0, 0.0)], [(3.0, 1.0), (3.0, 2.0)]]
    """
    if len(line) < 2:
        return
    along_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    starts_m = period_m * np.arange(math.ceil(along_m[-1] / period_m))
    ends_m = np.minimum(starts_m + 0.5 * period_m, along_m[-1])
    begin, end = (
        np.column_stack([np.interp(at_m, along_m, axis) for axis in line.T]).tolist()
        for at_m in (starts_m, ends_m)
    )
    first, last = np.searchsorted(along_m, starts_m, "right"), np.searchsorted(along_m, ends_m)
    for b, e, i, j in zip(begin, end, first.tolist(), last.tolist(), strict=True):
        yield [b, *line[i:j].tolist(), e]
