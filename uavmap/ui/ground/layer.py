"""What a map beneath has to give, and which class reads a file.

Tiles are those of the web: Web Mercator, counted from the world's upper left corner.
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
