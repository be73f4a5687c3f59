"""A georeferenced picture as the ground that a camera sees."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import numpy.typing as npt
import pyproj
from pyproj.exceptions import ProjError

from missions.errors import WorldError
from missions.units import LatLon

Matrix = npt.NDArray[np.float64]
Picture = npt.NDArray[np.uint8]

_SMALLEST_PX = 32  # of a reduced picture


@dataclass(frozen=True, eq=False)
class Orthophoto:
    """Pixels (rows, columns, 3; blue-green-red) and where they lie.

    `to_crs` takes (column, row, 1), whole numbers at the centres of pixels, to coordinates of the
    system `epsg`, x east and y north; `known` is 255 where the picture has data, else 0.
    """

    pixels: Picture
    known: Picture
    to_crs: Matrix
    epsg: int

    def __post_init__(self) -> None:
        if abs(float(np.linalg.det(self.to_crs))) < 1e-30:
            raise WorldError("the pixels of the picture have no extent on the ground")
        try:
            centre = self.position((self.pixels.shape[1] - 1) / 2, (self.pixels.shape[0] - 1) / 2)
        except ProjError as error:
            raise WorldError(f"EPSG:{self.epsg}: {error}") from error
        if not (math.isfinite(centre.lat_deg) and abs(centre.lat_deg) <= 90.0):
            raise WorldError(f"the coordinates of the picture are not in EPSG:{self.epsg}")

    @cached_property
    def _to_wgs84(self) -> pyproj.Transformer:
        return pyproj.Transformer.from_crs(f"EPSG:{self.epsg}", "EPSG:4326", always_xy=True)

    @cached_property
    def _from_crs(self) -> Matrix:
        return np.asarray(np.linalg.inv(self.to_crs), dtype=np.float64)

    @cached_property
    def _reduced(self) -> list[tuple[Picture, Picture]]:
        """The picture and its halvings; pixel (0, 0) keeps its centre."""
        levels = [(self.pixels, self.known)]
        while min(levels[-1][0].shape[:2]) >= 2 * _SMALLEST_PX:
            pixels, known = levels[-1]
            smaller = np.asarray(cv2.pyrDown(pixels), dtype=np.uint8)
            levels.append((smaller, np.asarray(cv2.pyrDown(known), dtype=np.uint8)))
        return levels

    def position(self, column: float, row: float) -> LatLon:
        """Where a pixel lies."""
        x, y, _ = self.to_crs @ (column, row, 1.0)
        lon, lat = self._to_wgs84.transform(x, y)
        return LatLon(float(lat), float(lon))

    def pixel(self, position: LatLon) -> tuple[float, float]:
        """Column and row of a position, also outside the picture."""
        x, y = self._to_wgs84.transform(position.lon_deg, position.lat_deg, direction="INVERSE")
        column, row, _ = self._from_crs @ (x, y, 1.0)
        return float(column), float(row)

    def seen(
        self, corners: Sequence[LatLon], at_px: Matrix, size: tuple[int, int]
    ) -> tuple[Picture, Picture]:
        """A view of the ground: what is seen, and 255 where it is known.

        `corners` are four places on the ground and `at_px` (4, 2) their pixels in the view of
        `size` (columns, rows). The four are projected exactly, what is between them follows the
        homography: over a footprint a map projection is as good as linear.
        """
        source = np.array([self.pixel(p) for p in corners])
        view = cv2.contourArea(at_px.astype(np.float32))
        ratio = cv2.contourArea(source.astype(np.float32)) / max(view, 1.0)
        # half as fine as the view at most: a finer picture would flicker
        level = math.floor(0.5 * math.log2(max(ratio, 1.0)))
        level = min(level, len(self._reduced) - 1)
        pixels, known = self._reduced[level]
        to_view = cv2.getPerspectiveTransform(
            (source / (1 << level)).astype(np.float32), at_px.astype(np.float32)
        )
        warped = cv2.warpPerspective(pixels, to_view, size, borderMode=cv2.BORDER_REPLICATE)
        mask = cv2.warpPerspective(known, to_view, size, borderMode=cv2.BORDER_CONSTANT)
        return np.asarray(warped, dtype=np.uint8), np.asarray(mask, dtype=np.uint8)
