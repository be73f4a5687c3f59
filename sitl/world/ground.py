"""The ground of a simulated world: its height, its patterns, a picture that lies on it.

Heights are in metres above the ground at the world's origin, in the plane's true east and north.
Patterns are square tiles of gray levels that wrap around: a tile covers `TILE_M` metres, and the
arrays hold it twice in each direction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TypeAlias

import cv2
import numpy as np
import numpy.typing as npt
import pyproj
from pyproj.exceptions import ProjError

from missions.errors import WorldError
from missions.units import LatLon

Numbers: TypeAlias = npt.NDArray[np.float64]
Matrix: TypeAlias = npt.NDArray[np.float64]
Gray: TypeAlias = npt.NDArray[np.uint8]
Picture: TypeAlias = npt.NDArray[np.uint8]

_RELIEF = 5  # keeps its stream of random numbers apart from those of `sitl.world.world`
_WAVES = 6


@dataclass(frozen=True, slots=True, eq=False)
class HeightField:
    """Measured heights on a lattice of the plane, bilinear; beyond its rim as on the rim.

    `heights_m[row, column]` is at (west_m + column * step_m, south_m + row * step_m).
    """

    west_m: float
    south_m: float
    step_m: float
    heights_m: Numbers


@dataclass(frozen=True)
class Relief:
    """A slope that rises towards a true bearing, smooth hills by seed, and measured heights.

    `slope` is a tangent. The hills are waves of `hills_long_m` and more, and of at most
    `hills_high_m` from the deepest valley to the highest top.
    """

    slope: float = 0.0
    rises_toward_deg: float = 0.0
    hills_high_m: float = 0.0
    hills_long_m: float = 100.0
    seed: int = 0
    field: HeightField | None = None

    @cached_property
    def _waves(self) -> list[tuple[float, float, float, float]]:
        """Amplitude, wave numbers along east and north, phase."""
        if self.hills_high_m <= 0.0:
            return []
        rng = np.random.default_rng([self.seed, _RELIEF])
        bearings = rng.uniform(0.0, math.tau, _WAVES)
        lengths = self.hills_long_m * np.geomspace(1.0, 2.0, _WAVES)
        phases = rng.uniform(0.0, math.tau, _WAVES)
        amplitude = self.hills_high_m / 2.0 / _WAVES
        return [
            (amplitude, math.tau / k * math.sin(b), math.tau / k * math.cos(b), p)
            for b, k, p in zip(bearings.tolist(), lengths.tolist(), phases.tolist(), strict=True)
        ]

    @cached_property
    def _origin_m(self) -> float:
        return sum(a * math.sin(p) for a, _, _, p in self._waves)

    @cached_property
    def _rise(self) -> tuple[float, float]:
        toward = math.radians(self.rises_toward_deg)
        return self.slope * math.sin(toward), self.slope * math.cos(toward)

    def height_m(self, east_m: float, north_m: float) -> float:
        """Return the height at one place."""
        rise_east, rise_north = self._rise
        height = east_m * rise_east + north_m * rise_north - self._origin_m
        for amplitude, k_east, k_north, phase in self._waves:
            height += amplitude * math.sin(k_east * east_m + k_north * north_m + phase)
        if self.field is not None:
            height += float(_bilinear(self.field, np.array(east_m), np.array(north_m)))
        return height

    def heights_m(self, east_m: Numbers, north_m: Numbers) -> Numbers:
        """Return the heights at many places: arrays of one shape."""
        rise_east, rise_north = self._rise
        height = east_m * rise_east + north_m * rise_north - self._origin_m
        for amplitude, k_east, k_north, phase in self._waves:
            height = height + amplitude * np.sin(k_east * east_m + k_north * north_m + phase)
        if self.field is not None:
            height = height + _bilinear(self.field, east_m, north_m)
        return np.asarray(height, dtype=np.float64)


def _bilinear(field: HeightField, east_m: Numbers, north_m: Numbers) -> Numbers:
    z = field.heights_m
    rows, columns = z.shape
    column = np.clip((east_m - field.west_m) / field.step_m, 0.0, columns - 1.0)
    row = np.clip((north_m - field.south_m) / field.step_m, 0.0, rows - 1.0)
    i = np.minimum(row.astype(np.intp), rows - 2)
    j = np.minimum(column.astype(np.intp), columns - 2)
    up, right = row - i, column - j
    south = z[i, j] * (1.0 - right) + z[i, j + 1] * right
    north = z[i + 1, j] * (1.0 - right) + z[i + 1, j + 1] * right
    return np.asarray(south * (1.0 - up) + north * up, dtype=np.float64)


METRES_PER_PIXEL = 0.05
TILE_PX = 1024
TILE_M = METRES_PER_PIXEL * TILE_PX

_LARGEST_M = 12.0  # coarsest structure of a tile
_GAP_M = 0.14  # width of a bare spot in the grass
_GAPS_PER_M2 = 0.25
_GAP_DEPTH = 0.42  # a bare spot's darkening at its centre, of the ground's brightness


@lru_cache(maxsize=4)  # worlds of one seed, one after the other
def ground_tile(seed: tuple[int, ...], mean: float, std: float) -> Gray:
    """Return a meadow of `mean` and `std` in gray levels, with small dark spots; read-only.

    The spots are darker than the threshold between ROI and ground, as in real grass: a detector
    has to close them (the paper dilates).
    """
    rng = np.random.default_rng(seed)
    tile = mean + std * _fractal(rng, slope=0.75)
    tile -= mean * _GAP_DEPTH * _spots(rng)
    return _twice(tile)


@lru_cache(maxsize=4)
def roi_tile(seed: tuple[int, ...], mean: float, std: float) -> Gray:
    """Return asphalt or oil of `mean` and `std` in gray levels, without spots; read-only."""
    rng = np.random.default_rng(seed)
    return _twice(mean + std * _fractal(rng, slope=0.6))


def _twice(tile: npt.NDArray[np.float64]) -> Gray:
    """Return gray levels, repeated twice in both directions (see `sitl.camera.render`)."""
    twice = np.tile(np.clip(np.round(tile), 0, 255).astype(np.uint8), (2, 2))
    twice.setflags(write=False)
    return twice


def _fractal(rng: np.random.Generator, slope: float) -> npt.NDArray[np.float64]:
    """Return periodic noise of unit variance; its amplitude falls with frequency to `slope`."""
    white = np.fft.rfft2(rng.standard_normal((TILE_PX, TILE_PX)))
    fy = np.fft.fftfreq(TILE_PX, METRES_PER_PIXEL)[:, None]
    fx = np.fft.rfftfreq(TILE_PX, METRES_PER_PIXEL)[None, :]
    cycles_per_m = np.hypot(fx, fy)
    shaped = np.fft.irfft2(white / np.maximum(cycles_per_m, 1.0 / _LARGEST_M) ** slope)
    shaped -= shaped.mean()
    return np.asarray(shaped / shaped.std(), dtype=np.float64)


def _spots(rng: np.random.Generator) -> npt.NDArray[np.float64]:
    """Return Gaussian spots of height 1 at random places, wrapped around the edges."""
    count = int(_GAPS_PER_M2 * TILE_M * TILE_M)
    field = np.zeros((TILE_PX, TILE_PX))
    rows, columns = rng.integers(0, TILE_PX, (2, count))
    radius_px = _GAP_M / METRES_PER_PIXEL / 2.0
    reach = int(3 * radius_px) + 1
    offsets = np.arange(-reach, reach + 1)
    bell = np.exp(-0.5 * (offsets / radius_px) ** 2)
    stamp = np.outer(bell, bell)
    for row, column in zip(rows, columns, strict=True):
        area = np.ix_((row + offsets) % TILE_PX, (column + offsets) % TILE_PX)
        field[area] = np.maximum(field[area], stamp)
    return field


_SMALLEST_PX = 32  # of a reduced picture


@dataclass(frozen=True, eq=False)
class Orthophoto:
    """Pixels (rows, columns, 3; blue-green-red) and where they lie.

    `to_crs` takes (column, row, 1), whole numbers at the centres of pixels, to coordinates of the
    system `epsg`, x east and y north. `known` is 255 where the picture has data, else 0.
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
        """Return where a pixel lies."""
        x, y, _ = self.to_crs @ (column, row, 1.0)
        lon, lat = self._to_wgs84.transform(x, y)
        return LatLon(float(lat), float(lon))

    def pixel(self, position: LatLon) -> tuple[float, float]:
        """Return column and row of a position, also outside the picture."""
        x, y = self._to_wgs84.transform(position.lon_deg, position.lat_deg, direction="INVERSE")
        column, row, _ = self._from_crs @ (x, y, 1.0)
        return float(column), float(row)

    def seen(
        self, corners: Sequence[LatLon], at_px: Matrix, size: tuple[int, int]
    ) -> tuple[Picture, Picture]:
        """Return a view of the ground, and 255 where it is known.

        `corners` are four places on the ground and `at_px` (4, 2) their pixels in the view of
        `size` (columns, rows). The four are projected exactly; between them the view follows the
        homography, which over a footprint is as good as the map projection.
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
