"""A mosaic: pictures laid together on a raster; the one that looks down most steeply shows.

Each picture fades into the next. A mosaic may grow while pictures come.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.raster import Floats, Overlay, Raster, Window

SHARPNESS: Final = 2
"""Number of times that weights are squared: the best picture shows, the others hardly."""
SEAM_M: Final = 0.25
"""Difference to the mosaic, m, that a picture keeps: its pose has as much to say."""
SQUARE: Final = 0.3
"""Side of a square that is matched, in heights."""
LEAST_PX: Final = 24
LEAST_RESPONSE: Final = 0.1
"""Of a phase correlation; below it is chance."""
LEAST_MATCHES: Final = 4
TOLERANCE: Final = 0.04
"""Maximum disagreement of a square with the others, in heights."""
MOST_SHIFT: Final = 0.1
"""Maximum error of a pose on the ground, in heights."""
MOST_TURN: Final = 0.1
"""Maximum error of heading, rad, and of height, as a share."""
_ROWS: Final = 256

Colours = NDArray[np.uint8]
Grays = NDArray[np.float32]


class Part(NamedTuple):
    """A picture on a part of a raster: colours (rows, columns, 3), and the weight of each pixel."""

    window: Window
    colours: Colours
    weight: NDArray[np.float32]


def laid(
    overlay: Overlay,
    raster: Raster,
    window: Window,
    picture: Callable[[], Colours | None],
    times: float = 1.0,
) -> list[Part]:
    """Lay a picture on a window of a raster.

    `picture` returns blue-green-red, of any size, `framed`, or None; it is called where the picture
    shows something of the window. `times` is its weight beside others.
    """
    found, image = [], None
    for at, laying in () if window.is_empty else overlay.laid(raster, window, times):
        image = picture() if image is None else image
        if image is None:
            break
        weight = laying.weight
        for _ in range(SHARPNESS):
            weight = weight * weight
        found.append(Part(at, laying.sampled(image), weight))
    return found


def _matches(
    old: Grays, new: Grays, both: NDArray[np.bool_], side: int
) -> Iterator[tuple[complex, complex]]:
    """Yield middles of squares and by how much `new` is off there: columns + rows times i."""
    hann = cv2.createHanningWindow((side, side), cv2.CV_32F)
    rows, columns = both.shape
    for top in range(0, rows - side + 1, side // 2):
        for left in range(0, columns - side + 1, side // 2):
            at = slice(top, top + side), slice(left, left + side)
            if both[at].all():
                before, now = (gray[at] - gray[at].mean() for gray in (old, new))
                (right, down), response = cv2.phaseCorrelate(before, now, hann)
                if response > LEAST_RESPONSE:
                    yield complex(left, top) + side / 2 * (1 + 1j), complex(right, down)


class Mosaic:
    """The sums of all pictures over a window of a raster."""

    def __init__(self, window: Window) -> None:
        self.window = window
        self._colours = np.zeros((*window.shape, 3), np.float32)
        self._total = np.zeros(window.shape, np.float32)

    def add(self, part: Part) -> None:
        """Add a picture on a part of the window."""
        at = part.window.within(self.window)
        shades = cv2.multiply(part.colours, cv2.merge([part.weight] * 3), dtype=cv2.CV_32F)
        for summed, more in ((self._colours, shades), (self._total, part.weight)):
            cv2.add(summed[at], more, dst=summed[at])

    def aligned(
        self, overlay: Overlay, raster: Raster, window: Window, picture: Callable[[], Colours]
    ) -> Overlay:
        """Return a picture moved, turned and scaled so that it continues what is laid.

        Squares of it are matched by phase correlation. It keeps `SEAM_M` of the difference: so the
        mosaic lies where all poses say, and errors do not add up. A picture of which few squares
        match, or that would be moved farther than a pose can be wrong, stays where it is.
        """
        old, new, both = self._beside(overlay, raster, window, picture)
        side = max(LEAST_PX, round(SQUARE * overlay.height_m / raster.pitch_m))
        matches = np.array(list(_matches(old, new, both, side)), np.complex128).reshape(-1, 2)
        places, shifts = matches.T
        middle, turn, shift = complex(0.0), complex(0.0), complex(0.0)
        for _ in range(2):  # the second time without what contradicts the others
            if len(places) < max(LEAST_MATCHES, len(matches) / 2):
                return overlay
            middle = places.mean()
            around = np.column_stack([places - middle, np.ones_like(places)])
            turn, shift = np.linalg.lstsq(around, shifts, rcond=None)[0]
            off = np.abs(shifts - around @ [turn, shift]) * raster.pitch_m
            good = off < TOLERANCE * overlay.height_m
            most_m = raster.pitch_m * float(np.abs(around @ [turn, shift]).max())
            places, shifts = places[good], shifts[good]
        if most_m > MOST_SHIFT * overlay.height_m or abs(turn) > MOST_TURN:
            return overlay
        part = max(0.0, 1.0 - SEAM_M / max(most_m, SEAM_M))
        corner = np.array([raster.west_m, raster.north_m])
        middle += complex(window.left, window.top)

        def pixels(ground: Floats) -> Floats:
            at = ((ground - corner) @ (1.0, -1.0j)) / raster.pitch_m
            moved = (at + part * (turn * (at - middle) + shift)) * raster.pitch_m
            return overlay.pixels(np.stack([moved.real, -moved.imag], axis=-1) + corner)

        return replace(overlay, pixels=pixels)

    def _beside(
        self, overlay: Overlay, raster: Raster, window: Window, picture: Callable[[], Colours]
    ) -> tuple[Grays, Grays, NDArray[np.bool_]]:
        """Return the mosaic and a picture in gray on a window, and where both show something."""
        both, new = np.zeros(window.shape, np.bool_), np.zeros(window.shape, np.float32)
        for part in laid(overlay, raster, window, picture):
            at = part.window.within(window)
            new[at] = cv2.cvtColor(part.colours, cv2.COLOR_BGR2GRAY)
            both[at] = part.weight > 0.0
        at = window.within(self.window)
        total = self._total[at]
        both &= total > 0.0
        sums = cv2.cvtColor(self._colours[at], cv2.COLOR_BGR2GRAY)
        return (sums / np.where(both, total, np.float32(1.0))).astype(np.float32), new, both

    def image(self) -> Colours | None:
        """Return the mosaic so far; None where no picture shows anything of the window.

        Shape (rows, columns, 4): red, green, blue, and 255 where there is a picture, else 0.
        """
        if not cv2.hasNonZero(self._total):
            return None
        found = np.empty((*self._total.shape, 4), np.uint8)
        for top in range(0, len(self._total), _ROWS):  # some rows at a time, to save memory
            rows = slice(top, top + _ROWS)
            weight = self._total[rows]
            mean = cv2.divide(self._colours[rows], cv2.merge([weight] * 3))  # 0 where none is
            blue, green, red = cv2.split(cv2.convertScaleAbs(mean))
            there = (weight > 0.0).view(np.uint8) * np.uint8(255)
            cv2.merge([red, green, blue, there], dst=found[rows])
        return found


def shrunk(image: NDArray[np.uint8], times: float) -> NDArray[np.uint8]:
    """Return an image of `times` fewer pixels along an edge, by means over squares.

    >>> shrunk(np.full((6, 9), 7, np.uint8), 3.4).shape
    (2, 3)
    """
    factor = int(times)
    if factor < 2:
        return image
    rows, columns = (max(1, side // factor) for side in image.shape[:2])
    return np.asarray(cv2.resize(image, (columns, rows), interpolation=cv2.INTER_AREA), np.uint8)
