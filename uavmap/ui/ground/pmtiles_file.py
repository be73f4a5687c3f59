"""A PMTiles file of pictures as a map beneath."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Final

from missions.errors import OutputError, UavmapError
from uavmap.base.extras import install_command
from uavmap.load.mbtiles import MOST_BYTES, kind_of

_VECTOR: Final = "MVT"


class PMTiles:
    """A PMTiles file of pictures, open for reading. Raises `UavmapError` for another file."""

    def __init__(self, path: Path) -> None:
        try:
            library = import_module("pmtiles.reader")  # an extra
        except ImportError:
            raise UavmapError(f"{path}: PMTiles need pmtiles: {install_command('page')}") from None
        try:
            self._file = path.open("rb")
        except OSError as error:
            raise OutputError(f"{path}: cannot be read: {error.strerror}") from None
        try:
            self._reader = library.Reader(library.MmapSource(self._file))
            header, metadata = self._reader.header(), self._reader.metadata()
        except Exception as error:  # a damaged file makes the library raise errors of any class
            self._file.close()
            raise OutputError(f"{path}: cannot be read as PMTiles: {error!r}") from None
        if header["tile_type"].name == _VECTOR:
            self._file.close()
            raise OutputError(f"{path}: has vector tiles; give a file with tiles of pictures")
        self.zooms = range(header["min_zoom"], header["max_zoom"] + 1)
        self.attribution = str(metadata.get("attribution", ""))
        south, north, west, east = (
            header[f"{side}_e7"] / 1e7 for side in ("min_lat", "max_lat", "min_lon", "max_lon")
        )
        self.middle = (south + north) / 2, (west + east) / 2

    def tile(self, zoom: int, x: int, y: int) -> bytes | None:
        """Return a tile; None if there is none, or it is not a picture."""
        try:
            data = self._reader.get(zoom, x, y)
        except Exception:  # the file is damaged
            return None
        return data if data and len(data) <= MOST_BYTES and kind_of(data) is not None else None

    def close(self) -> None:
        """Close the file."""
        self._file.close()
