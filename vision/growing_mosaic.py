"""A mosaic that grows in flight: each picture is fitted to the mosaic, and then added.

A picture shows ground of the pictures just before it, which have its own slow error, and ground of
earlier passes beside it. Both count alike, although it shows much less of the latter. So the
pictures of a lane move to the lane beside it, a little each.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.mosaic import Colours, Mosaic, Part, project_picture
from vision.raster import Floats, Overlay, Raster, Window

SEAM_M: Final = 0.1
"""Difference to the mosaic that a picture keeps, m: its own pose counts as well."""
PASS: Final = 8
"""Number of pictures of a vehicle after which one is of an earlier pass."""
SQUARE: Final = 0.25
"""Side of a square that is matched, as a share of the height: lanes overlap by a third."""
MIN_PX: Final = 16
MIN_RESPONSE: Final = 0.3
"""Minimum response of a phase correlation; a lower one may be chance."""
MIN_MATCHES: Final = 3
"""Minimum number of squares that agree."""
TOLERANCE: Final = 0.06
"""Maximum disagreement of a square with the others, as a share of the height."""
STIFF_M: Final = 5.0
"""Distance beyond which a difference turns a picture rather than moves it, m."""
MAX_SHIFT: Final = 0.15
"""Maximum error of a pose on the ground, as a share of the height."""
MAX_TURN: Final = 0.1
"""Maximum error of heading, rad, and of height, as a share."""

Grays = NDArray[np.float32]
Mask = NDArray[np.bool_]
Matches = NDArray[np.complex128]
"""Middles of squares and the picture's offsets there: columns + rows times i, (n, 2)."""


class GrowingMosaic(Mosaic):
    """A mosaic to which `vehicles` add their pictures in turn."""

    def __init__(self, window: Window, vehicles: int = 1) -> None:
        super().__init__(window)
        self._before = np.zeros(window.shape, np.float32), np.zeros(window.shape, np.float32)
        """Sums of gray and of weights over the pictures of earlier passes."""
        self._recent = deque[list[Part]]()
        self._count = PASS * vehicles

    def add(self, part: Part) -> None:
        """Add a part of the picture that was aligned last; before the first, of an earlier pass."""
        super().add(part)
        if self._recent:
            self._recent[-1].append(part)
        else:
            self._pass(part)

    def _pass(self, part: Part) -> None:
        at = part.window.within(self.window)
        gray = cv2.cvtColor(part.colours, cv2.COLOR_BGR2GRAY)
        shades = cv2.multiply(gray, part.weight, dtype=cv2.CV_32F)
        for summed, more in zip(self._before, (shades, part.weight), strict=True):
            cv2.add(summed[at], more, dst=summed[at])

    def aligned(
        self, overlay: Overlay, raster: Raster, window: Window, picture: Callable[[], Colours]
    ) -> Overlay:
        """Return a picture moved, turned and scaled so that it continues the mosaic.

        Squares of it are matched by phase correlation. It keeps `SEAM_M` of the difference. So the
        mosaic follows the mean of all poses, and errors do not add up. A picture stays in place if
        few squares match, or if it would move farther than a pose can be wrong.
        """
        self._recent.append([])
        while len(self._recent) > self._count:
            for part in self._recent.popleft():
                self._pass(part)
        height_px = overlay.height_m / raster.pitch_m
        kinds = self._matches(overlay, raster, window, picture, height_px)
        matches = np.concatenate(kinds)
        if len(matches) <= MIN_MATCHES:
            return overlay
        weight = np.concatenate([np.full(len(some), 1.0 / max(len(some), 1)) for some in kinds])
        weight /= weight.sum()
        middle, shift = weight @ matches
        places, shifts = (matches - (middle, shift)).T
        spread = weight @ np.abs(places) ** 2 + (STIFF_M / raster.pitch_m) ** 2
        turn = (weight * places.conj()) @ shifts / spread
        most_m = raster.pitch_m * float(np.abs(turn * places + shift).max())
        if most_m > MAX_SHIFT * overlay.height_m or abs(turn) > MAX_TURN:
            return overlay
        moved = max(0.0, 1.0 - SEAM_M / max(most_m, SEAM_M))
        corner = np.array([raster.west_m, raster.north_m])
        middle += complex(window.left, window.top)

        def pixels(ground: Floats) -> Floats:
            at = ((ground - corner) @ (1.0, -1.0j)) / raster.pitch_m
            there = (at + moved * (turn * (at - middle) + shift)) * raster.pitch_m
            return overlay.pixels(np.stack([there.real, -there.imag], axis=-1) + corner)

        return replace(overlay, pixels=pixels)

    def _matches(
        self,
        overlay: Overlay,
        raster: Raster,
        window: Window,
        picture: Callable[[], Colours],
        height_px: float,
    ) -> tuple[Matches, Matches]:
        """Return the squares that agree, on ground of earlier passes and on other ground."""
        shown, new = np.zeros(window.shape, np.bool_), np.zeros(window.shape, np.float32)
        for part in project_picture(overlay, raster, window, picture):
            at = part.window.within(window)
            new[at] = cv2.cvtColor(part.colours, cv2.COLOR_BGR2GRAY)
            shown[at] = part.weight > 0.0
        at = window.within(self.window)
        gray, weight = (summed[at] for summed in self._before)
        total = self._total[at]
        early, there = weight > 0.0, total > 0.0
        before = _mean(gray, weight, early)
        now = _mean(cv2.cvtColor(self._colours[at], cv2.COLOR_BGR2GRAY), total, there)
        side, most_px = max(MIN_PX, round(SQUARE * height_px)), TOLERANCE * height_px
        return (
            _agreeing(before, new, early & shown, side, most_px),
            _agreeing(now, new, there & ~early & shown, side, most_px),
        )


def _mean(sums: NDArray[Any], weight: Grays, there: Mask) -> Grays:
    return np.asarray(sums / np.where(there, weight, np.float32(1.0)), np.float32)


def _agreeing(old: Grays, new: Grays, both: Mask, side: int, most_px: float) -> Matches:
    """Return the squares within `most_px` pixels of their median; none if they are few."""
    found = np.array(list(_squares(old, new, both, side)), np.complex128).reshape(-1, 2)
    if not len(found):
        return found
    shifts = found[:, 1]
    median = complex(np.median(shifts.real), np.median(shifts.imag))
    good = np.abs(shifts - median) < most_px
    enough = np.count_nonzero(good) >= max(MIN_MATCHES, len(found) / 2)
    return found[good] if enough else found[:0]


def _squares(old: Grays, new: Grays, both: Mask, side: int) -> Iterator[tuple[complex, complex]]:
    """Yield middles of squares and the offsets of `new` there: columns + rows times i."""
    hann = cv2.createHanningWindow((side, side), cv2.CV_32F)
    rows, columns = both.shape
    for top in range(0, rows - side + 1, side // 2):
        for left in range(0, columns - side + 1, side // 2):
            at = slice(top, top + side), slice(left, left + side)
            if both[at].all():
                before, now = (gray[at] - gray[at].mean() for gray in (old, new))
                (right, down), response = cv2.phaseCorrelate(before, now, hann)
                if response > MIN_RESPONSE:
                    yield complex(left, top) + side / 2 * (1 + 1j), complex(right, down)
