"""What a map beneath has to give, and which class reads a file.

Tiles are those of the web: Web Mercator, counted from the world's upper left corner.
"""

from __future__ import annotations

import math
from importlib import import_module
from pathlib import Path
from typing import Final, Protocol

from missions.errors import OutputError
from missions.units import LatLon

_CLASSES: Final = {
    ".mbtiles": ("uavmap.load.mbtiles", "Tiles"),
    ".pmtiles": ("uavmap.ui.ground.pmtiles_file", "PMTiles"),
    ".tif": ("uavmap.ui.ground.geotiff", "GeoTiff"),
    ".tiff": ("uavmap.ui.ground.geotiff", "GeoTiff"),
    ".webp": ("uavmap.ui.ground.mosaic", "Mosaic"),
}
ENDINGS: Final = tuple(_CLASSES)


class GroundLayer(Protocol):
    """An open file of pictures of the ground."""

    zooms: range
    """Levels at which it has tiles; finer ones would show nothing more."""
    attribution: str
    """What has to stand beside its map; may be empty."""

    @property
    def middle(self) -> tuple[float, float]:
        """Latitude and longitude of its middle, degrees."""

    def tile(self, zoom: int, x: int, y: int) -> bytes | None:
        """Return a tile as PNG, JPEG or WebP; None where it shows nothing."""

    def close(self) -> None:
        """Close the file."""


def opened(path: Path) -> GroundLayer:
    """Open a file by its ending. Raises `OutputError` for one that shows no ground."""
    module, name = _CLASSES.get(path.suffix.lower(), ("", ""))
    if not module:
        raise OutputError(f"{path}: is no map; give {', '.join(ENDINGS)}")
    layer: GroundLayer = getattr(import_module(module), name)(path)
    return layer


def place_in_tiles(place: LatLon, zoom: int) -> tuple[float, float]:
    """Return where a place is, in tiles of a level from the world's upper left corner.

    >>> place_in_tiles(LatLon(0.0, 0.0), 1)
    (1.0, 1.0)
    """
    y = math.asinh(math.tan(math.radians(place.lat_deg))) / math.pi
    return (place.lon_deg / 360.0 + 0.5) * 2**zoom, (0.5 - 0.5 * y) * 2**zoom


def shows(layer: GroundLayer, place: LatLon) -> bool:
    """Return whether a layer has a tile with a place in it."""
    zoom = layer.zooms[-1]
    x, y = place_in_tiles(place, zoom)
    return layer.tile(zoom, math.floor(x), math.floor(y)) is not None
