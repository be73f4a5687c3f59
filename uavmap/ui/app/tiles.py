"""Tiles of a map from an MBTiles file, for Leaflet."""

from __future__ import annotations

import contextlib
import math
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Final

from missions.errors import OutputError

PICTURES: Final = {b"\x89PNG": "image/png", b"\xff\xd8\xff": "image/jpeg", b"RIFF": "image/webp"}
MOST_BYTES: Final = 1 << 20


class Tiles:
    """An MBTiles file of pictures. Raises `OutputError` for another file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            with closing(self._open()) as database:
                found = database.execute(
                    "SELECT zoom_level, avg(tile_column), avg(tile_row) FROM tiles "
                    "GROUP BY zoom_level ORDER BY zoom_level DESC LIMIT 1"
                ).fetchone()
                said = dict(database.execute("SELECT name, value FROM metadata"))
        except sqlite3.Error as error:
            raise OutputError(f"--tiles {path}: cannot be read as MBTiles: {error}") from None
        if said.get("format") == "pbf":
            raise OutputError(f"--tiles {path}: holds vector tiles; tiles of pictures are shown")
        if found is None:
            raise OutputError(f"--tiles {path}: holds no tile")
        self.zoom, column, row = int(found[0]), float(found[1]) + 0.5, float(found[2]) + 0.5
        north = math.pi * (2.0 * row / 2**self.zoom - 1.0)  # rows are counted from the south
        self.middle = (
            math.degrees(math.atan(math.sinh(north))), 360.0 * column / 2**self.zoom - 180.0
        )  # fmt: skip
        """Latitude and longitude, degrees."""
        self.attribution = str(said.get("attribution", ""))

    def _open(self) -> sqlite3.Connection:
        return sqlite3.connect(f"{self.path.absolute().as_uri()}?mode=ro", uri=True)

    def tile(self, zoom: int, x: int, y: int) -> tuple[bytes, str] | None:
        """Return a tile and its type, rows counted from the north; None where there is none."""
        found = None
        with contextlib.suppress(sqlite3.Error), closing(self._open()) as database:
            found = database.execute(
                "SELECT tile_data FROM tiles "
                "WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?",
                (zoom, x, 2**zoom - 1 - y),
            ).fetchone()
        data = found[0] if found else None
        if not isinstance(data, bytes) or len(data) > MOST_BYTES:
            return None
        kinds = (kind for head, kind in PICTURES.items() if data.startswith(head))
        return next(((data, kind) for kind in kinds), None)
