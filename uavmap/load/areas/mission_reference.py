"""The page with every key of a mission file: `python -m uavmap.load.areas.mission_reference`."""

from __future__ import annotations

import ast
import inspect
import json
import re
import sys
import textwrap
from collections.abc import Iterator, Mapping
from functools import cache
from itertools import pairwise
from typing import Any, Final

from missions.mission import sim_section
from missions.mission.schema import Mission
from uavmap.load.areas.key_comments import COMMENTS, SECTIONS, UNITS

Schema = Mapping[str, Any]

_HEAD: Final = """\
# Mission files

<!-- made by: python -m uavmap.load.areas.mission_reference > docs/reference/missions.md -->

A mission file defines the area, the aircraft and the flight. It is a text in TOML: lines `key =
value`, in tables `[name]`. [`uavmap new`](../tutorials/your-area.md) writes one from a drawing,
with a comment on every key. `uavmap check FILE` reports each error: line, key, value and remedy.
The shipped missions (`missions/shipped`) are examples.

A key that is left out takes its default; an unknown key is an error. Angles are degrees clockwise
from true north. The words are in the [glossary](../glossary.md).

A *position* is `[latitude, longitude]` in degrees (WGS84). A *ring* is a list of at least three
positions around an area.
"""

_NESTED: Final[Mapping[str, str]] = {
    "search.prior": "A place where the region may be: a point, or a polygon.",
    "search.prior.position": "middle of the place",
    "search.prior.spread_m": "standard deviation around it; by default half of the box's "
    "shorter side",
    "search.prior.polygon": "polygon that holds the region",
    "search.prior.holes": "holes of the polygon",
    "search.prior.weight": "probability in proportion to the other places",
    "fence.zones": "The content of files of zones: uavmap writes it.",
    "fence.zones.name": "name in its file",
    "fence.zones.why": "restriction, heights, times and file, in words",
    "fence.zones.effect": "effect on the fence",
    "fence.zones.holes": "numbers of the holes of the fence that it is a part of",
    "detector.classes": "The classes that a detector distinguishes. Besides `region` there is a "
    "table for each, by name, with `number` and optionally `thickness_um` "
    "(docs/how-to/classes.md).",
    "detector.classes.region": "names of the classes that are explored; by default all",
    "terrain.dem": "The heights of a GeoTIFF: uavmap writes them.",
    "terrain.dem.west_m": "distance of the first height west of the start",
    "terrain.dem.south_m": "distance of the first height from the start (negative: south of it)",
    "terrain.dem.step_m": "distance between two heights",
    "terrain.dem.columns": "number of heights towards east",
    "terrain.dem.rows": "number of heights towards north",
    "terrain.dem.heights": "heights above the start, packed",
    "vehicles": "One table for each vehicle: `[[vehicles]]`.",
}
"""Comments on keys of tables in tables, which a new mission file does not contain.

Those of the simulator are docstrings in `missions.mission.sim_section`.
"""
_HIDDEN: Final = frozenset({"detector.tables"})
"""Keys that are written as tables of their own, one for each detector."""
_TYPES: Final = {
    "flight.altitude_m": 'number or `"auto"`',
    "search.altitude_m": 'number or `"auto"`',
    "search.prior": "position, list, or path of a GeoJSON file",
    "fence.zones": "path of a file of zones, or list of paths",
    "terrain.dem": "path of a GeoTIFF",
    "sim.roi.rgb": "red, green, blue, from 0 to 255",
}
"""Types of keys for which a user writes another form than the one that is stored."""
_WORDS: Final = {"metres": "m", "volts": "V", "clock_ppm": "ppm", "slope_percent": "%"}
_KINDS: Final = {
    "number": "number",
    "integer": "whole number",
    "string": "text",
    "boolean": "yes/no",
}


def reference() -> str:
    """Return the page in Markdown."""
    root = Mission.model_json_schema()
    lines = [_HEAD]
    for name, schema in _tables("", root, root):
        if name:
            title = f"[[{name}]]" if name in _LISTED else f"[{name}]"
            meaning = SECTIONS.get(name) or _NESTED.get(name) or schema["description"]
            text = textwrap.fill(_linked(meaning.replace("\n# ", " ")), 100, break_on_hyphens=False)
            lines += [f"## `{title}`", "", text, ""]
        else:
            lines += ["## The mission", ""]
        if name == "detector":
            lines += [
                "A detector may have a table of its own: [detectors](../how-to/detectors.md).",
                "",
            ]
        lines += ["| key | type | unit | limits | default | meaning |", "|---|---|---|---|---|---|"]
        lines += [_row(name, key, value, schema, root) for key, value in _keys(name, schema, root)]
        lines.append("")
    return "\n".join(lines).rstrip() + "\n"


