"""A mission, loaded once: its file and the files that it names are read and checked."""

from __future__ import annotations

import contextlib
import difflib
import itertools
import json
import math
import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, Final

from missions.errors import MissionFileError
from missions.mission.checks import check
from missions.mission.schema import Mission, mission_of_tables, parse_fields, parse_toml
from missions.mission.sections import LATER, MAX_PRIOR_PLACES
from uavmap.base.text_files import read_text
from uavmap.load.areas.formats import SUFFIXES
from uavmap.load.areas.zones import with_zones
from uavmap.load.dem import LEVEL, with_ground
from uavmap.load.detector_source import (
    check_detector,
    detector_of_section,
    known_detectors,
    resolved_section,
)

LARGEST_BYTES: Final = 4_000_000
_MAX_NAMES: Final = 1000


def shipped_missions() -> list[str]:
    """Return the names of the shipped missions."""
    files = (resources.files("missions") / "shipped").iterdir()
    return sorted(f.name.removesuffix(".toml") for f in files if f.name.endswith(".toml"))


def load(name: str, detector: str | None = None) -> Mission:
    """Load a mission by its path, or by the name of a shipped one.

    The mission holds the content of the files that it names: `search.prior` (GeoJSON),
    `fence.zones`, `terrain.dem` (GeoTIFF). It has the checksum of `detector.model`.

    Args:
        name: Path of a mission file, or name of a shipped mission.
        detector: A folder of `uavmap tune` that replaces the mission's detector.

    Raises:
        MissionFileError: The mission has a fault; the message has file, line, key, value, remedy.
    """
    text, folder = _read(name)
    try:
        mission = _resolved(parse_toml(text, name), name, folder, detector)
        _check(mission, name)
        if mission.detector.model is not None:  # report a faulty model before anything begins
            with _named(name):
                detector_of_section(mission.detector)
    except MissionFileError as error:
        raise MissionFileError(with_lines(str(error), name, text)) from None
    return mission


def mission_of_text(text: str, source: str, *, zones: Sequence[str] = ()) -> Mission:
    """Check a mission from a text that is not a user's file and names no files.

    `zones` are files of zones for `fence.zones`. Raises as `load`.
    """
    mission = parse_fields(text, source)
    if zones:
        mission = with_zones(mission, zones, Path(), "--zones")
    _check(mission, source)
    return mission


def _check(mission: Mission, source: str) -> None:
    check(mission, source, detectors=(*known_detectors(), LATER))
    with _named(source):
        check_detector(mission.detector)


@contextlib.contextmanager
def _named(source: str) -> Iterator[None]:
    """Add the name of the file to messages of the block that lack it."""
    try:
        yield
    except MissionFileError as error:
        text = str(error)
        named_already = text.startswith("--detector ")
        raise MissionFileError(text if named_already else f"{source}: {text}") from None


def _resolved(tables: dict[str, Any], source: str, folder: Path, detector: str | None) -> Mission:
    """Create the mission of these tables, with the content of files in place of their paths."""
    prior, dem = _path_at(tables, "search", "prior"), _path_at(tables, "terrain", "dem")
    if prior is not None:
        where = f"{source}: search.prior = {prior!r}"
        tables["search"]["prior"] = prior_places(folder / prior, where)
    if dem is not None:
        tables["terrain"]["dem"] = LEVEL
    zones = _zone_files(tables)
    section = tables.get("detector")
    if section is None or isinstance(section, dict):
        other = None if detector is None else Path(detector)
        with _named(source):
            found = resolved_section(section, folder, other)
        tables |= {} if found is None else {"detector": found}
    mission = mission_of_tables(tables, source)
    if mission.sim.world:
        world = tuple(str((folder / path).resolve()) for path in mission.sim.world)
        mission = mission.model_copy(
            update={"sim": mission.sim.model_copy(update={"world": world})}
        )
    if dem is not None:
        mission = with_ground(mission, folder / dem, f"{source}: terrain.dem = {dem!r}")
    return with_zones(mission, zones, folder, f"{source}: fence.zones:") if zones else mission


