"""Tiles of an online map for the field: fetched once, one after the other, into an MBTiles file.

Web Mercator tiles of at least 256 px, by MBTiles 1.3: rows are counted from the south. An existing
file receives the tiles that it lacks.
"""

from __future__ import annotations

import math
import sqlite3
import urllib.error
import urllib.request
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple
from urllib.parse import urlsplit

import numpy as np

from missions.errors import LinkError, OutputError
from missions.geo.web_mercator import share_of
from missions.units import LatLon
from uavmap.base.version import __version__
from uavmap.load.mbtiles import kind_of

AROUND: Final = 0.2
MIN_AROUND_M: Final = 150.0
"""Ground around an area that is fetched as well: a share of its extent, and its minimum, m."""
FINEST: Final = 22
MAX_TILES: Final = 5000
MAX_BYTES: Final = 1 << 20
TIMEOUT_S: Final = 20.0
TRIES: Final = 3
MAX_LATITUDE_DEG: Final = 85.0
_M_PER_DEG: Final = 111_320.0


class Tile(NamedTuple):
    """A tile; rows are counted from the north."""

    zoom: int
    x: int
    y: int


@dataclass(frozen=True, slots=True)
class Bounds:
    """A rectangle in degrees, WGS84."""

    west: float
    south: float
    east: float
    north: float

    @classmethod
    def around(cls, places: Sequence[LatLon]) -> Bounds:
        """Return the rectangle around some places and the ground around them.

        >>> found = Bounds.around([LatLon(47.0, 8.0), LatLon(47.01, 8.01)])
        >>> round(found.south, 3), round(found.north, 3)
        (46.998, 47.012)
        """
        lats, lons = [p.lat_deg for p in places], [p.lon_deg for p in places]
        wide = math.cos(math.radians(max(map(abs, lats))))
        more_lat = max(AROUND * (max(lats) - min(lats)), MIN_AROUND_M / _M_PER_DEG)
        more_lon = max(AROUND * (max(lons) - min(lons)), MIN_AROUND_M / _M_PER_DEG / wide)
        return cls(min(lons) - more_lon, max(min(lats) - more_lat, -MAX_LATITUDE_DEG),
                   max(lons) + more_lon, min(max(lats) + more_lat, MAX_LATITUDE_DEG))  # fmt: skip

    def tiles(self, zoom: int) -> list[Tile]:
        """Return the tiles of a zoom level that show any of it."""
        across, down = share_of((self.north, self.south), (self.west, self.east))
        left, right = np.floor(across * 2**zoom).astype(int).tolist()
        top, bottom = np.floor(down * 2**zoom).astype(int).clip(0, 2**zoom - 1).tolist()
        return [
            Tile(zoom, x % 2**zoom, y)
            for x in range(left, right + 1)
            for y in range(top, bottom + 1)
        ]


@dataclass(frozen=True, slots=True)
class Source:
    """An XYZ source of tiles, and the attribution that its map shows.

    Raises `LinkError` for a URL without the places of a tile.
    """

    url: str
    attribution: str

    def __post_init__(self) -> None:
        if urlsplit(self.url).scheme not in ("http", "https"):
            raise LinkError(f"--source {self.url}: give a URL that begins with https://")
        if missing := [part for part in ("{z}", "{x}", "{y}") if part not in self.url]:
            raise LinkError(
                f"--source {self.url}: has no {missing[0]}; a source of tiles is written as "
                "https://HOST/{z}/{x}/{y}.png"
            )

    def fetched(self, tile: Tile) -> bytes:
        """Fetch a tile. Raises `LinkError` if the source does not send it."""
        url = self.url.replace("{z}", str(tile.zoom)).replace("{x}", str(tile.x))
        url = url.replace("{y}", str(tile.y)).replace("{s}", "a")
        asked = urllib.request.Request(url, headers={"User-Agent": f"uavmap/{__version__}"})
        why = ""
        for _ in range(TRIES):
            try:
                with urllib.request.urlopen(asked, timeout=TIMEOUT_S) as answer:
                    data: bytes = answer.read(MAX_BYTES + 1)
            except urllib.error.HTTPError as error:
                raise LinkError(f"{url}: the source answers {error.code} {error.reason}") from None
            except (OSError, ValueError) as error:
                why = str(getattr(error, "reason", error))
                continue
            if len(data) > MAX_BYTES or kind_of(data) is None:
                raise LinkError(f"{url}: is not a picture (PNG, JPEG or WebP)")
            return data
        raise LinkError(f"{url}: cannot be fetched: {why}")


