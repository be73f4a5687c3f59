"""uavmap tiles: save an online map in a file for the field."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import Final

from missions.mission.schema import positions
from missions.units import LatLon
from uavmap.base.terminal import Terminal
from uavmap.load.areas.reading import read_area_file
from uavmap.load.map_tiles import FINEST, Bounds, Source, fetch, tiles_in
from uavmap.load.mission_source import load, shipped_missions

EXAMPLES: Final = """\
  uavmap tiles field.toml --out field.mbtiles --source https://HOST/{z}/{x}/{y}.png \\
               --attribution "(c) the source of the map"
  uavmap tiles field.kml --out field.mbtiles --source URL --attribution TEXT --zoom 15-18
  uavmap app --tiles field.mbtiles                       the map beneath your drawings
  uavmap fly field.toml --connect URL --page --tiles field.mbtiles     and beneath the flight
"""
NOTES: Final = """\
Only this command uses the internet, and only the source that you name. Read the terms of the
source: some do not allow to save tiles. The command fetches one tile after the other. If you run it
again, it fetches the tiles that the file lacks.
"""
DESCRIPTION: Final = "Save the tiles of an online map around an area in one file, for the field."
SHOW_EVERY: Final = 50
"""Number of tiles between two lines of progress."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    add = parser.add_argument
    add("area", metavar="AREA", help="a mission file, a shipped mission, or a file with an area")
    add("--out", metavar="FILE.mbtiles", type=Path, required=True, help="the file for the tiles")
    add("--source", metavar="URL", required=True,
        help="the URL of the tiles, with {z}, {x} and {y}")  # fmt: skip
    add("--attribution", metavar="TEXT", required=True,
        help="the text that the map shows about its source")  # fmt: skip
    add("--zoom", metavar="LOW-HIGH", type=zooms, default=range(14, 20),
        help=f"the levels, 0 to {FINEST} (default 14-19: 0.2 m per pixel)")  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Fetch the tiles."""
    show, source = Terminal().show, Source(options.source, options.attribution)
    bounds = Bounds.around(places_of(options.area))
    tiles = tiles_in(bounds, options.zoom)
    show(f"{len(tiles)} tiles of {source.url} into {options.out}")

    def show_count(count: int) -> None:
        if count % SHOW_EVERY == 0:
            show(f"{count} of {len(tiles)} tiles")

    fetched = fetch(source, tiles, bounds, options.out, show_count)
    show(f"{fetched} tiles fetched, {len(tiles)} of {len(tiles)} are in {options.out}")
    return 0


def places_of(area: str) -> list[LatLon]:
    """Return the corners of a mission's fence, or of a drawing. Raises `UavmapError`."""
    if area in shipped_missions() or Path(area).suffix.lower() == ".toml":
        return list(positions(load(area).fence.polygon))
    drawing = read_area_file(area)
    return [place for one in (*drawing.areas, *drawing.fences) for place in one.ring]


def zooms(text: str) -> range:
    """Read levels such as `14-19`, or one level.

    >>> zooms("14-19"), zooms("16")
    (range(14, 20), range(16, 17))
    """
    found = re.fullmatch(r"(\d{1,2})(?:-(\d{1,2}))?", text)
    low = int(found[1]) if found else -1
    high = int(found[2] or low) if found else -1
    if not 0 <= low <= high <= FINEST:
        raise argparse.ArgumentTypeError(f"{text!r}: give levels such as 14-19, 0 to {FINEST}")
    return range(low, high + 1)
