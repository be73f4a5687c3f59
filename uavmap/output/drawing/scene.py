"""The model of every drawing: layers of shapes in metres, and the view that shows them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Final, Literal, NamedTuple, Self

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely.geometry.base import BaseGeometry

from missions.units import GridPoint
from uavmap.output.drawing.palette import Colour, Style

MAP_SIDE_PX: Final = 900
"""Longer side of a map, px."""
SHORTEST_SIDE_PX: Final = 520
"""Minimum of the shorter side of a map, px: its legend stands beside it."""
_PAD: Final = 0.05
_MIN_PX: Final = 0.4
"""Minimum distance of two neighbours in a line that are both kept, px."""

Place = tuple[float, float]
"""East and north in metres, or column and row on a page."""
Bounds = tuple[float, float, float, float]
"""West, south, east, north."""


@dataclass(frozen=True, slots=True)
class View:
    """The rectangle that a drawing shows; a page's rows count down from its upper left corner."""

    left_m: float
    top_m: float
    px_per_m: float
    width_px: int
    height_px: int
    north_up: bool = True

    @classmethod
    def page(cls, width_px: float, height_px: float) -> Self:
        """Create the view of a page; places are pixels from its upper left corner."""
        return cls(0.0, 0.0, 1.0, round(width_px), round(height_px), north_up=False)

    @classmethod
    def around(cls, bounds: Bounds, least_pad_m: float = 0.0) -> Self:
        """Create the view of a map of some bounds with a margin."""
        west, south, east, north = bounds
        pad_m = max(_PAD * max(east - west, north - south), least_pad_m)
        width_m, height_m = east - west + 2 * pad_m, north - south + 2 * pad_m
        px_per_m = MAP_SIDE_PX / max(width_m, height_m)
        width_px = max(round(width_m * px_per_m), SHORTEST_SIDE_PX)
        height_px = max(round(height_m * px_per_m), SHORTEST_SIDE_PX)
        left_m = (west + east) / 2 - width_px / px_per_m / 2
        top_m = (south + north) / 2 + height_px / px_per_m / 2
        return cls(left_m, top_m, px_per_m, width_px, height_px)

    def sized(self, width_px: int, height_px: int) -> View:
        """Return the view of the same middle and at least the same ground in another size."""
        px_per_m = self.px_per_m * min(width_px / self.width_px, height_px / self.height_px)
        left_m = self.left_m + (self.width_px / self.px_per_m - width_px / px_per_m) / 2.0
        top_m = self.top_m - (self.height_px / self.px_per_m - height_px / px_per_m) / 2.0
        return replace(
            self, left_m=left_m, top_m=top_m, px_per_m=px_per_m, width_px=width_px,
            height_px=height_px,
        )  # fmt: skip

    def pixels(self, places: ArrayLike) -> NDArray[np.float64]:
        """Return columns and rows of places, shape (n, 2), from the upper left corner.

        >>> View(-10.0, 10.0, 2.0, 40, 40).pixels([(0.0, 5.0)]).tolist()
        [[20.0, 10.0]]
        """
        scale = np.array([self.px_per_m, -self.px_per_m if self.north_up else self.px_per_m])
        points = np.asarray(places, dtype=np.float64).reshape(-1, 2)
        result: NDArray[np.float64] = (points - (self.left_m, self.top_m)) * scale
        return result

    def trace(self, places: ArrayLike) -> NDArray[np.float64]:
        """Return the pixels of a line, without points too near to the one before."""
        pixels = self.pixels(places)
        far = np.hypot(*np.diff(pixels, axis=0).T) >= _MIN_PX
        kept: NDArray[np.float64] = pixels[np.concatenate([[True], far])]
        return kept

    def pixel(self, place: Place) -> Place:
        """Return column and row of one place."""
        ((x, y),) = self.pixels([place]).tolist()
        return x, y

    @property
    def ground(self) -> BaseGeometry:
        """The ground in view, with a metre around it."""
        right_m = self.left_m + self.width_px / self.px_per_m
        low_m = self.top_m + (-1 if self.north_up else 1) * self.height_px / self.px_per_m
        low_m, high_m = sorted((low_m, self.top_m))
        return shapely.box(self.left_m - 1, low_m - 1, right_m + 1, high_m + 1)


# --- shapes --------------------------------------------------------------------------------------
@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Cells of a grid.

    Attributes:
        cells: Columns and rows, shape (n, 2).
        codes: Number of each cell's colour, shape (n,).
        origin: Centre of cell (0, 0).
        opaque: For each colour, true if it hides most of a photograph below.
    """

    cells: NDArray[np.int32]
    codes: NDArray[np.uint8]
    colours: tuple[Colour, ...]
    cell_m: float
    origin: GridPoint
    opaque: tuple[bool, ...]


class Box(NamedTuple):
    """A filled rectangle between two opposite corners."""

    corner: Place
    opposite: Place
    colour: Colour


class Area(NamedTuple):
    """A filled polygon."""

    ring: tuple[Place, ...]
    colour: Colour


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """A line with round corners, shape (n, 2); closed if its last place is its first."""

    places: NDArray[np.float64]
    style: Style

    @classmethod
    def through(cls, places: Iterable[Place], style: Style, *, closed: bool = False) -> Self:
        """Create a line through places."""
        points = list(places)
        array = np.array([*points, *points[:1]] if closed else points, dtype=np.float64)
        return cls(array.reshape(-1, 2), style)


class Dot(NamedTuple):
    """Discs about a place: radius in pixels and colour, the largest first."""

    place: Place
    discs: tuple[tuple[float, Colour], ...]


class Label(NamedTuple):
    """A line of text, vertically centred `offset_px` right of and below a place."""

    place: Place
    text: str
    size_px: float
    colour: Colour
    anchor: Literal["start", "middle", "end"] = "start"
    offset_px: tuple[float, float] = (0.0, 0.0)


Shape = Box | Area | Line | Dot | Label


# --- layers --------------------------------------------------------------------------------------
class Entry(NamedTuple):
    """A line of the legend: a sample, which is a fill, a line or discs, and its text."""

    sample: Colour | Style | tuple[tuple[float, Colour], ...]
    text: str


class Layer(NamedTuple):
    """Shapes of one kind, and their legend."""

    shapes: tuple[Shape, ...]
    legend: tuple[Entry, ...] = ()


@dataclass(frozen=True, slots=True)
class Scene:
    """A map or a plan in metres of the grid's fixed frame: cells, and layers from the lowest up."""

    title: str
    subtitle: str
    view: View
    layers: tuple[Layer, ...]
    cells: Cells | None = None
    notes: tuple[str, ...] = ()
    """Lines beside the map, under the legend."""

    @property
    def shapes(self) -> Iterator[Shape]:
        """All shapes over the cells, the lowest first."""
        return (shape for layer in self.layers for shape in layer.shapes)

    @property
    def legend(self) -> tuple[Entry, ...]:
        """The legend of all layers."""
        return tuple(entry for layer in self.layers for entry in layer.legend)


def rings_of(shape: BaseGeometry) -> list[NDArray[np.float64]]:
    """Return every ring of a polygon or of many, closed."""
    return [
        shapely.get_coordinates(ring)
        for part in shapely.get_parts(shape)
        if part.geom_type == "Polygon" and not part.is_empty
        for ring in (part.exterior, *part.interiors)
    ]


def bounds_of(places: Iterable[Place]) -> Bounds:
    """Return west, south, east and north of places."""
    easts, norths = zip(*places, strict=True)
    return min(easts), min(norths), max(easts), max(norths)