def tiles_in(bounds: Bounds, zooms: range) -> list[Tile]:
    """Return the tiles of an area, coarse ones first. Raises `OutputError` for too many."""
    counts = {zoom: len(bounds.tiles(zoom)) for zoom in zooms}
    if (total := sum(counts.values())) > MAX_TILES:
        fits = [z for z in zooms if sum(counts[k] for k in zooms if k <= z) <= MAX_TILES]
        remedy = f"--zoom {zooms[0]}-{fits[-1]} has fewer" if fits else "name a smaller area"
        raise OutputError(
            f"--zoom {zooms[0]}-{zooms[-1]}: {total} tiles; at most {MAX_TILES} are fetched; "
            f"{remedy}"
        )
    return [tile for zoom in zooms for tile in bounds.tiles(zoom)]


def fetch(
    source: Source, tiles: Sequence[Tile], bounds: Bounds, out: Path, report: Callable[[int], None]
) -> int:
    """Fetch the tiles that a file lacks; return their number.

    Each tile is written as soon as it is fetched; then `report` receives the number of tiles in the
    file. Raises `LinkError`; `OutputError` for a file that is not MBTiles, or of another source.
    """
    try:
        with closing(sqlite3.connect(out)) as database:
            has = _begun(database, source, tiles, bounds, out)
            missing = [tile for tile in tiles if tile not in has]
            for number, tile in enumerate(missing, 1):
                data = source.fetched(tile)
                with database:
                    _insert(database, tile, data)
                report(len(tiles) - len(missing) + number)
            return len(missing)
    except sqlite3.Error as error:
        raise OutputError(f"{out}: cannot be written as MBTiles: {error}") from None


def _begun(
    database: sqlite3.Connection, source: Source, tiles: Sequence[Tile], bounds: Bounds, out: Path
) -> set[Tile]:
    """Create the tables that do not exist; return the tiles in the file."""
    with database:
        database.execute("CREATE TABLE IF NOT EXISTS metadata (name TEXT PRIMARY KEY, value TEXT)")
        database.execute(
            "CREATE TABLE IF NOT EXISTS tiles (zoom_level INTEGER, tile_column INTEGER, "
            "tile_row INTEGER, tile_data BLOB, PRIMARY KEY (zoom_level, tile_column, tile_row))"
        )
        metadata = dict(database.execute("SELECT name, value FROM metadata"))
        if metadata.get("source", source.url) != source.url:
            raise OutputError(f"{out}: holds tiles of {metadata['source']}; choose another file")
        low, high = tiles[0].zoom, tiles[-1].zoom
        rows = {
            "name": out.stem, "type": "baselayer", "version": "1", "source": source.url,
            "description": f"tiles of {source.url}", "attribution": source.attribution,
            "bounds": f"{bounds.west:.6f},{bounds.south:.6f},{bounds.east:.6f},{bounds.north:.6f}",
            "minzoom": str(min(low, int(metadata.get("minzoom", low)))),
            "maxzoom": str(max(high, int(metadata.get("maxzoom", high)))),
        }  # fmt: skip
        database.executemany("INSERT OR REPLACE INTO metadata VALUES (?, ?)", rows.items())
    asked = database.execute("SELECT zoom_level, tile_column, tile_row FROM tiles")
    return {Tile(zoom, x, 2**zoom - 1 - row) for zoom, x, row in asked}


def _insert(database: sqlite3.Connection, tile: Tile, data: bytes) -> None:
    row = 2**tile.zoom - 1 - tile.y
    database.execute("INSERT OR REPLACE INTO tiles VALUES (?, ?, ?, ?)",
                     (tile.zoom, tile.x, row, data))  # fmt: skip
    database.execute("INSERT OR REPLACE INTO metadata VALUES ('format', ?)", (kind_of(data),))
