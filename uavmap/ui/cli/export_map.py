"""uavmap export --to: the map of a results folder, and its flight, as files for a GIS."""

from __future__ import annotations

import argparse
import errno
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from missions.errors import OutputError, UavmapError
from uavmap.base.atomic_write import write_bytes
from uavmap.journal.flight_plan import JOURNAL
from uavmap.output.documents import refuse_open
from uavmap.output.facts.flown_mission import Flown
from uavmap.output.formats.exports import FORMATS, Format, files_of
from uavmap.output.results_reading import flown_of

_OF_PLANS = ("plan", "waypoints", "vehicle")


def add_map_options(parser: Any) -> None:
    """Add the options."""
    parser.add_argument(
        "--to",
        choices=list(FORMATS),
        help="of results: region, cells, tracks, frames and fence as a GeoPackage (gpkg), "
        "Shapefiles (shp), GeoJSON, KML with times, GPX or CSV",
    )
    parser.add_argument(
        "--out",
        metavar="PATH",
        type=Path,
        help="with --to: the file, of shp, geojson and csv a folder (default: in the folder of "
        "the results)",
    )


def export_map(options: argparse.Namespace, say: Callable[[str], None]) -> int:
    """Write the files. Raises `UavmapError`."""
    _check(options)
    folder = Path(options.source)
    flown, made = flown_of(folder), FORMATS[options.to]
    tell_incomplete(flown, say)
    files = files_of(flown, options.to)
    out: Path | None = options.out
    if out is None:
        target = folder / made.name if made.several else folder
        shown = folder / made.name
    else:
        shown, target = out, out if made.several else out.parent
        files = files if made.several else dict.fromkeys([out.name], *files.values())
        _overwrite_nothing(out, files, made)
    for name in files:
        refuse_open(target / name)
    _write(target, files, made)
    say(f"{shown}{os.sep if made.several else ''} ({_counted(files, made)})")
    return 0


def tell_incomplete(flown: Flown, say: Callable[[str], None]) -> None:
    """Say where a map is not all of it."""
    if not flown.completed:
        say(
            f"{flown.folder}: the mission is not complete; this is its map so far, at mission time "
            f"{flown.data.t_s:.0f} s"
        )


def _check(options: argparse.Namespace) -> None:
    if options.to is None:
        raise UavmapError("--out goes with --to FORMAT; a plan is named by --plan")
    for name in _OF_PLANS:
        if getattr(options, name) is not None:
            raise UavmapError(f"--{name.replace('_', '-')} is for a plan; leave it out with --to")
    if options.above_sea:
        raise UavmapError("--above-sea is for a plan; leave it out with --to")
    folder = Path(options.source)
    if not folder.is_dir():
        raise UavmapError(
            f"{options.source}: --to is for a results folder with a {JOURNAL}, and this is none; "
            "of a mission --plan and --waypoints can be written"
        )


def _overwrite_nothing(out: Path, files: Mapping[str, bytes], made: Format) -> None:
    if not made.several:
        if out.exists():
            raise OutputError(f"--out {out}: is there already; choose another name")
        return
    if out.exists() and not out.is_dir():
        raise OutputError(f"--out {out}: is a file; give a folder")
    for name in files:
        if (out / name).exists():
            raise OutputError(f"--out {out}: holds a {name} already; choose another folder")


def _write(target: Path, files: Mapping[str, bytes], made: Format) -> None:
    path = target
    try:
        if made.several:
            target.mkdir(parents=True, exist_ok=True)
        elif not target.is_dir():
            raise FileNotFoundError(errno.ENOENT, f"there is no folder {target}")
        for name, data in files.items():
            path = target / name
            write_bytes(path, data)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror})") from None


def _counted(files: Mapping[str, bytes], made: Format) -> str:
    size = sum(map(len, files.values())) / 1000.0
    return f"{len(files)} files, {size:,.0f} kB" if made.several else f"{size:,.0f} kB"
