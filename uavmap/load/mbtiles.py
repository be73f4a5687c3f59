"""Tiles of a map from an MBTiles file, of pictures; rows are counted from the north here."""

from __future__ import annotations

import math
import sqlite3
from pathlib import Path
from typing import Final

from missions.errors import OutputError

KINDS: Final = {b"\x89PNG": "png", b"\xff\xd8\xff": "jpg", b"RIFF": "webp"}
"""Formats by MBTiles' names."""
MOST_BYTES: Final = 8 << 20


def kind_of(data: bytes) -> str | None:
    """Return the format of a tile; None for no picture."""
    return next((kind for head, kind in KINDS.items() if data.startswith(head)), None)


class Tiles:
    """An MBTiles file of pictures, open for reading. Raises `OutputError` for another file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            uri = f"{path.absolute().as_uri()}?mode=ro"
            self._database = sqlite3.connect(uri, uri=True, check_same_thread=False)
            said = dict(self._database.execute("SELECT name, value FROM metadata"))
            asked = "SELECT min(zoom_level), max(zoom_level) FROM tiles"
            low, high = self._database.execute(asked).fetchone()
        except (sqlite3.Error, UnicodeError, ValueError) as error:
            raise OutputError(f"{path}: cannot be read as MBTiles: {error}") from None
        if said.get("format") == "pbf":
            raise OutputError(f"{path}: holds vector tiles; tiles of pictures are shown")
        if low is None:
            raise OutputError(f"{path}: holds no tile")
        self.zooms = range(int(low), int(high) + 1)
        self.attribution = str(said.get("attribution", ""))

    def close(self) -> None:
        """Close the file."""
        self._database.close()

    @property
    def middle(self) -> tuple[float, float]:
        """Latitude and longitude of the middle of its finest tiles, degrees."""
        zoom = self.zooms[-1]
        column, row = self._database.execute(
            "SELECT avg(tile_column), avg(tile_row) FROM tiles WHERE zoom_level = ?", (zoom,)
        ).fetchone()
        north = math.pi * (2.0 * (row + 0.5) / 2**zoom - 1.0)  # the file counts from the south
        return math.degrees(math.atan(math.sinh(north))), 360.0 * (column + 0.5) / 2**zoom - 180.0

    def tile(self, zoom: int, x: int, y: int) -> bytes | None:
        """Return a tile; None where there is none that is a picture."""
        asked = (
            "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?"
        )
        try:
            found = self._database.execute(asked, (zoom, x, 2**zoom - 1 - y)).fetchone()
        except (sqlite3.Error, OverflowError):
            return None
        data = found[0] if found else None
        good = isinstance(data, bytes) and len(data) <= MOST_BYTES and kind_of(data) is not None
        return data if good else None