def _zone_files(tables: Mapping[str, Any]) -> list[str]:
    """Remove the paths of zone files from the tables of a mission file, and return them."""
    fence = tables.get("fence")
    named = fence.get("zones") if isinstance(fence, dict) else None
    files = [named] if isinstance(named, str) else named
    if not isinstance(files, list) or not all(isinstance(file, str) for file in files):
        return []
    del tables["fence"]["zones"]
    return files


def _path_at(tables: Mapping[str, Any], section: str, key: str) -> str | None:
    table = tables.get(section)
    value = table.get(key) if isinstance(table, Mapping) else None
    return value if isinstance(value, str) else None


def _read(name: str) -> tuple[str, Path]:
    path = Path(name)
    if not path.suffix and name in shipped_missions() and not path.is_file():
        folder = Path(str(resources.files("missions"))) / "shipped"
        return (folder / f"{name}.toml").read_text("utf-8"), folder
    if path.suffix.lower() in SUFFIXES and path.is_file():
        raise MissionFileError(
            f"{name}: a drawing, not a mission; make one from it: uavmap new {shlex.quote(name)}"
        )
    try:
        return read_text(path, LARGEST_BYTES), path.parent
    except OSError as error:
        raise MissionFileError(
            f"{name}: cannot be read ({error.strerror}); {_guess(path)}give the path of a mission "
            f"file, or one of the shipped missions: {', '.join(shipped_missions())}"
        ) from None
    except UnicodeDecodeError:
        raise MissionFileError(f"{name}: not a text file in UTF-8") from None


def _guess(path: Path) -> str:
    known = {} if path.parent != Path() else {name: name for name in shipped_missions()}
    with contextlib.suppress(OSError):
        files = itertools.islice(path.parent.glob("*.toml"), _MAX_NAMES)
        known |= {file.name: str(file) for file in files}
    near = difflib.get_close_matches(path.name, known, n=1)
    return f"did you mean {known[near[0]]!r}? " if near else ""


# --- lines of keys -------------------------------------------------------------------------------
_HEADER: Final = re.compile(r"""\[\[?(\s*[A-Za-z_"'][\w."' -]*)\]\]?""")
_KEY: Final = re.compile(r"""[\w."' -]+""")
_LONGEST: Final = 500
"""Maximum characters of a line that are searched for a key: values may be long."""
_NAMED: Final = re.compile(r"[\w-]+(?:\[\d+\]|\.[\w-]+)*")
_QUOTES: Final = re.compile(r"""[\s"']""")


def with_lines(message: str, source: str, text: str) -> str:
    """Return the message with the key's line after the source's name, if the text has the key.

    A key within a value on several lines has the line on which that value begins.

    >>> with_lines("a.toml: grid.cell_m = 0: must be above 0", "a.toml", "[grid]\\ncell_m = 0")
    'a.toml:2: grid.cell_m = 0: must be above 0'
    """
    lines = _lines_of_keys(text)
    return "\n".join(_with_line(fault, source, lines) for fault in message.split("\n"))


def _with_line(fault: str, source: str, lines: dict[str, int]) -> str:
    found = _NAMED.match(fault, len(source) + 2) if fault.startswith(f"{source}: ") else None
    key = "" if found is None else found.group()
    while key and key not in lines:
        key = key[: max(key.rfind("."), key.rfind("["), 0)]
    return f"{source}:{lines[key]}{fault[len(source) :]}" if key else fault


def _lines_of_keys(text: str) -> dict[str, int]:
    """Return the first line of every key with its tables: `grid.cell_m`, `vehicles[1].url`."""
    lines: dict[str, int] = {}
    counts: dict[str, int] = {}
    table = ""
    for number, line in enumerate(text.split("\n"), 1):
        start = line[:_LONGEST].strip()
        if header := _HEADER.fullmatch(start.partition("#")[0].rstrip()):
            table = _QUOTES.sub("", header.group(1))
            lines.setdefault(table, number)
            if start.startswith("[["):
                counts[table] = counts.get(table, -1) + 1
                table = f"{table}[{counts[table]}]"
                lines.setdefault(table, number)
        elif _KEY.fullmatch(key := start.partition("=")[0]) and "=" in start:
            name = _QUOTES.sub("", key)
            lines.setdefault(f"{table}.{name}" if table else name, number)
    return lines


