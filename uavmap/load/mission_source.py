"""A mission, loaded once: its file is parsed, what it names is read, and all is checked."""

from __future__ import annotations

import contextlib
import difflib
import itertools
import re
from collections.abc import Iterator, Mapping
from importlib import resources
from pathlib import Path
from typing import Any, Final

from missions.errors import MissionFileError
from missions.mission.checks import check
from missions.mission.schema import Mission, mission_of_tables, parse_fields, parse_toml
from uavmap.base.text_files import read_text
from uavmap.load.dem import LEVEL, with_ground
from uavmap.load.detector_source import (
    check_detector,
    detector_of_section,
    known_detectors,
    resolved_section,
)
from uavmap.load.prior_file import prior_places

LARGEST_BYTES: Final = 4_000_000
_MOST_LOOKED_AT: Final = 1000


def shipped_missions() -> list[str]:
    """The names of the missions that are shipped."""
    folder = resources.files("missions") / "shipped"
    return sorted(f.name.removesuffix(".toml") for f in folder.iterdir())


def load(name: str, detector: str | None = None) -> Mission:
    """Load a mission by its path, or by the name of a shipped one. Raises `MissionFileError`.

    What the file names becomes a part of the mission: the places of `search.prior` (GeoJSON), the
    ground of `terrain.dem` (GeoTIFF), the checksum of `detector.model`. A `detector` (a folder of
    `uavmap tune`) replaces its own. A message has file, line, key, value and remedy.
    """
    text, folder = _read(name)
    try:
        mission = _resolved(parse_toml(text, name), name, folder, detector)
        _check(mission, name)
        if mission.detector.model is not None:  # a fault of it is reported before anything begins
            with _named(name):
                detector_of_section(mission.detector)
    except MissionFileError as error:
        raise MissionFileError(with_lines(str(error), name, text)) from None
    return mission


def mission_of_text(text: str, source: str) -> Mission:
    """Check a mission whose text is no file of a user, and names none. Raises as `load`."""
    mission = parse_fields(text, source)
    _check(mission, source)
    return mission


def _check(mission: Mission, source: str) -> None:
    check(mission, source, detectors=known_detectors())
    with _named(source):
        check_detector(mission.detector)


@contextlib.contextmanager
def _named(source: str) -> Iterator[None]:
    """Name the file in messages of the block that do not name it."""
    try:
        yield
    except MissionFileError as error:
        text = str(error)
        named_already = text.startswith("--detector ")
        raise MissionFileError(text if named_already else f"{source}: {text}") from None


def _resolved(tables: dict[str, Any], source: str, folder: Path, detector: str | None) -> Mission:
    """The mission of these tables, with what they name by a path in the place of that path."""
    prior, dem = _path_at(tables, "search", "prior"), _path_at(tables, "terrain", "dem")
    if prior is not None:
        where = f"{source}: search.prior = {prior!r}"
        tables["search"]["prior"] = prior_places(folder / prior, where)
    if dem is not None:
        tables["terrain"]["dem"] = LEVEL
    section = tables.get("detector")
    if section is None or isinstance(section, dict):
        other = None if detector is None else Path(detector)
        with _named(source):
            found = resolved_section(section, folder, other)
        tables |= {} if found is None else {"detector": found}
    mission = mission_of_tables(tables, source)
    if dem is not None:
        mission = with_ground(mission, folder / dem, f"{source}: terrain.dem = {dem!r}")
    return mission


def _path_at(tables: Mapping[str, Any], section: str, key: str) -> str | None:
    table = tables.get(section)
    value = table.get(key) if isinstance(table, Mapping) else None
    return value if isinstance(value, str) else None


def _read(name: str) -> tuple[str, Path]:
    """The text of a mission, and the folder from which it names files."""
    path = Path(name)
    if not path.suffix and name in shipped_missions() and not path.exists():
        text = (resources.files("missions") / "shipped" / f"{name}.toml").read_text("utf-8")
        return text, Path()
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
    """What was perhaps meant: a mission file of the same folder, or a shipped mission."""
    known = {} if path.parent != Path() else {name: name for name in shipped_missions()}
    with contextlib.suppress(OSError):
        files = itertools.islice(path.parent.glob("*.toml"), _MOST_LOOKED_AT)
        known |= {file.name: str(file) for file in files}
    near = difflib.get_close_matches(path.name, known, n=1)
    return f"did you mean {known[near[0]]!r}? " if near else ""


# --- lines of keys -------------------------------------------------------------------------------
_HEADER: Final = re.compile(r"""\[\[?(\s*[A-Za-z_"'][\w."' -]*)\]\]?""")
_KEY: Final = re.compile(r"""[\w."' -]+""")
_LONGEST: Final = 500
"""Characters of a line that are read for its key: values may be long."""
_NAMED: Final = re.compile(r"[\w-]+(?:\[\d+\]|\.[\w-]+)*")
_QUOTES: Final = re.compile(r"""[\s"']""")


def with_lines(message: str, source: str, text: str) -> str:
    """Return the message with the key's line behind the source's name, where the text has one.

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
    """The first line of every key, with its tables: `grid.cell_m`, `vehicles[1].url`."""
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
