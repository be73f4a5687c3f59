"""A raster on the ground: pictures projected onto it, and their probabilities fused.

A raster has square pixels along the grid's axes, rows from north to south. A picture's places are
projected in the middle of squares of eight by eight pixels of the raster, and interpolated in
between. The fused probability is the weighted mean over the pictures that show a place. Pictures
of the same ground are no independent evidence (all have the same shadow), so log-odds are not
added.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.geo.grid import Grid
from missions.geo.terrain import Terrain
from missions.units import GridPoint, Pose
from vision.camera import Camera
from vision.detectors.interface import Marks
from vision.projection import OBLIQUE_LIMIT, Projection


class Window(NamedTuple):
    """A part of a raster: its first row and column, and those after its last."""

    top: int
    left: int
    bottom: int
    right: int

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns; never negative."""
        return max(0, self.bottom - self.top), max(0, self.right - self.left)

    @property
    def is_empty(self) -> bool:
        """True if it has no pixel."""
        return 0 in self.shape

    def common(self, other: Window) -> Window:
        """Return the common part of two windows, which may be empty.

        >>> Window(0, 0, 4, 4).common(Window(2, 1, 9, 3))
        Window(top=2, left=1, bottom=4, right=3)
        """
        return Window(
            max(self.top, other.top),
            max(self.left, other.left),
            min(self.bottom, other.bottom),
            min(self.right, other.right),
        )

    def within(self, other: Window) -> tuple[slice, slice]:
        """Return the slices of this window in an array of `other`, which contains it."""
        return (
            slice(self.top - other.top, self.bottom - other.top),
            slice(self.left - other.left, self.right - other.left),
        )

    def blocks(self, side: int) -> Iterator[Window]:
        """Yield windows of at most `side` pixels that cover it, row by row from its top."""
        for top in range(self.top, self.bottom, side):
            for left in range(self.left, self.right, side):
                yield Window(top, left, top + side, left + side).common(self)

    def grown(self, by: int) -> Window:
        """Return the window with `by` more pixels on each side."""
        return Window(self.top - by, self.left - by, self.bottom + by, self.right + by)


