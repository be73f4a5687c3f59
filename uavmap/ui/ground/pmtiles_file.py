"""A PMTiles file of pictures as a map beneath."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Final

from missions.errors import OutputError, UavmapError
from uavmap.base.extras import install_command
from uavmap.load.mbtiles import MAX_BYTES, MAX_ZOOM, kind_of

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
        with contextlib.ExitStack() as failing:
            failing.callback(self._file.close)
            try:
                self._reader = library.Reader(library.MmapSource(self._file))
                header, metadata = self._reader.header(), self._reader.metadata()
            except Exception as error:  # a damaged file makes the library raise errors of any class
                raise OutputError(f"{path}: cannot be read as PMTiles: {error!r}") from None
            if header["tile_type"].name == _VECTOR:
                raise OutputError(f"{path}: has vector tiles; give a file with tiles of pictures")
            low, high = header["min_zoom"], header["max_zoom"]
            if not low <= high <= MAX_ZOOM:
                raise OutputError(
                    f"{path}: has tiles of levels {low} to {high}; at most {MAX_ZOOM}"
                )
            south, north, west, east = (
                header[f"{side}_e7"] / 1e7 for side in ("min_lat", "max_lat", "min_lon", "max_lon")
            )
            self.middle = (south + north) / 2, (west + east) / 2
            if abs(self.middle[0]) > 90.0 or abs(self.middle[1]) > 180.0:
                raise OutputError(f"{path}: its bounds are no latitudes and longitudes")
            failing.pop_all()
        self.zooms = range(low, high + 1)
        known = isinstance(metadata, Mapping)
        self.attribution = str(metadata.get("attribution", "")) if known else ""

    def tile(self, zoom: int, x: int, y: int) -> bytes | None:
        """Return a tile; None if there is none, or it is not a picture."""
        try:
            data = self._reader.get(zoom, x, y)
        except Exception:  # the file is damaged
            return None
        return data if data and len(data) <= MAX_BYTES and kind_of(data) is not None else None

    def close(self) -> None:
        """Close the file."""
        self._file.close()