_LISTED: Final = frozenset(
    {"vehicles", "search.prior", "sim.roi", "sim.faults", "sim.traffic", "fence.zones"}
)
"""Tables that a mission may have several times."""


def _tables(name: str, schema: Schema, root: Schema) -> Iterator[tuple[str, Schema]]:
    yield name, schema
    for key, value in schema["properties"].items():
        full = _full(name, key)
        inner = _table_of(value, root)
        if inner is not None and full not in _HIDDEN:
            yield from _tables(full, inner, root)


def _keys(name: str, schema: Schema, root: Schema) -> Iterator[tuple[str, Schema]]:
    """Yield the keys of a table, without those that are always tables of their own."""
    for key, value in schema["properties"].items():
        full = _full(name, key)
        if full not in _HIDDEN and (full in COMMENTS or _table_of(value, root) is None):
            yield key, value


def _row(name: str, key: str, value: Schema, schema: Schema, root: Schema) -> str:
    full = _full(name, key)
    default = "*needed*" if key in schema.get("required", ()) else _default(value)
    kinds = dict.fromkeys(_one_type(option, root) for option in _options(value))
    kind = _TYPES.get(full) or " or ".join(kinds)
    meaning = COMMENTS.get(full) or _NESTED.get(full) or _docstring(f"{schema['title']}.{key}")
    cells = (f"`{key}`", kind, _unit(key), _limits(value), default, _linked(meaning))
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _docstring(field: str) -> str:
    """Return the docstring of a field such as "SimFault.at_s", as it stands in a table."""
    text = _docstrings().get(field, "").rstrip(".")
    return text[:1].lower() + text[1:]


@cache
def _docstrings() -> dict[str, str]:
    tree = ast.parse(inspect.getsource(sim_section))
    return {
        f"{table.name}.{field.target.id}": text.value.value
        for table in tree.body if isinstance(table, ast.ClassDef)
        for field, text in pairwise(table.body)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        and isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
        and isinstance(text.value.value, str)
    }  # fmt: skip


def _unit(key: str) -> str:
    by_suffix = (unit for suffix, unit in UNITS if f"_{key}".endswith(suffix))
    return _WORDS.get(key) or next(by_suffix, "")


def _linked(text: str) -> str:
    return re.sub(r"\(docs/([\w/-]+\.md)\)", r"([more](../\1))", text)


def _full(name: str, key: str) -> str:
    return f"{name}.{key}" if name else key


# --- the schema in words -------------------------------------------------------------------------
def _options(value: Schema) -> list[Schema]:
    return [one for one in value.get("anyOf", [value]) if one.get("type") != "null"]


def _resolved(value: Schema, root: Schema) -> Schema:
    reference = value.get("$ref")
    found: Schema = root["$defs"][reference.rpartition("/")[2]] if reference else value
    return found


def _table_of(value: Schema, root: Schema) -> Schema | None:
    for option in _options(value):
        entry = option.get("items", option) if option.get("type") == "array" else option
        found = _resolved(entry, root)
        if "properties" in found:
            return found
    return None


def _one_type(value: Schema, root: Schema) -> str:
    value = _resolved(value, root)
    if "enum" in value:
        values = [f"`{json.dumps(one)}`" for one in value["enum"]]
        return (" or " if len(values) < 4 else ", ").join(values)
    if "const" in value:
        return f"`{json.dumps(value['const'])}`"
    if "prefixItems" in value:
        return "position"
    if value.get("type") == "array":
        inner = _one_type(value["items"], root)
        several = {"position": "ring", "ring": "list of rings", "table": "list of tables"}
        return several.get(inner, f"list of {inner}s")
    if value.get("type") == "object":
        return "table"
    return _KINDS[value["type"]]


def _limits(value: Schema) -> str:
    words = (
        ("minimum", "from"), ("exclusiveMinimum", "above"), ("maximum", "up to"),
        ("exclusiveMaximum", "below"),
    )  # fmt: skip
    options = _options(value)
    return ", ".join(f"{word} {o[key]:g}" for o in options for key, word in words if key in o)


def _default(value: Schema) -> str:
    default = value.get("default")
    if default is None or default == [] or isinstance(default, dict):
        return ""
    if isinstance(default, list):
        return "one"
    return f"`{json.dumps(default)}`"


if __name__ == "__main__":
    sys.stdout.write(reference())
