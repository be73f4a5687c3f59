"""Web Mercator, the projection of map tiles: shares of the world from its upper left corner.

A tile of level z is 1 / 2**z wide and high.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def share_of(lat_deg: ArrayLike, lon_deg: ArrayLike) -> tuple[Floats, Floats]:
    """Return how far places lie right of and below the upper left corner, shares of the world.

    >>> [float(share) for share in share_of(0.0, 90.0)]
    [0.75, 0.5]
    """
    north = np.arcsinh(np.tan(np.radians(lat_deg))) / math.tau
    return np.asarray(lon_deg, np.float64) / 360.0 + 0.5, np.asarray(0.5 - north)


def lat_lon_of(right: ArrayLike, down: ArrayLike) -> tuple[Floats, Floats]:
    """Return latitudes and longitudes, degrees, of shares of the world.

    >>> [float(degrees) for degrees in lat_lon_of(0.75, 0.5)]
    [0.0, 90.0]
    """
    north = math.tau * (0.5 - np.asarray(down, np.float64))
    return np.degrees(np.arctan(np.sinh(north))), 360.0 * np.asarray(right, np.float64) - 180.0
