"""The line of a mission file on which a key stands, for messages about its value."""

from __future__ import annotations

import re
from typing import Final

_HEADER: Final = re.compile(r"""\[\[?(\s*[A-Za-z_"'][\w."' -]*)\]\]?""")
_KEY: Final = re.compile(r"""[\w."' -]+""")
_LONGEST: Final = 500
"""Characters of a line that are read for its key: values may be long."""
_NAMED: Final = re.compile(r"[\w-]+(?:\[\d+\]|\.[\w-]+)*")
_QUOTES: Final = re.compile(r"""[\s"']""")


def with_lines(message: str, source: str, text: str) -> str:
    """Return the message with the line of the text behind the source's name, where a key has one.

    A key within a value on several lines takes the line on which that value begins.

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
