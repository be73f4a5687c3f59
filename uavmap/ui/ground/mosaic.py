"""The mosaic of an earlier flight as a map beneath: mosaic.webp, with its place beside it."""

from __future__ import annotations

from pathlib import Path

from pyproj import Transformer
from pyproj.exceptions import CRSError

from missions.errors import OutputError
from uavmap.output.drawing.mosaic_file import read_mosaic
from uavmap.ui.ground.warped import Points, encode_tile, levels_of, tile_nodes, warp_tile


class Mosaic:
    """A mosaic of a results folder. Raises `OutputError` for another file."""

    attribution = ""

    def __init__(self, path: Path) -> None:
        found = read_mosaic(path.parent)
        if found is None:
            raise OutputError(f"{path}: not the mosaic of a flight with its place beside it")
        self._found = found
        try:
            self._to_utm = Transformer.from_crs("EPSG:4326", f"EPSG:{found.epsg}", always_xy=True)
        except CRSError as error:
            raise OutputError(f"{path}: its place is in EPSG:{found.epsg}: {error}") from None
        rows, columns = found.image.shape[:2]
        lon, lat = self._to_utm.transform(
            found.west + found.step * columns / 2,
            found.north - found.step * rows / 2,
            direction="INVERSE",
        )
        self.middle = lat, lon
        self.zooms = levels_of(self._pixels, self.middle)

    def _pixels(self, lon: Points, lat: Points) -> tuple[Points, Points]:
        east, north = self._to_utm.transform(lon, lat)
        found = self._found
        return (east - found.west) / found.step, (found.north - north) / found.step

    def tile(self, zoom: int, x: int, y: int) -> bytes | None:
        """Return a tile; None if no picture shows its ground."""
        return encode_tile(warp_tile(self._found.image, tile_nodes(self._pixels, zoom, x, y)))

    def close(self) -> None:
        """Do nothing: the file was read completely."""
