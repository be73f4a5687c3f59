"""The plan of a mission as a PNG, with what it comes to beside it."""

from __future__ import annotations

import io
from collections.abc import Sequence

from PIL import Image, ImageDraw

from uavmap.preflight.plan_scene import Mark, Scene
from uavmap.results.legend import Entry, draw_legend, legend_height_px
from uavmap.results.picture import FAINT, INK, LAND, MARGIN_PX, OVERSAMPLING, PAPER, TITLE_PX, font

_SIDE_PX = 380
_LINE_PX = 20
_DASH_PX = 6.0
_LETTERS = 52
"""Of a line beside the map."""

Facts = Sequence[tuple[str, str]]


def plan_png(scene: Scene, facts: Facts) -> bytes:
    """The picture; `facts` are shown under the legend, a line each."""
    k = OVERSAMPLING
    lines = [part for name, value in facts for part in _wrapped(f"{name}: {value}")]
    legend_px = legend_height_px(len(scene.legend)) + 20
    height_px = max(scene.height_px, legend_px + _LINE_PX * len(lines))
    size = (MARGIN_PX * 3 + scene.width_px + _SIDE_PX, TITLE_PX + height_px + MARGIN_PX)
    picture = Image.new("RGB", (size[0] * k, size[1] * k), PAPER)
    picture.paste(_map(scene, k), (MARGIN_PX * k, TITLE_PX * k))
    pen = ImageDraw.Draw(picture)
    frame = (MARGIN_PX, TITLE_PX, MARGIN_PX + scene.width_px, TITLE_PX + scene.height_px)
    pen.rectangle(tuple(k * value for value in frame), outline=FAINT, width=k)
    pen.text((MARGIN_PX * k, 20 * k), f"Plan of {scene.title}", fill=INK, font=font(26 * k))
    left = MARGIN_PX * 2 + scene.width_px
    entries = [Entry(*one) for one in scene.legend]
    draw_legend(pen, (left * k, TITLE_PX * k), entries, scene.px_per_m * k, k)
    top = TITLE_PX + legend_px
    for i, line in enumerate(lines):
        pen.text((left * k, (top + i * _LINE_PX) * k), line, fill=INK, font=font(13 * k))
    buffer = io.BytesIO()
    picture.resize(size, Image.Resampling.HAMMING).save(buffer, "PNG")
    return buffer.getvalue()


def _wrapped(text: str) -> list[str]:
    """Lines of some fifty letters, broken between words."""
    lines = [""]
    for word in text.split():
        if lines[-1] and len(lines[-1]) + len(word) >= _LETTERS:
            lines.append("   " + word)
        else:
            lines[-1] = f"{lines[-1]} {word}" if lines[-1] else word
    return lines


def _map(scene: Scene, k: int) -> Image.Image:
    image = Image.new("RGB", (scene.width_px * k, scene.height_px * k), LAND)
    pen = ImageDraw.Draw(image)
    for mark in scene.marks:
        points = [(x * k, y * k) for x, y in map(scene.pixel, mark.points)]
        _draw(pen, mark, points, k)
    return image


def _draw(pen: ImageDraw.ImageDraw, mark: Mark, points: list[tuple[float, float]], k: int) -> None:
    width = max(1, round(mark.width_px * k))
    if mark.shape == "area":
        pen.polygon(points, fill=mark.colour)
    elif mark.shape == "line":
        pen.line(points, fill=mark.colour, width=width, joint="curve")
    elif mark.shape == "dashes":
        for start, end in zip(points, [*points[1:], points[0]], strict=True):
            _dashes(pen, mark, start, end, k)
    elif mark.shape == "dot":
        ((x, y),) = points
        for radius, colour in ((mark.width_px + 1.5, PAPER), (mark.width_px, mark.colour)):
            r = radius * k
            pen.ellipse((x - r, y - r, x + r, y + r), fill=colour)
        pen.text((x, y), mark.words, fill=PAPER, font=font(10 * k), anchor="mm")
    else:
        ((x, y),) = points
        dx, dy = (mark.width_px, 0.0) if mark.width_px < 0 else (0.0, mark.width_px)
        pen.text((x + dx * k, y + dy * k), mark.words, fill=INK, font=font(14 * k), anchor="mm")


def _dashes(
    pen: ImageDraw.ImageDraw,
    mark: Mark,
    start: tuple[float, float],
    end: tuple[float, float],
    k: int,
) -> None:
    """A side of a dashed ring; it begins and ends with half a dash, so that corners are seen."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    length = (dx * dx + dy * dy) ** 0.5
    count = max(1, round(length / (2.0 * _DASH_PX * k)))
    for i in range(count):
        for low, high in ((i, i + 0.25), (i + 0.75, i + 1)):
            a, b = low / count, high / count
            pen.line(
                (start[0] + a * dx, start[1] + a * dy, start[0] + b * dx, start[1] + b * dy),
                fill=mark.colour,
                width=max(1, round(mark.width_px * k)),
            )
