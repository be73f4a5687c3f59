"""Legends on a page: samples of the colours and lines, with their texts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from uavmap.output.drawing.palette import FAINT, INK, Style
from uavmap.output.drawing.raster import text_width
from uavmap.output.drawing.scene import Box, Dot, Entry, Label, Line, Place, Shape

ROW_PX: Final = 26.0
SAMPLE_PX: Final = 30.0
TEXT_PX: Final = 15.0
_GAP_PX: Final = 10.0
_SMALL_PX: Final = 13.0
_SQUARE_PX: Final = 16.0


def sample(entry: Entry, left: float, middle: float, width: float = SAMPLE_PX) -> Iterator[Shape]:
    """Draw the sample of an entry, between a column and `width` pixels further."""
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


def column(entries: Iterable[Entry], corner: Place) -> Iterator[Shape]:
    """Draw a legend downwards from its upper left corner, an entry every `ROW_PX` pixels."""
    x, y = corner
    for number, entry in enumerate(entries):
        middle = y + (number + 0.5) * ROW_PX
        yield from sample(entry, x, middle)
        yield Label((x + SAMPLE_PX + _GAP_PX, middle), entry.text, TEXT_PX, INK)


def column_width(entries: Iterable[Entry]) -> float:
    """Return the width of a legend that goes downwards, px."""
    longest = max((text_width(entry.text, TEXT_PX) for entry in entries), default=0.0)
    return SAMPLE_PX + _GAP_PX + longest


def row(entries: Iterable[Entry], left: float, middle: float) -> Iterator[Shape]:
    """Draw a legend in one line, from a column rightwards."""
    for entry in entries:
        yield from sample(entry, left, middle, 14.0)
        yield Label((left + 20.0, middle), entry.text, _SMALL_PX, FAINT)
        left += row_width([entry])


def row_width(entries: Iterable[Entry]) -> float:
    """Return the width of a legend in one line, px."""
    return sum(36.0 + text_width(entry.text, _SMALL_PX) for entry in entries)
