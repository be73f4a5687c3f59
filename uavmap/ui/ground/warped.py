"""Tiles of a picture of the ground in any projection."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.geo.web_mercator import lat_lon_of

Colours = NDArray[np.uint8]
"""Red, green, blue, and 255 where there is ground, shape (rows, columns, 4)."""
Points = NDArray[np.float64]
Pixels = Callable[[Points, Points], tuple[Points, Points]]
"""Function from longitudes and latitudes, degrees, to columns and rows of a picture, px."""
SIDE_PX: Final = 256
FINEST: Final = 24
COARSER: Final = 8
"""Number of levels that are coarser than the pixels of a picture."""
_NODES: Final = 17
"""Number of points on each side for which the projection is computed; linear between them."""
_JPEG_QUALITY: Final = 85


def tile_nodes(pixels: Pixels, zoom: int, x: int, y: int) -> Points:
    """Return columns and rows of a picture at the nodes of a tile, shape (2, n, n)."""
    steps = np.linspace(0.0, 1.0, _NODES)
    across, down = (x + steps) / 2**zoom, (y + steps) / 2**zoom
    lat, lon = lat_lon_of(*np.meshgrid(across, down))
    return np.array(pixels(lon, lat))


def levels_of(pixels: Pixels, middle: tuple[float, float]) -> range:
    """Return the levels of a picture; the finest shows all its pixels."""
    lat, lon = middle
    away = 1e-5  # degrees
    (left, right), (low, high) = pixels(np.array([lon, lon + away]), np.array([lat, lat]))
    a_degree = math.hypot(right - left, high - low) / away
    fine = math.log2(max(a_degree * 360.0 / SIDE_PX, 1.0)) if math.isfinite(a_degree) else 0.0
    finest = min(math.ceil(fine - 0.1), FINEST)
    return range(max(finest - COARSER, 0), finest + 1)


def warp_tile(image: Colours, nodes: Points) -> Colours:
    """Return a tile of a picture; `nodes` are its px, as from `tile_nodes`."""
    columns, rows = (_between(each) for each in nodes)
    tile = cv2.remap(image, columns - 0.5, rows - 0.5, cv2.INTER_LINEAR, borderValue=(0, 0, 0, 0))
    return np.asarray(tile, np.uint8)


def _between(nodes: Points) -> NDArray[np.float32]:
    """Return the values at the centres of a tile's pixels from those at its nodes."""
    at = ((np.arange(SIDE_PX) + 0.5) / SIDE_PX * (_NODES - 1)).astype(np.float32)
    found = cv2.remap(nodes.astype(np.float32), *np.meshgrid(at, at), cv2.INTER_LINEAR)
    return np.asarray(found, np.float32)


def encode_tile(tile: Colours) -> bytes | None:
    """Return a tile as JPEG, or as PNG if it has gaps; None if it shows no ground."""
    there = tile[..., 3]
    if not there.any():
        return None
    if there.min() == 255:
        quality = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
        return cv2.imencode(".jpg", tile[..., 2::-1], quality)[1].tobytes()
    return cv2.imencode(".png", cv2.cvtColor(tile, cv2.COLOR_RGBA2BGRA))[1].tobytes()
