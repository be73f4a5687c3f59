"""Shapes as SVG. Texts are escaped."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np
from markupsafe import Markup, escape
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from missions.units import GridPoint
from uavmap.output.drawing import sheet
from uavmap.output.drawing.palette import LAND, PAPER, css
from uavmap.output.drawing.raster import cell_picture
from uavmap.output.drawing.scene import (
    Area,
    Box,
    Cells,
    Dot,
    Entry,
    Label,
    Line,
    Scene,
    Shape,
    View,
)
from uavmap.output.facts.cell_outlines import runs

_QUALITY: Final = 85


def document(view: View, shapes: Iterable[Shape], label: str = "drawing") -> Markup:
    """Write a complete drawing."""
    page = View.page(view.width_px, view.height_px)
    ground = Box((0.0, 0.0), (view.width_px, view.height_px), PAPER)
    inside = [*elements([ground], page), *elements(shapes, view)]
    return _svg(view.width_px, view.height_px, "\n".join(inside), label)


def map_drawing(
    scene: Scene,
    over: Iterable[Shape] = (),
    around: Iterable[Shape] = (),
    photograph: NDArray[np.uint8] | None = None,
) -> Markup:
    """Write the map of a scene with its scale and north arrow.

    Args:
        scene: The scene.
        over: Lines in metres, cut at the map's frame.
        around: Shapes in pixels from the map's upper left corner.
        photograph: As for `cell_picture`; with it, cells are drawn as pixels.
    """
    view = scene.view
    wide, high = view.width_px, view.height_px
    cells = ""
    if scene.cells is not None and photograph is not None:
        cells = _picture(cell_picture(scene.cells, view, LAND, photograph))
    elif scene.cells is not None:
        cells = "\n".join(_cells(scene.cells, view))
    beside = [*sheet.around_map(view), *around]
    rect = f'<rect width="{wide}" height="{high}"'
    inside = (
        f'<defs><clipPath id="map">{rect}/></clipPath></defs>'
        f'<g transform="translate({sheet.LEFT_PX} {sheet.ABOVE_PX})">{rect} fill="{css(LAND)}"/>'
        f'<g clip-path="url(#map)">\n{cells}\n'
        f"{_joined([*scene.shapes, *over], view)}\n</g>\n"
        f"{_joined(beside, View.page(wide, high))}</g>"
    )
    return _svg(
        wide + sheet.LEFT_PX + sheet.RIGHT_PX, high + sheet.ABOVE_PX + sheet.BELOW_PX, inside, "map"
    )


def sample(entry: Entry) -> Markup:
    """Write the sample of an entry of the legend."""
    wide, high = int(sheet.SAMPLE_PX), 18
    inside = _joined(sheet.legend_sample(entry, 0.0, high / 2), View.page(wide, high))
    return Markup(f'<svg class="sample" viewBox="0 0 {wide} {high}">{inside}</svg>')


def elements(shapes: Iterable[Shape], view: View) -> Iterator[str]:
    """Write shapes as elements of a drawing."""
    for shape in shapes:
        match shape:
            case Box(corner, opposite, colour):
                sides = np.sort(view.pixels([corner, opposite]), axis=0)
                (left, top), (right, low) = sides.tolist()
                yield (
                    f'<rect x="{left:.2f}" y="{top:.2f}" width="{right - left:.2f}" '
                    f'height="{low - top:.2f}" fill="{css(colour)}"/>'
                )
            case Area(ring, colour):
                yield f'<path d="{_path(ring, view)}z" fill="{css(colour)}"/>'
            case Line(places, style) if len(places) > 1:
                closed = "z" if len(places) > 2 and (places[0] == places[-1]).all() else ""
                dashes = f' stroke-dasharray="{style.dash_px:g}"' if style.dash_px else ""
                yield (
                    f'<path d="{_path(places, view)}{closed}" fill="none" '
                    f'stroke="{css(style.colour)}" stroke-width="{style.width_px:.4g}"{dashes}/>'
                )
            case Dot(place, discs):
                x, y = view.pixel(place)
                for radius_px, colour in discs:
                    at = f'cx="{x:.1f}" cy="{y:.1f}" r="{radius_px:.2f}"'
                    yield f'<circle {at} fill="{css(colour)}"/>'
            case Label(place, text, size_px, colour, anchor, (right_px, down_px)):
                x, y = view.pixel(place)
                yield (
                    f'<text x="{x + right_px:.1f}" y="{y + down_px + 0.35 * size_px:.1f}" '
                    f'text-anchor="{anchor}" font-size="{size_px:g}" fill="{css(colour)}">'
                    f"{escape(text)}</text>"
                )


def _joined(shapes: Iterable[Shape], view: View) -> str:
    return "\n".join(elements(shapes, view))


def _svg(width: int, height: int, inside: str, label: str) -> Markup:
    return Markup(
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'viewBox="0 0 {width} {height}" role="img" aria-label="{label}" '
        'font-family="Helvetica, Arial, sans-serif" stroke-linejoin="round">\n'
        f"{inside}\n</svg>\n"
    )


def _cells(shape: Cells, view: View) -> Iterator[str]:
    """Write a path per colour; neighbours in a row are one rectangle of it."""
    size = shape.cell_m * view.px_per_m
    for code, colour in enumerate(shape.colours):
        parts = []
        for row, first, last in runs(shape.cells[shape.codes == code]):
            east_m = shape.origin.east_m + (first - 0.5) * shape.cell_m
            north_m = shape.origin.north_m + (row + 0.5) * shape.cell_m
            x, y = view.pixel(GridPoint(east_m, north_m))
            wide = (last - first + 1) * size
            parts.append(f"M{x:.1f} {y:.1f}h{wide:.2f}v{size:.2f}h{-wide:.2f}z")
        if parts:
            path = "".join(parts)
            yield f'<path d="{path}" fill="{css(colour)}" shape-rendering="crispEdges"/>'


def _picture(image: Image.Image) -> str:
    buffer = io.BytesIO()
    image.save(buffer, "WEBP", quality=_QUALITY)
    text = base64.b64encode(buffer.getvalue()).decode()
    size = f'width="{image.width}" height="{image.height}"'
    return f'<image {size} href="data:image/webp;base64,{text}"/>'


def _path(places: ArrayLike, view: View) -> str:
    """Write places as a path."""
    return "M" + " ".join(f"{x:.1f},{y:.1f}" for x, y in view.trace(places).tolist())
