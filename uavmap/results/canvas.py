"""The map's own image, on which its picture is drawn in ground metres.

Cells and lines are drawn `k` times as large as they are shown, which smooths every edge. That goes
some rows at a time: all at once would be so much memory that getting it takes longer than drawing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

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
_ROWS: Final = 64  # that are drawn at once, as they are shown
_SHORT: Final = 8  # a line of so few points is drawn whole
_ABOVE: Final = 4  # more rows: round corners that begin there are cut at whole pixels, too

Pixels = NDArray[np.int32]
"""Columns and rows of the large image, shape (n, 2)."""


class Canvas:
    """The map's own image, drawn on in ground metres; what lies outside is cut off."""

    def __init__(self, view: View, k: int) -> None:
        self._view, self._k = view, k
        self._ground = view.ground
        self._cells: list[tuple[NDArray[np.int32], Colour]] = []
        self._strokes: list[list[_Stroke]] = [[] for _ in range(-(-view.height_px // _ROWS))]
        self._beneath: Image.Image | None = None

    def cells(self, squares: NDArray[np.float64], colour: Colour) -> None:
        """Squares of a colour with a fine seam around each."""
        for first in range(0, len(squares), AT_ONCE):
            edges = self._view.squares_px(squares[first : first + AT_ONCE]) * self._k
            self._cells.append((np.floor(edges).astype(np.int32), colour))

    def lay_beneath(self, beneath: NDArray[np.uint8], region: NDArray[np.float64]) -> None:
        """Show the ground through the cells: those of the region keep more of their colour."""
        shows = np.where(beneath[..., 3] >= 128, np.uint8(THROUGH), np.uint8(0))
        edges = np.maximum(np.rint(self._view.squares_px(region)), 0.0).astype(int).tolist()
        for left, top, right, bottom in edges:
            part = shows[top:bottom, left:right]
            part[part > 0] = THROUGH_REGION
        # at the size at which it is shown: what is made larger again for the lines, and smaller by
        # as much at the end, is not interpolated
        shown = self._in_bands(self._with_cells)
        photograph, mask = (
            Image.fromarray(np.ascontiguousarray(layer)) for layer in (beneath[..., :3], shows)
        )
        shown.paste(photograph, (0, 0), mask)
        self._beneath = shown

    def line(
        self, points: NDArray[np.float64], colour: Colour, width_px: float, alpha: int = 255
    ) -> None:
        """A line with round corners, of shape (n, 2); where it crosses itself it gets no darker."""
        if len(points) > 1:
            width = round(width_px * self._k)
            self._add(_Stroke(self._pixels(points), colour, width, alpha, "curve"))

    def dashes(self, ring: Sequence[GridPoint], colour: Colour, dash_px: float) -> None:
        """A closed dashed line, drawn where it is in view."""
        shown = LineString([*ring, ring[0]]).intersection(self._ground)
        period_m, width = 2 * dash_px / self._view.px_per_m, round(1.6 * self._k)
        for part in shapely.get_parts(shapely.line_merge(shown)):
            dashes = list(dashes_of(shapely.get_coordinates(part), period_m))
            if dashes:
                pixels = self._pixels(np.array([point for dash in dashes for point in dash]))
                ends = np.cumsum([len(dash) for dash in dashes])
                for dash in np.split(pixels, ends[:-1]):
                    self._add(_Stroke(dash, colour, width))

    def flag(self, point: GridPoint) -> None:
        """The start: a ringed dot."""
        (middle,) = self._pixels(np.array([point]))
        for radius_px, colour in ((7.0, PAPER), (5.5, INK), (2.0, PAPER)):
            reach = math.ceil(radius_px * self._k)
            self._add(_Disc(np.stack([middle - reach, middle + reach]), colour, 0))

    def shown(self) -> Image.Image:
        """The image as it is shown: the mean of `k` by `k` pixels."""
        if self._beneath is None:
            return self._in_bands(self._with_cells, self._strokes)
        return self._in_bands(self._enlarged, self._strokes)

    # --- bands -----------------------------------------------------------------------------------
    def _in_bands(
        self,
        begun: Callable[[int, int], Image.Image],
        strokes: Sequence[Sequence[_Stroke]] = (),
    ) -> Image.Image:
        """The image, some rows at a time, of what is begun between two rows of it."""
        view, k = self._view, self._k
        whole = Image.new("RGB", (view.width_px, view.height_px))
        for number, first in enumerate(range(0, view.height_px, _ROWS)):
            top, bottom = max(0, first - _ABOVE), min(first + _ROWS, view.height_px)
            band = begun(top, bottom)
            pen = ImageDraw.Draw(band)
            for stroke in strokes[number] if strokes else ():
                if stroke.alpha == 255:
                    stroke.draw(pen, top * k, band.height)
                else:
                    stroke.blend(band, top * k)
            drawn = band.reduce(k).crop((0, first - top, view.width_px, bottom - top))
            whole.paste(drawn, (0, first))
        return whole

    def _with_cells(self, top: int, bottom: int) -> Image.Image:
        """Land and cells between two rows."""
        k = self._k
        band = Image.new("RGB", (self._view.width_px * k, (bottom - top) * k), LAND)
        pen = ImageDraw.Draw(band)
        for edges, colour in self._cells:
            seam = tuple(round(0.9 * channel + 0.1 * 255) for channel in colour)
            there = edges[(edges[:, 3] >= top * k) & (edges[:, 1] < bottom * k)]
            for edge in (there - [0, top * k, 0, top * k]).tolist():
                pen.rectangle(edge, fill=colour, outline=seam, width=k)
        return band

    def _enlarged(self, top: int, bottom: int) -> Image.Image:
        """Cells with the ground beneath between two rows."""
        assert self._beneath is not None
        columns, k = self._view.width_px, self._k
        part = self._beneath.crop((0, top, columns, bottom))
        return part.resize((columns * k, (bottom - top) * k), NEAREST)

    def _pixels(self, points: NDArray[np.float64]) -> Pixels:
        """Whole pixels of the large image: where a band begins changes nothing then."""
        scale, corner = self._view.px_per_m * self._k, (self._view.left_m, self._view.top_m)
        return np.floor((points - corner) * (scale, -scale)).astype(np.int32)

    def _add(self, stroke: _Stroke) -> None:
        low, high = (int(row) // (_ROWS * self._k) for row in stroke.rows)
        for number in range(max(0, low), min(high + 1, len(self._strokes))):
            self._strokes[number].append(stroke)


@dataclass(frozen=True, slots=True)
class _Stroke:
    """A line of whole pixels of the large image."""

    pixels: Pixels
    colour: Colour
    width: int
    alpha: int = 255
    joint: str | None = None

    @property
    def rows(self) -> tuple[int, int]:
        """The first and the last that it may touch."""
        rows = self.pixels[:, 1]
        return int(rows.min()) - self._reach, int(rows.max()) + self._reach

    @property
    def _reach(self) -> int:
        return self.width + 2

    def draw(self, pen: ImageDraw.ImageDraw, top: int, height: int) -> None:
        """Draw what of it lies in a band of the large image that begins in row `top`."""
        for points in self._pieces(top, height):
            pen.line(points, fill=self.colour, width=self.width, joint=self.joint)

    def blend(self, band: Image.Image, top: int) -> None:
        """The same, with what lies beneath shining through; what crosses itself is no darker."""
        pieces = list(self._pieces(top, band.height))
        if not pieces:
            return
        columns = [column for points in pieces for column, _ in points]
        left = max(0, min(columns) - self._reach)
        right = min(band.width, max(columns) + self._reach)
        if left >= right:
            return
        mask = Image.new("L", (right - left, band.height), 0)
        pen = ImageDraw.Draw(mask)
        for points in pieces:
            moved = [(column - left, row) for column, row in points]
            pen.line(moved, fill=self.alpha, width=self.width, joint=self.joint)
        band.paste(self.colour, (left, 0), mask)

    def _pieces(self, top: int, height: int) -> Iterator[list[tuple[int, int]]]:
        """What of it lies in a band, with a point more at either end, for the corners between."""
        moved = [(column, row - top) for column, row in self.pixels.tolist()]
        if len(moved) <= _SHORT:
            yield moved
            return
        rows = np.sort(np.stack([self.pixels[:-1, 1], self.pixels[1:, 1]]) - top, axis=0)
        there = (rows[1] >= -self._reach) & (rows[0] < height + self._reach)
        there[:-1] |= there[1:].copy()
        there[1:] |= there[:-1].copy()
        ends = np.flatnonzero(np.diff(there, prepend=False, append=False)).tolist()
        for first, last in zip(ends[::2], ends[1::2], strict=True):
            yield moved[first : last + 1]


@dataclass(frozen=True, slots=True)
class _Disc(_Stroke):
    """A disc between two corners, which are `pixels`."""

    def draw(self, pen: ImageDraw.ImageDraw, top: int, height: int) -> None:
        """Draw it; what is not in the band is cut off."""
        pen.ellipse((self.pixels - [0, top]).ravel().tolist(), fill=self.colour)


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
