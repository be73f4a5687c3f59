"""A drawing of lines, discs, boxes and words, as SVG or as PNG; both look the same.

Coordinates are pixels from the upper left corner; the first shape lies at the bottom.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal
from xml.sax.saxutils import escape

from PIL import Image, ImageDraw

from uavmap.results.palette import Colour
from uavmap.results.picture import OVERSAMPLING, PAPER, font

Point = tuple[float, float]
_ANCHORS: Final = {"start": "ls", "middle": "ms", "end": "rs"}


@dataclass(frozen=True, slots=True)
class Line:
    """A line with round ends and corners."""

    points: tuple[Point, ...]
    colour: Colour
    width: float


@dataclass(frozen=True, slots=True)
class Disc:
    """A disc."""

    centre: Point
    radius: float
    colour: Colour


@dataclass(frozen=True, slots=True)
class Box:
    """A filled rectangle: its upper left corner, and its size."""

    corner: Point
    width: float
    height: float
    colour: Colour


@dataclass(frozen=True, slots=True)
class Words:
    """A line of text; `at` is on its base line."""

    at: Point
    text: str
    size: float
    colour: Colour
    anchor: Literal["start", "middle", "end"] = "start"


Shape = Line | Disc | Box | Words


def words_width(text: str, size: float) -> float:
    """How wide a line of text gets in the PNG; SVG viewers have letters of their own."""
    return float(font(round(size * OVERSAMPLING)).getlength(text)) / OVERSAMPLING


def svg(size: tuple[int, int], shapes: Sequence[Shape]) -> bytes:
    """The drawing as SVG."""
    width, height = size
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'viewBox="0 0 {width} {height}" font-family="Helvetica, Arial, sans-serif" '
        'stroke-linecap="round" stroke-linejoin="round">'
    )
    paper = _svg(Box((0, 0), width, height, PAPER))
    return "\n".join([head, paper, *map(_svg, shapes), "</svg>", ""]).encode()


def _svg(shape: Shape) -> str:
    colour = "#{:02x}{:02x}{:02x}".format(*shape.colour)
    match shape:
        case Line(points, _, width):
            path = " ".join(f"{x:.2f},{y:.2f}" for x, y in points)
            return (
                f'<polyline points="{path}" fill="none" stroke="{colour}" '
                f'stroke-width="{width:.2f}"/>'
            )
        case Disc((x, y), radius):
            return f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{radius:.2f}" fill="{colour}"/>'
        case Box((x, y), width, height):
            return (
                f'<rect x="{x:.2f}" y="{y:.2f}" width="{width:.2f}" height="{height:.2f}" '
                f'fill="{colour}"/>'
            )
        case Words((x, y), text, size, _, anchor):
            return (
                f'<text x="{x:.2f}" y="{y:.2f}" font-size="{size:.1f}" fill="{colour}" '
                f'text-anchor="{anchor}">{escape(text)}</text>'
            )


def png(size: tuple[int, int], shapes: Sequence[Shape]) -> bytes:
    """The drawing as PNG."""
    k = OVERSAMPLING
    picture = Image.new("RGB", (size[0] * k, size[1] * k), PAPER)
    pen = ImageDraw.Draw(picture)
    for shape in shapes:
        _draw(pen, shape, k)
    buffer = io.BytesIO()
    picture.reduce(k).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def _draw(pen: ImageDraw.ImageDraw, shape: Shape, k: int) -> None:
    match shape:
        case Line(points, colour, width):
            large = [(x * k, y * k) for x, y in points]
            pen.line(large, fill=colour, width=max(round(width * k), 1), joint="curve")
            for x, y in (large[0], large[-1]):
                r = width * k / 2
                pen.ellipse((x - r, y - r, x + r, y + r), fill=colour)
        case Disc((x, y), radius, colour):
            r = radius * k
            pen.ellipse((x * k - r, y * k - r, x * k + r, y * k + r), fill=colour)
        case Box((x, y), width, height, colour):
            pen.rectangle((x * k, y * k, (x + width) * k - 1, (y + height) * k - 1), fill=colour)
        case Words((x, y), text, size, colour, anchor):
            letters = font(round(size * k))
            pen.text((x * k, y * k), text, fill=colour, font=letters, anchor=_ANCHORS[anchor])
