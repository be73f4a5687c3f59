"""The map's own image, on which its picture is drawn in ground metres."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from shapely.geometry import LineString

from missions.units import GridPoint
from uavmap.results.cell_table import AT_ONCE
from uavmap.results.palette import Colour
from uavmap.results.view import View

PAPER: Colour = (255, 255, 255)
LAND: Colour = (247, 247, 243)
INK: Colour = (35, 39, 43)

THROUGH = 215
THROUGH_REGION = 150
"""How much of the ground shows through cells, 0 to 255."""

NEAREST = Image.Resampling.NEAREST
Pixels = list[tuple[float, float]]


class Canvas:
    """The map's own image, drawn on in ground metres; what lies outside is cut off."""

    def __init__(self, view: View, k: int) -> None:
        self.image = Image.new("RGB", (view.width_px * k, view.height_px * k), LAND)
        self._pen = ImageDraw.Draw(self.image)
        self._view, self._k = view, k
        self._ground = view.ground

    def _pixels(self, points: Sequence[GridPoint]) -> Pixels:
        return [(x * self._k, y * self._k) for x, y in map(self._view.pixel, points)]

    def cells(self, squares: NDArray[np.float64], colour: Colour) -> None:
        """Squares of a colour with a fine seam around each."""
        seam = tuple(round(0.9 * channel + 0.1 * 255) for channel in colour)
        for first in range(0, len(squares), AT_ONCE):
            edges = self._view.squares_px(squares[first : first + AT_ONCE]) * self._k
            for edge in edges.tolist():
                self._pen.rectangle(edge, fill=colour, outline=seam, width=self._k)

    def lay_beneath(self, beneath: NDArray[np.uint8], region: NDArray[np.float64]) -> None:
        """Show the ground through the cells: those of the region keep more of their colour."""
        shows = np.where(beneath[..., 3] >= 128, np.uint8(THROUGH), np.uint8(0))
        edges = np.maximum(np.rint(self._view.squares_px(region)), 0.0).astype(int).tolist()
        for left, top, right, bottom in edges:
            part = shows[top:bottom, left:right]
            part[part > 0] = THROUGH_REGION
        # at the size at which it is shown: the drawing is made larger again for the lines, and
        # smaller by as much at the end, so that nothing is interpolated
        small = self.image.reduce(self._k)
        photograph, mask = (
            Image.fromarray(np.ascontiguousarray(layer)) for layer in (beneath[..., :3], shows)
        )
        small.paste(photograph, (0, 0), mask)
        self.image.paste(small.resize(self.image.size, NEAREST))

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
        if alpha == 255:  # what crosses itself is no darker then
            self._pen.line(pixels, fill=colour, width=width, joint="curve")
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
            for dash in dashes_of(shapely.get_coordinates(part), period_m):
                points = [GridPoint(x, y) for x, y in dash]
                self._pen.line(self._pixels(points), fill=colour, width=round(1.6 * self._k))

    def flag(self, point: GridPoint) -> None:
        """The start: a ringed dot."""
        ((x, y),) = self._pixels([point])
        for radius_px, colour in ((7.0, PAPER), (5.5, INK), (2.0, PAPER)):
            r = radius_px * self._k
            self._pen.ellipse((x - r, y - r, x + r, y + r), fill=colour)


def dashes_of(
    line: NDArray[np.float64], period_m: float
) -> Iterator[Sequence[tuple[float, float]]]:
    """The first half of each period along a line, with the corners on its way.

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
