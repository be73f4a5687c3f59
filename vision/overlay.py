"""A picture laid on a raster of the ground, with its weight at each place.

Places are projected in the middle of squares of eight by eight pixels of the raster and
interpolated in between.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.units import GridPoint
from vision.projection import OBLIQUE_LIMIT
from vision.raster import Raster, Window

STEP: Final = 8
FEATHER: Final = 0.04
"""Part of a picture's width over which its weight fades at the rim."""
_PART: Final = 48 * STEP  # of a window, that is left out if the picture shows nothing of it
_ALL_INSIDE: Final = 1.001  # a fade above this is 1 between its middles, too
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
        height_m: Of the camera above that point, above 0.
        width_px: Columns of the picture that `pixels` means.
    """

    pixels: Callable[[Floats], Floats]
    below: GridPoint
    height_m: float
    width_px: int
    height_px: int

    def bounds(self) -> tuple[Floats, Floats] | None:
        """Return the south-western and north-eastern corner around what it shows, if anything."""
        below, reach_m = np.array(self.below), OBLIQUE_LIMIT * self.height_m
        low, high = below - reach_m, below + reach_m
        for _ in range(2):  # the second time where the first has found it
            east, north = np.linspace(low, high, _PROBES + 1).T
            points = np.stack(np.meshgrid(east, north), axis=-1)
            shown = self._inside_px(self.pixels(points)) > 0.0
            if not shown.any():
                return None
            seen, spacing_m = points[shown], (high - low) / _PROBES
            low, high = seen.min(axis=0) - spacing_m, seen.max(axis=0) + spacing_m
        return low, high

    def laid(
        self, raster: Raster, window: Window, times: float = 1.0
    ) -> Iterator[tuple[Window, Laying]]:
        """Yield the picture on the parts of a window where it shows something, its weight times
        `times`.

        A picture lies aslant on the ground: a good part of the window around it is not in it.
        """
        nodes = raster.middles(window, STEP)
        pixels = self.pixels(nodes)
        inside_px = self._inside_px(pixels)
        away_m = np.hypot(nodes[..., 0] - self.below.east_m, nodes[..., 1] - self.below.north_m)
        # an error of an angle moves the ground by this to the power of -2: its variance to that
        # of -4
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
                yield part, Laying(places[near], weight, (self.width_px, self.height_px))

    def _inside_px(self, pixels: Floats) -> Floats:
        """Return the pixels from the rim of the picture; negative outside."""
        x, y = pixels[..., 0], pixels[..., 1]
        across = np.minimum(x + 0.5, self.width_px - 0.5 - x)
        along = np.minimum(y + 0.5, self.height_px - 0.5 - y)
        return np.nan_to_num(np.minimum(across, along), nan=-1.0)


@dataclass(frozen=True, slots=True)
class Laying:
    """A picture of `size_px` columns and rows on a window.

    `nodes` are the middles of its squares in the picture; `weight` is of each pixel: 0 outside.
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
        # what lies outside weighs nothing, so it may be black, which is quicker than anything else
        found: NDArray[Any] = cv2.remap(
            framed_image, at, _NO_MAP, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT
        )
        return found


def _near(part: Window, window: Window) -> tuple[slice, ...]:
    """Return the squares of a part of a window, with one more all around."""
    return tuple(
        slice(side.start // STEP, -(-side.stop // STEP) + 2) for side in part.within(window)
    )


def _narrowed(block: Window, window: Window, shown: NDArray[np.bool_]) -> Window:
    """Return the whole squares of a block that may lie between middles of which one is shown."""
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
    """Return the weight at every pixel of a part; `fade` rises to 1 from the rim inwards."""
    found = _between(level, shape)
    if fade.min() > _ALL_INSIDE:
        return found
    share = _between(fade, shape)
    np.clip(share, 0.0, 1.0, out=share)
    return np.multiply(share, found, out=share)


def framed(image: NDArray[Any]) -> NDArray[Any]:
    """Return an image with its outermost pixels repeated around it, for `Laying.sampled`.

    >>> framed(np.array([[1, 2]], np.uint8)).tolist()
    [[1, 1, 2, 2], [1, 1, 2, 2], [1, 1, 2, 2]]
    """
    return cv2.copyMakeBorder(image, 1, 1, 1, 1, cv2.BORDER_REPLICATE)


def _between(nodes: NDArray[np.float32], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Interpolate to every pixel values of squares' middles, with one more row all around."""
    rows, columns = shape
    size = STEP * nodes.shape[1], STEP * nodes.shape[0]
    found = cv2.resize(nodes, size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(found[STEP : STEP + rows, STEP : STEP + columns], dtype=np.float32)
