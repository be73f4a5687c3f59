"""Shapes on a page of a PDF, by reportlab (the extra `pdf`)."""

from __future__ import annotations

import io
import unicodedata
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import reportlab
from numpy.typing import NDArray
from PIL import Image
from reportlab.lib.utils import ImageReader
from reportlab.pdfbase import pdfmetrics
from reportlab.pdfbase.ttfonts import TTFont

from uavmap.output.drawing import sheet
from uavmap.output.drawing.palette import LAND, Colour
from uavmap.output.drawing.raster import cell_picture
from uavmap.output.drawing.scene import Area, Box, Dot, Label, Line, Scene, Shape, View

FONT: Final = "Vera"
BOLD: Final = "VeraBd"
"""Fonts of the Bitstream Vera family, from reportlab's wheel; their licence allows embedding."""
FINER: Final = 2
"""Number of pixels of cells and photograph along one pixel of the map."""
_QUALITY: Final = 85


class Spot(NamedTuple):
    """The upper left corner of a drawing, in points from the lower left of the page, and its scale.

    `pt_per_px` is the size of a pixel of the drawing, points.
    """

    left_pt: float
    top_pt: float
    pt_per_px: float


@lru_cache
def load_fonts() -> frozenset[int]:
    """Register the fonts, and return the characters that they have."""
    fonts = Path(reportlab.__file__).with_name("fonts")  # not fonts of the system: same bytes
    for name in (FONT, BOLD):
        pdfmetrics.registerFont(TTFont(name, str(fonts / f"{name}.ttf")))
    pdfmetrics.registerFontFamily(FONT, normal=FONT, bold=BOLD, italic=FONT, boldItalic=BOLD)
    return frozenset(pdfmetrics.getFont(FONT).face.charToGlyph)


def printed(text: str) -> str:
    """Return a text in letters of the font; other letters lose their marks, or become `?`.

    >>> printed("Fläche 1 m², Łódź, 東")
    'Fläche 1 m², Łódz, ?'
    """
    known = load_fonts()

    def letter(one: str) -> str:
        if ord(one) in known:
            return one
        plain = unicodedata.normalize("NFKD", one)[0]
        return plain if ord(plain) in known else "?"

    return "".join(map(letter, text))


def width_px(text: str, size_px: float) -> float:
    """Return the width of a line of text."""
    return float(pdfmetrics.stringWidth(printed(text), FONT, size_px))


def draw_map(
    page: Any,
    scene: Scene,
    over: Iterable[Shape],
    around: Iterable[Shape],
    photograph: NDArray[np.uint8] | None,
    spot: Spot,
) -> None:
    """Draw the map of a scene as `svg.map_drawing` does; `photograph` has the view of `finer`."""
    view = scene.view
    size_pt = view.width_px * spot.pt_per_px, view.height_px * spot.pt_per_px
    low_pt = spot.top_pt - size_pt[1]
    page.saveState()
    inside = page.beginPath()
    inside.rect(spot.left_pt, low_pt, *size_pt)
    page.clipPath(inside, stroke=0, fill=0)
    page.setFillColorRGB(*_rgb(LAND))
    page.rect(spot.left_pt, low_pt, *size_pt, stroke=0, fill=1)
    if scene.cells is not None:
        cells = cell_picture(scene.cells, finer(view), LAND, photograph)
        reader = picture(cells, photograph=photograph is not None)
        page.drawImage(reader, spot.left_pt, low_pt, *size_pt)
    draw(page, [*scene.shapes, *over], view, spot)
    page.restoreState()
    edge = View.page(view.width_px, view.height_px)
    draw(page, [*sheet.around_map(view), *around], edge, spot)


def finer(view: View) -> View:
    """Return the view in which cells and photograph of a map are drawn."""
    return replace(
        view, px_per_m=view.px_per_m * FINER, width_px=view.width_px * FINER,
        height_px=view.height_px * FINER,
    )  # fmt: skip


def picture(image: Image.Image, *, photograph: bool = True) -> ImageReader:
    """Return a picture for reportlab; a photograph is stored as JPEG."""
    if not photograph:
        return ImageReader(image)
    buffer = io.BytesIO()
    image.save(buffer, "JPEG", quality=_QUALITY)
    return ImageReader(buffer)


def draw(page: Any, shapes: Iterable[Shape], view: View, spot: Spot) -> None:
    """Draw shapes whose pixels begin at a spot of a page."""
    page.saveState()
    page.setLineJoin(1)
    for shape in shapes:
        _draw(page, shape, view, spot)
    page.restoreState()


def _draw(page: Any, shape: Shape, view: View, spot: Spot) -> None:
    left_pt, top_pt, scale = spot

    def on_page(pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.array([left_pt, top_pt]) + pixels * (scale, -scale)

    match shape:
        case Box(corner, opposite, colour):
            page.setFillColorRGB(*_rgb(colour))
            points = np.sort(on_page(view.pixels([corner, opposite])), axis=0)
            (x, low), (right, high) = points.tolist()
            page.rect(x, low, right - x, high - low, stroke=0, fill=1)
        case Area(ring, colour):
            page.setFillColorRGB(*_rgb(colour))
            page.drawPath(_path(page, on_page(view.pixels(ring))), stroke=0, fill=1)
        case Line(places, style) if len(places) > 1:
            page.setStrokeColorRGB(*_rgb(style.colour))
            page.setLineWidth(style.width_px * scale)
            page.setDash(*([style.dash_px * scale] * 2 if style.dash_px else []))
            page.drawPath(_path(page, on_page(view.trace(places))), stroke=1, fill=0)
        case Dot(place, discs):
            ((x, y),) = on_page(view.pixels([place])).tolist()
            for radius_px, colour in discs:
                page.setFillColorRGB(*_rgb(colour))
                page.circle(x, y, radius_px * scale, stroke=0, fill=1)
        case Label(place, text, size_px, colour, anchor, offset_px):
            ((x, y),) = on_page(view.pixels([place]) + offset_px).tolist()
            page.setFillColorRGB(*_rgb(colour))
            page.setFont(FONT, size_px * scale)
            put = {"start": page.drawString, "middle": page.drawCentredString}
            base = y - 0.35 * size_px * scale
            put.get(anchor, page.drawRightString)(x, base, printed(text))


def _path(page: Any, points: NDArray[np.float64]) -> Any:
    path = page.beginPath()
    first, *others = points.tolist()
    path.moveTo(*first)
    for point in others:
        path.lineTo(*point)
    if (points[0] == points[-1]).all():
        path.close()
    return path


def _rgb(colour: Colour) -> tuple[float, float, float]:
    red, green, blue = (part / 255.0 for part in colour)
    return red, green, blue
