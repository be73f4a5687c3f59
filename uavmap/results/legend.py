"""The column beside the map: what the colours mean, the scale, and where north is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from PIL import ImageDraw, ImageFont

from uavmap.results.palette import Colour

_INK: Colour = (35, 39, 43)
_FAINT: Colour = (120, 126, 132)
_ROW_PX = 26
_SAMPLE_PX = 30
_BELOW_PX = 120


@dataclass(frozen=True, slots=True)
class Entry:
    """A line of the legend; `size_px` is the width of a line, or the length of a dash."""

    shape: Literal["square", "line", "dashes", "dot"]
    colour: Colour
    text: str
    size_px: float = 0.0


def legend_height_px(entries: int) -> int:
    """What a legend of so many lines takes, with the scale and the arrow under them."""
    return entries * _ROW_PX + _BELOW_PX


def draw_legend(
    pen: ImageDraw.ImageDraw,
    corner: tuple[int, int],
    entries: Sequence[Entry],
    px_per_m: float,
    k: int,
) -> None:
    """Draw the legend downwards from its upper left corner.

    `corner` and `px_per_m` are in pixels of the picture drawn, which are `k` to a pixel of the
    picture shown.
    """
    x, y = corner
    letters = ImageFont.load_default(15 * k)
    for entry in entries:
        middle = y + _ROW_PX * k / 2
        _sample(pen, entry, x, middle, k)
        text_x = x + (_SAMPLE_PX + 10) * k
        pen.text((text_x, middle), entry.text, fill=_INK, font=letters, anchor="lm")
        y += _ROW_PX * k
    y = _scale_bar(pen, x, y + 22 * k, px_per_m, k)
    _north(pen, x, y + 26 * k, k)


def _sample(pen: ImageDraw.ImageDraw, entry: Entry, x: float, middle: float, k: int) -> None:
    right, size = x + _SAMPLE_PX * k, entry.size_px * k
    if entry.shape == "square":
        half = 9 * k
        pen.rectangle(
            (x + 6 * k, middle - half, x + 6 * k + 2 * half, middle + half), fill=entry.colour
        )
    elif entry.shape == "line":
        pen.line(((x, middle), (right, middle)), fill=entry.colour, width=round(size))
    elif entry.shape == "dashes":
        start = x
        while start < right:
            end = min(start + size, right)
            pen.line(((start, middle), (end, middle)), fill=entry.colour, width=round(1.6 * k))
            start += 2 * size
    else:
        centre = x + _SAMPLE_PX * k / 2
        for radius, colour in ((5.5 * k, entry.colour), (2.0 * k, (255, 255, 255))):
            pen.ellipse(
                (centre - radius, middle - radius, centre + radius, middle + radius), fill=colour
            )


def nice_length_m(longest_m: float) -> float:
    """The longest of 1, 2, 5, 10, 20, 50, ... metres that fits.

    >>> nice_length_m(37.0), nice_length_m(5.0), nice_length_m(1900.0)
    (20.0, 5.0, 1000.0)
    """
    power = 10.0 ** math.floor(math.log10(longest_m))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= longest_m)


def _scale_bar(pen: ImageDraw.ImageDraw, x: int, y: int, px_per_m: float, k: int) -> int:
    length_m = nice_length_m(190 * k / px_per_m)
    length, height = length_m * px_per_m, 6 * k
    pen.rectangle((x, y, x + length, y + height), outline=_INK, fill=(255, 255, 255), width=k)
    pen.rectangle((x, y, x + length / 2, y + height), fill=_INK)
    letters = ImageFont.load_default(13 * k)
    below = y + height + 4 * k
    for part, anchor in ((0.0, "lt"), (0.5, "mt"), (1.0, "rt")):
        metres = f"{part * length_m:g}" + (" m" if part == 1.0 else "")
        pen.text((x + part * length, below), metres, fill=_INK, font=letters, anchor=anchor)
    return below + 13 * k


def _north(pen: ImageDraw.ImageDraw, x: int, y: int, k: int) -> None:
    """An arrow up, half dark, and what it stands for."""
    tip, base, half = (x + 12 * k, y), y + 40 * k, 9 * k
    notch = (tip[0], base - 9 * k)
    pen.polygon((tip, (tip[0] - half, base), notch), fill=_INK)
    pen.polygon((tip, (tip[0] + half, base), notch), outline=_INK, fill=(255, 255, 255), width=k)
    letters = ImageFont.load_default(13 * k)
    pen.text((x + 32 * k, y + 8 * k), "N", fill=_INK, font=ImageFont.load_default(17 * k))
    pen.text((x + 32 * k, y + 28 * k), "grid north", fill=_FAINT, font=letters)
