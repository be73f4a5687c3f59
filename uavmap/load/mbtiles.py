"""Pictures of a map from an MBTiles file; here rows are counted from the north."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Final

from missions.errors import OutputError
from missions.geo.web_mercator import lat_lon_of

KINDS: Final = {b"\x89PNG": "png", b"\xff\xd8\xff": "jpg", b"RIFF": "webp"}
"""Formats of pictures, by the first bytes, with MBTiles' names."""
MAX_BYTES: Final = 8 << 20
MAX_ZOOM: Final = 30


def kind_of(data: bytes) -> str | None:
    """Return the format of a tile; None if it is not a picture."""
    return next((kind for head, kind in KINDS.items() if data.startswith(head)), None)


class Tiles:
    """An MBTiles file of pictures, open for reading. Raises `OutputError` for another file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            uri = f"{path.absolute().as_uri()}?mode=ro"
            self._database = sqlite3.connect(uri, uri=True, check_same_thread=False)
            metadata = dict(self._database.execute("SELECT name, value FROM metadata"))
            low, high = (  # two queries: each reads one end of the index, one query reads it all
                self._database.execute(f"SELECT {end}(zoom_level) FROM tiles").fetchone()[0]
                for end in ("min", "max")
            )
        except (sqlite3.Error, UnicodeError, ValueError) as error:
            raise OutputError(f"{path}: cannot be read as MBTiles: {error}") from None
        if metadata.get("format") == "pbf":
            raise OutputError(f"{path}: holds vector tiles; use a file with tiles of pictures")
        if low is None:
            raise OutputError(f"{path}: holds no tile")
        if not (isinstance(low, int) and isinstance(high, int) and 0 <= low <= high <= MAX_ZOOM):
            raise OutputError(f"{path}: has tiles of levels {low} to {high}; at most {MAX_ZOOM}")
        self.zooms = range(low, high + 1)
        self.attribution = str(metadata.get("attribution", ""))

    def close(self) -> None:
        """Close the file."""
        self._database.close()

    @property
    def middle(self) -> tuple[float, float]:
        """Return latitude and longitude of the middle of its finest tiles, degrees.

        Raises `OutputError` for a file that is damaged there.
        """
        zoom = self.zooms[-1]
        asked = "SELECT avg(tile_column), avg(tile_row) FROM tiles WHERE zoom_level = ?"
        try:
            column, row = self._database.execute(asked, (zoom,)).fetchone()
            right, up = (column + 0.5) / 2**zoom, (row + 0.5) / 2**zoom
        except (sqlite3.Error, UnicodeError, TypeError) as error:
            raise OutputError(f"{self.path}: cannot be read as MBTiles: {error}") from None
        if not (0.0 <= right <= 1.0 and 0.0 <= up <= 1.0):
            raise OutputError(f"{self.path}: its tiles of level {zoom} lie beyond the map")
        lat, lon = lat_lon_of(right, 1.0 - up)  # the file counts from the south
        return float(lat), float(lon)

    def tile(self, zoom: int, x: int, y: int) -> bytes | None:
        """Return a tile; None if the file has none there, or one that is not a picture."""
        asked = (
            "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?"
        )
        try:
            found = self._database.execute(asked, (zoom, x, 2**zoom - 1 - y)).fetchone()
        except (sqlite3.Error, OverflowError):
            return None
        data = found[0] if found else None
        good = isinstance(data, bytes) and len(data) <= MAX_BYTES and kind_of(data) is not None
        return data if good else None