@dataclass(frozen=True, slots=True)
class Raster:
    """Pixels of `pitch_m` in the grid's moving frame.

    Attributes:
        west_m: Left edge of the first column, metres east.
        north_m: Upper edge of the first row, metres north.
        pitch_m: Edge of a pixel on the ground, metres, above 0.

    >>> raster = Raster(0.0, 10.0, 0.5, 4, 3)
    >>> raster.middles(Window(0, 0, 1, 2), 1)[1].tolist()
    [[-0.25, 9.75], [0.25, 9.75], [0.75, 9.75], [1.25, 9.75]]
    """

    west_m: float
    north_m: float
    pitch_m: float
    columns: int
    rows: int

    @property
    def whole(self) -> Window:
        """Window of all pixels."""
        return Window(0, 0, self.rows, self.columns)

    def shared(self, windows: Iterable[Window], side: int) -> dict[Window, list[int]]:
        """Return the blocks in which windows lie, from the north, each with the windows' numbers.

        >>> found = Raster(0.0, 0.0, 1.0, 9, 9).shared([Window(0, 3, 2, 6), Window(8, 0, 9, 1)], 4)
        >>> [(block.top, block.left, numbers) for block, numbers in found.items()]
        [(0, 0, [0]), (0, 4, [0]), (8, 0, [1])]
        """
        found: dict[tuple[int, int], list[int]] = {}
        for number, window in enumerate(windows):
            if window.is_empty:
                continue
            for row in range(window.top // side, -(-window.bottom // side)):
                for column in range(window.left // side, -(-window.right // side)):
                    found.setdefault((row, column), []).append(number)
        return {
            Window(
                row * side, column * side, (row + 1) * side, (column + 1) * side
            ).common(self.whole): found[row, column]
            for row, column in sorted(found)
        }  # fmt: skip

    def middles(self, window: Window, side: int) -> NDArray[np.float64]:
        """Return metres east and north of the middles of squares of `side` pixels.

        They cover a window from its first pixel, with one more all around. Shape (rows / side
        rounded up + 2, columns / side rounded up + 2, 2).
        """
        rows, columns = (np.arange(-1, math.ceil(edge / side) + 1) + 0.5 for edge in window.shape)
        east = self.west_m + (window.left + side * columns) * self.pitch_m
        north = self.north_m - (window.top + side * rows) * self.pitch_m
        return np.stack(np.meshgrid(east, north), axis=-1)

    def around(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> Window:
        """Return the window of the pixels between two corners (metres east and north)."""
        left, right = ((corner[0] - self.west_m) / self.pitch_m for corner in (low, high))
        top, bottom = ((self.north_m - corner[1]) / self.pitch_m for corner in (high, low))
        return Window(
            math.floor(top), math.floor(left), math.ceil(bottom) + 1, math.ceil(right) + 1
        ).common(self.whole)


# --- pictures laid on it -------------------------------------------------------------------------
STEP: Final = 8
FEATHER: Final = 0.04
"""Share of a picture's width over which its weight fades at the rim."""
_PART: Final = 48 * STEP  # px; a part of a window that the picture does not show is left out
_ALL_INSIDE: Final = 1.001  # a fade above this is 1 between its middles also
# columns and rows are in one map; an empty array in place of the other gives nonsense
_NO_MAP: Final[Any] = None
_PROBES: Final = 32  # along each side of the ground that a picture may show

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Overlay:
    """One picture over the ground.

    Attributes:
        pixels: Pixels (n, m, 2) of ground points (n, m, 2) in the grid's moving frame; NaN behind
            the camera.
        below: The point under the camera, in the moving frame at the exposure.
        height_m: Height of the camera above that point, above 0.
        width_px: Columns of the picture, in units of `pixels`.
    """

    pixels: Callable[[Floats], Floats]
    below: GridPoint
    height_m: float
    width_px: int
    height_px: int

    @classmethod
    def at_pose(
        cls, camera: Camera, pose: Pose, t_s: float, grid: Grid, terrain: Terrain | None
    ) -> Overlay:
        """Return the overlay of a picture that was taken at mission time `t_s`."""
        return cls(
            Projection(camera, pose, t_s, grid, terrain).pixels,
            grid.to_moving(grid.fixed(pose.position), t_s),
            pose.height_m,
            camera.width_px,
            camera.height_px,
        )

    def bounds(self) -> tuple[Floats, Floats] | None:
        """Return the south-western and north-eastern corners of its ground; None if it has none."""
        below, reach_m = np.array(self.below), OBLIQUE_LIMIT * self.height_m
        low, high = below - reach_m, below + reach_m
        for _ in range(2):  # the second pass refines what the first has found
            east, north = np.linspace(low, high, _PROBES + 1).T
            points = np.stack(np.meshgrid(east, north), axis=-1)
            shown = self._inside_px(self.pixels(points)) > 0.0
            if not shown.any():
                return None
            seen, spacing_m = points[shown], (high - low) / _PROBES
            low, high = seen.min(axis=0) - spacing_m, seen.max(axis=0) + spacing_m
        return low, high

    def on_window(
        self, raster: Raster, window: Window, times: float = 1.0
    ) -> Iterator[tuple[Window, ProjectedPicture]]:
        """Yield the parts of a window that the picture shows, its weight multiplied by `times`.

        A picture lies aslant on the ground, so a good part of the window around it is outside of
        it.
        """
        nodes = raster.middles(window, STEP)
        pixels = self.pixels(nodes)
        inside_px = self._inside_px(pixels)
        away_m = np.hypot(nodes[..., 0] - self.below.east_m, nodes[..., 1] - self.below.north_m)
        # an angle's error moves the ground by this to the power of -2, so its variance grows by
        # this to the power of -4
        level = (self.height_m**2 / (self.height_m**2 + away_m**2)) ** 2 * times
        level[away_m > OBLIQUE_LIMIT * self.height_m] = 0.0
        shown = (inside_px > 0.0) & (level > 0.0)
        fade = (inside_px * (1.0 / (FEATHER * self.width_px))).astype(np.float32)
        places = np.nan_to_num(pixels, nan=-1e4).astype(np.float32)
        heavy = level.astype(np.float32)
        for block in window.blocks(_PART):
            part = _narrowed(block, window, shown)
            if not part.is_empty:
                near = _near(part, window)
                weight = _weight(fade[near], heavy[near], part.shape)
                yield part, ProjectedPicture(places[near], weight, (self.width_px, self.height_px))

    def _inside_px(self, pixels: Floats) -> Floats:
        """Return the pixels from the rim of the picture; negative outside."""
        x, y = pixels[..., 0], pixels[..., 1]
        across = np.minimum(x + 0.5, self.width_px - 0.5 - x)
        along = np.minimum(y + 0.5, self.height_px - 0.5 - y)
        return np.nan_to_num(np.minimum(across, along), nan=-1.0)


@dataclass(frozen=True, slots=True)
class ProjectedPicture:
    """A picture of `size_px` columns and rows on a window.

    `nodes` are the middles of its squares in the picture; `weight` is that of each pixel, 0
    outside.
    """

    nodes: NDArray[np.float32]
    weight: NDArray[np.float32]
    size_px: tuple[int, int]

    def sampled(self, framed_image: NDArray[Any]) -> NDArray[Any]:
        """Sample an image of the picture, of any size, `framed`, on the window."""
        rows, columns = (side - 2 for side in framed_image.shape[:2])
        # from pixels' edges to pixels' edges, of which the frame has one more
        scale = np.divide((columns, rows), self.size_px)
        places = (self.nodes * scale + (scale + 1.0) / 2.0).astype(np.float32)
        at = _between(places, self.weight.shape)
        # what lies outside weighs nothing: it may be black, which is quickest
        found: NDArray[Any] = cv2.remap(
            framed_image, at, _NO_MAP, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT
        )
        return found


def _near(part: Window, window: Window) -> tuple[slice, ...]:
    """Return the slices of a part's squares within its window, with one more all around."""
    return tuple(
        slice(side.start // STEP, -(-side.stop // STEP) + 2) for side in part.within(window)
    )


def _narrowed(block: Window, window: Window, shown: NDArray[np.bool_]) -> Window:
    """Return the part of a block, in whole squares, that the picture may show."""
    found = shown[_near(block, window)]
    rows, columns = (np.flatnonzero(found.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return Window(0, 0, 0, 0)
    return Window(
        block.top + (int(rows[0]) - 2) * STEP,
        block.left + (int(columns[0]) - 2) * STEP,
        block.top + (int(rows[-1]) + 1) * STEP,
        block.left + (int(columns[-1]) + 1) * STEP,
    ).common(block)


def _weight(
    fade: NDArray[np.float32], level: NDArray[np.float32], shape: tuple[int, ...]
) -> NDArray[np.float32]:
    """Return the weight of every pixel of a part; `fade` rises to 1 from the rim inwards."""
    found = _between(level, shape)
    if fade.min() > _ALL_INSIDE:
        return found
    share = _between(fade, shape)
    np.clip(share, 0.0, 1.0, out=share)
    return np.multiply(share, found, out=share)


def framed(image: NDArray[Any]) -> NDArray[Any]:
    """Return an image with its outermost pixels repeated around it, for `ProjectedPicture.sampled`.

    >>> framed(np.array([[1, 2]], np.uint8)).tolist()
    [[1, 1, 2, 2], [1, 1, 2, 2], [1, 1, 2, 2]]
    """
    return cv2.copyMakeBorder(image, 1, 1, 1, 1, cv2.BORDER_REPLICATE)


def _between(nodes: NDArray[np.float32], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Interpolate values of squares' middles, with one more row all around, to every pixel."""
    rows, columns = shape
    size = STEP * nodes.shape[1], STEP * nodes.shape[0]
    found = cv2.resize(nodes, size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(found[STEP : STEP + rows, STEP : STEP + columns], dtype=np.float32)


# --- many pictures fused -------------------------------------------------------------------------
UNSEEN: Final = 255
MOST: Final = 254
"""Levels of a probability: 0 to `MOST`; `UNSEEN` where no picture shows the place."""

SMOOTH_PX: Final = 1.0
"""Standard deviation of the smoothing of the sums, pixels of the raster."""
HALO_PX: Final = 4
"""Reach of the smoothing around a window, pixels."""
_ROWS: Final = 256  # smoothed at once: all rows at once would double the memory

Levels = NDArray[np.uint8]


class Fusion:
    """Sums over a window of a raster; a place counts as shown from `least` pictures on."""

    def __init__(self, window: Window, least: int = 1) -> None:
        self.window, self._least = window.grown(HALO_PX), least
        self._count = np.zeros(self.window.shape, np.uint8)
        self._sum = np.zeros(self.window.shape, np.float32)
        self._weight = np.zeros(self.window.shape, np.float32)

    def add(self, part: Window, levels: NDArray[np.uint8], weight: NDArray[np.float32]) -> None:
        """Add a picture on a part of the window: levels 0 to 255, and its weight."""
        at = part.within(self.window)
        product = cv2.multiply(levels, weight, dtype=cv2.CV_32F)
        for total, more in ((self._sum, product), (self._weight, weight)):
            cv2.add(total[at], more, dst=total[at])
        count = self._count[at]  # it stops at 255
        cv2.add(count, (weight > 0.0).view(np.uint8), dst=count)

    def levels(self) -> Levels:
        """Return the fused probability of the window, 0 to `MOST`, or `UNSEEN`."""
        rows, columns = self.window.shape
        found = np.full((rows - 2 * HALO_PX, columns - 2 * HALO_PX), UNSEEN, np.uint8)
        for top in range(HALO_PX, rows - HALO_PX, _ROWS):
            bottom = min(top + _ROWS, rows - HALO_PX)
            seen = self._count[top:bottom, HALO_PX:-HALO_PX] >= self._least
            if seen.any():
                into = found[top - HALO_PX : bottom - HALO_PX]
                np.copyto(into, self._smoothed(top, bottom), where=seen)
        return found

    def _smoothed(self, top: int, bottom: int) -> Levels:
        """Return the levels of some rows, without the halo at their ends."""
        total, weight = (
            np.asarray(
                cv2.GaussianBlur(
                    sums[top - HALO_PX : bottom + HALO_PX],
                    (5, 5),
                    SMOOTH_PX,
                    borderType=cv2.BORDER_REPLICATE,
                )[HALO_PX:-HALO_PX, HALO_PX:-HALO_PX],
                np.float32,
            )
            for sums in (self._sum, self._weight)
        )
        weight[weight <= 0.0] = 1.0
        np.multiply(total, np.float32(MOST / 255.0), out=total)
        np.divide(total, weight, out=total)
        return np.rint(total, out=total).astype(np.uint8)


def as_levels(marks: Marks, shrinks_px: int = 0) -> NDArray[np.uint8]:
    """Return a detector's marks as levels 0 to 255, a mask grown by `shrinks_px`.

    >>> as_levels(np.array([[0, 255, 0, 0]], np.uint8), 1).tolist()
    [[255, 255, 255, 0]]
    >>> as_levels(np.array([[0.0, 0.2, 1.0]], np.float32)).tolist()
    [[0, 51, 255]]
    """
    if marks.dtype != np.uint8:
        return np.round(marks * np.float32(255.0)).astype(np.uint8)
    if not shrinks_px:
        return np.asarray(marks, dtype=np.uint8)
    kernel = np.ones((3, 3), np.uint8)
    return np.asarray(cv2.dilate(marks, kernel, iterations=shrinks_px), dtype=np.uint8)
