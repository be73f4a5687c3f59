"""Patterns for the ground: square tiles of gray levels that continue at their own far edge.

A tile covers `TILE_M` metres; the arrays hold it twice in each direction.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

Gray: TypeAlias = npt.NDArray[np.uint8]

METRES_PER_PIXEL = 0.05
TILE_PX = 1024
TILE_M = METRES_PER_PIXEL * TILE_PX

_LARGEST_M = 12.0  # coarsest structure of a tile
_GAP_M = 0.14  # width of a bare spot in the grass
_GAPS_PER_M2 = 0.25
_GAP_DEPTH = 0.42  # a bare spot's darkening at its centre, of the ground's brightness


@lru_cache(maxsize=4)  # worlds of one seed, one after the other
def ground_tile(seed: tuple[int, ...], mean: float, std: float) -> Gray:
    """Meadow: `mean` and `std` in gray levels, with small dark bare spots. Not to be written to.

    The spots fall below what separates ROI from ground, as real grass does: a detector has to
    close them (the paper dilates).
    """
    rng = np.random.default_rng(seed)
    tile = mean + std * _fractal(rng, slope=0.75)
    tile -= mean * _GAP_DEPTH * _spots(rng)
    return _twice(tile)


@lru_cache(maxsize=4)
def roi_tile(seed: tuple[int, ...], mean: float, std: float) -> Gray:
    """Asphalt or oil: `mean` and `std` in gray levels, without spots. Not to be written to."""
    rng = np.random.default_rng(seed)
    return _twice(mean + std * _fractal(rng, slope=0.6))


def _twice(tile: npt.NDArray[np.float64]) -> Gray:
    """As gray levels, repeated twice in both directions: see `sitl.camera.render`."""
    twice = np.tile(np.clip(np.round(tile), 0, 255).astype(np.uint8), (2, 2))
    twice.setflags(write=False)
    return twice


def _fractal(rng: np.random.Generator, slope: float) -> npt.NDArray[np.float64]:
    """Noise of unit variance whose amplitude falls with frequency to the power `slope`.

    The discrete Fourier transform is periodic, therefore so is the tile.
    """
    white = np.fft.rfft2(rng.standard_normal((TILE_PX, TILE_PX)))
    fy = np.fft.fftfreq(TILE_PX, METRES_PER_PIXEL)[:, None]
    fx = np.fft.rfftfreq(TILE_PX, METRES_PER_PIXEL)[None, :]
    cycles_per_m = np.hypot(fx, fy)
    shaped = np.fft.irfft2(white / np.maximum(cycles_per_m, 1.0 / _LARGEST_M) ** slope)
    shaped -= shaped.mean()
    return np.asarray(shaped / shaped.std(), dtype=np.float64)


def _spots(rng: np.random.Generator) -> npt.NDArray[np.float64]:
    """Gaussian spots of height 1 at random places, wrapped around the edges."""
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
