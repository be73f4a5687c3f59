"""What another file holds, written into the text of a mission in the place of that file's name.

A mission has to hold all that it is flown by, for a journal keeps the text of the mission and
nothing else.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from typing import Any, Final

from missions.errors import MissionFileError
from missions.mission_file.schema import parse_toml

_STRING: Final = r"""("(?:[^"\\\n]|\\.)*"|'[^'\n]*')"""


def named_file(text: str, source: str, section: str, key: str) -> tuple[str, str] | None:
    """The name of a file that stands at `section.key`, and how a fault there begins.

    None where no text stands there. Raises `MissionFileError` for what is no TOML.

    >>> named_file('[terrain]\\ndem = "a.tif"', "x.toml", "terrain", "dem")
    ('a.tif', "x.toml: terrain.dem = 'a.tif'")
    """
    table = parse_toml(text, source).get(section)
    name = table.get(key) if isinstance(table, Mapping) else None
    return (name, f"{source}: {section}.{key} = {name!r}") if isinstance(name, str) else None


def inlined(
    text: str, where: str, section: str, key: str, value: Any, named: str | None = None
) -> str:
    """The text with `value` for the string at `section.key`; the rest stays as it was written.

    `named`: under this key instead. Whichever string is taken for that one, the result is held
    against what it has to mean. Raises `MissionFileError`, which begins with `where`, for one that
    is not found.

    >>> inlined('[terrain]\\ndem = "a.tif"  # 2024', "x.toml", "terrain", "dem", {"step_m": 2.0})
    '[terrain]\\ndem = {step_m = 2.0}  # 2024'
    """
    wanted = tomllib.loads(text)
    del wanted[section][key]
    wanted[section][named or key] = value
    table = _toml(value)
    for found in re.finditer(rf"""\b{key}["']?\s*=\s*{_STRING}""", text):
        before = text[: found.start(1)] if named is None else f"{text[: found.start()]}{named} = "
        changed = before + table + text[found.end(1) :]
        try:
            if tomllib.loads(changed) == wanted:
                return changed
        except tomllib.TOMLDecodeError:
            continue
    raise MissionFileError(f'{where}: write it in one line, as {key} = "..." in [{section}]')


def _toml(value: object) -> str:
    """Lists, tables, texts and numbers in one line of TOML."""
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key} = {_toml(inner)}' for key, inner in value.items())}}}"
    return json.dumps(value) if isinstance(value, str) else repr(value)
