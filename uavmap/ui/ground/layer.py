"""The interface of a map beneath, and the class for each kind of file.

Tiles are in Web Mercator, counted from the upper left corner of the world.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Final, Protocol

from missions.errors import OutputError

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
    """Levels at which it has tiles; finer ones would show no more detail."""
    attribution: str
    """Text about its source, shown beside the map; may be empty."""

    @property
    def middle(self) -> tuple[float, float]:
        """Latitude and longitude of its centre, degrees."""

    def tile(self, zoom: int, x: int, y: int) -> bytes | None:
        """Return a tile as PNG, JPEG or WebP; None if it shows no ground."""

    def close(self) -> None:
        """Close the file."""


def open_layer(path: Path) -> GroundLayer:
    """Open a map by the ending of its name. Raises `OutputError` for another file."""
    module, name = _CLASSES.get(path.suffix.lower(), ("", ""))
    if not module:
        raise OutputError(f"{path}: not a map; give {', '.join(ENDINGS)}")
    layer: GroundLayer = getattr(import_module(module), name)(path)
    return layer