# --- the places of `search.prior` (GeoJSON) -------------------------------------------------------
_SHOWN: Final = 40
_NUMBERS = ("weight", "spread_m")


def prior_places(path: Path, where: str) -> list[dict[str, Any]]:
    """Read the places of a file for `search.prior`.

    Raises `MissionFileError`, which begins with `where`: mission file, key and value.
    """
    try:
        content = read_text(path, LARGEST_BYTES)
    except OSError as error:
        raise MissionFileError(
            f"{where}: cannot be read ({error.strerror}); give the path of a GeoJSON file from "
            "the folder of the mission file"
        ) from None
    except ValueError:  # not UTF-8, or a path with a null character
        raise MissionFileError(f"{where}: not a text file in UTF-8") from None
    return list(_places(content, where))


def _places(content: str, where: str) -> Iterator[dict[str, Any]]:
    try:
        root = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise MissionFileError(f"{where}: not JSON ({error})") from None
    features = root.get("features") if isinstance(root, dict) else None
    collection = isinstance(root, dict) and root.get("type") == "FeatureCollection"
    if not collection or not isinstance(features, list) or not features:
        raise MissionFileError(
            f"{where}: not a FeatureCollection with features; write each place as a feature with a "
            "Point or a Polygon"
        )
    if len(features) > MAX_PRIOR_PLACES:
        raise MissionFileError(
            f"{where}: {len(features)} features: at most {MAX_PRIOR_PLACES}; join some of them"
        )
    for i, feature in enumerate(features):
        yield _place(feature, f"{where}: features[{i}]")


def _place(feature: object, where: str) -> dict[str, Any]:
    geometry = feature.get("geometry") if isinstance(feature, dict) else None
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    if not isinstance(feature, dict) or not isinstance(geometry, dict) or not kind:
        raise MissionFileError(f"{where}: no feature with a geometry; give it a Point or a Polygon")
    values = geometry.get("coordinates")
    if kind == "Point":
        place: dict[str, Any] = {"position": _vertex(values, where)}
    elif kind == "Polygon" and isinstance(values, list) and values:
        shell, *holes = (_ring(ring, where) for ring in values)
        place = {"polygon": shell, **({"holes": holes} if holes else {})}
    else:
        raise MissionFileError(
            f"{where}: geometry.type = {kind!r}: write it as features, each with a Point or a "
            "Polygon"
        )
    properties = feature.get("properties") or {}
    for key in _NUMBERS:
        if isinstance(properties, dict) and properties.get(key) is not None:
            place[key] = _number(properties[key], f"{where}: properties.{key}")
            if place[key] <= 0.0:
                raise MissionFileError(
                    f"{where}: properties.{key} = {place[key]:g}: give a number above 0"
                )
    return place


def _ring(ring: object, where: str) -> list[list[float]]:
    vertices = [_vertex(v, where) for v in ring] if isinstance(ring, list) else []
    if len(vertices) < 4 or vertices[0] != vertices[-1]:
        raise MissionFileError(
            f"{where}: a ring needs three corners, and the first one again at its end"
        )
    return vertices[:-1]


def _vertex(value: object, where: str) -> list[float]:
    """Read a position as [latitude, longitude]; GeoJSON has longitude first."""
    if not isinstance(value, list) or len(value) not in (2, 3):
        raise MissionFileError(f"{where}: coordinates are [longitude, latitude], in degrees")
    lon_deg, lat_deg = (_number(part, f"{where}: coordinates") for part in value[:2])
    if not (-180.0 <= lon_deg <= 180.0 and -90.0 <= lat_deg <= 90.0):
        raise MissionFileError(
            f"{where}: coordinates = [{lon_deg:g}, {lat_deg:g}]: must be [longitude, latitude] in "
            "degrees; check whether they are swapped, or in metres"
        )
    return [lat_deg, lon_deg]


def _number(value: object, where: str) -> float:
    if isinstance(value, int | float) and not isinstance(value, bool):
        with contextlib.suppress(OverflowError):  # a whole number of hundreds of digits
            if math.isfinite(number := float(value)):
                return number
    raise MissionFileError(f"{where} = {str(value)[:_SHOWN]!r}: give a number")
