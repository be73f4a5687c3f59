"""Every key of a mission file as a page: `python -m uavmap.load.areas.mission_reference`."""

from __future__ import annotations

import json
import re
import sys
import textwrap
from collections.abc import Iterator, Mapping
from typing import Any, Final

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
    "search.prior.position": "the middle of the place",
    "search.prior.spread_m": "standard deviation around it; by default half of the box's "
    "shorter side",
    "search.prior.polygon": "the region is somewhere in here",
    "search.prior.holes": "of the polygon",
    "search.prior.weight": "how probable it is, beside the other places",
    "fence.zones": "The content of files of zones: uavmap writes it.",
    "fence.zones.name": "as its file has it",
    "fence.zones.why": "restriction, heights, times and file, in words",
    "fence.zones.effect": "what it is to the fence",
    "fence.zones.holes": "which holes of the fence it is a part of",
    "detector.classes": "The classes that a detector distinguishes: besides `region` a table for "
    "each, by name, with `number` and perhaps `thickness_um` (docs/how-to/classes.md).",
    "detector.classes.region": "names of those that are explored; without it all of them",
    "terrain.dem": "The heights of a GeoTIFF: uavmap writes them.",
    "terrain.dem.west_m": "of the first height, from the start",
    "terrain.dem.south_m": "of the first height, from the start (negative: south of it)",
    "terrain.dem.step_m": "from height to height",
    "terrain.dem.columns": "towards east",
    "terrain.dem.rows": "towards north",
    "terrain.dem.heights": "above the start, packed",
    "sim.roi": "A piece of the true region.",
    "sim.roi.polygon": "around it",
    "sim.roi.holes": "in it",
    "sim.roi.rgb": "its colour; without it gray; later pieces lie on earlier ones",
    "sim.terrain": "Ground that is not level: a slope with hills on it.",
    "sim.terrain.slope_percent": "how steep",
    "sim.terrain.rises_toward_deg": "where it rises to, true bearing",
    "sim.terrain.hills_m": "from the deepest valley to the highest top, at most",
    "sim.terrain.hills_length_m": "from one hill to the next, at least",
    "sim.terrain.seed": "which hills",
    "sim.quirks": "Habits of real aircraft that surprise.",
    "sim.quirks.camera": "who answers for the camera: a component of its own, the autopilot, "
    "or nobody",
    "sim.quirks.camera_clock_s": "how far the camera's clock is off",
    "sim.quirks.camera_tells_pose": "whether it reports the pose of each picture",
    "sim.quirks.clock_ppm": "how fast the autopilot's clock runs wrong, in millionths",
    "sim.quirks.home_moves_m": "how far home moves when motors are armed",
    "sim.quirks.stick": "whether a pilot's radio control is on, its sticks centred",
    "sim.quirks.landed_state": "whether it sends EXTENDED_SYS_STATE",
    "sim.quirks.height_sigma_m": "how far a receiver's height above the sea is off; it wanders",
    "sim.quirks.tilt_sigma_deg": "how far its roll and pitch are off, for some seconds",
    "sim.quirks.heading_sigma_deg": "how far its heading is off, for some 20 s",
    "sim.faults": "Something that goes wrong.",
    "sim.faults.vehicle": "which vehicle, from 1",
    "sim.faults.at_s": "when, on the mission's time",
    "sim.faults.for_s": "how long; without it to the end",
    "sim.faults.kind": "what goes wrong",
    "sim.faults.metres": "of `gps_glitch`: how far the position jumps",
    "sim.faults.m_s": "of `gps_drift` and `wind_gust`: how fast",
    "sim.faults.volts": "of `battery_sag`: by how much the voltage falls",
    "sim.faults.deg": "of `compass`: how far it is off",
    "sim.faults.toward_deg": "of `gps_glitch` and `gps_drift`: the true bearing",
    "sim.faults.from_deg": "of `wind_gust`: where it blows from, true bearing",
    "sim.faults.share": "of `motor`: what it still gives",
    "sim.faults.command": "of `reject`: the number of the MAVLink command",
    "sim.faults.result": "of `reject`: the MAV_RESULT that is answered",
    "sim.faults.loss": "of `link`: the share of frames that are lost",
    "sim.faults.duplicate": "of `link`: the share that comes twice",
    "sim.faults.reorder": "of `link`: the share that comes too late",
    "sim.faults.corrupt": "of `link`: the share in which a byte is wrong",
    "sim.faults.delay_s": "of `link`: how late everything comes",
    "sim.faults.jitter_s": "of `link`: how much that varies",
    "sim.faults.silent": "of `link`: nothing comes at all",
    "sim.traffic": "An aircraft of others that flies straight; receivers on board report it.",
    "sim.traffic.position": "where it is at `at_s`",
    "sim.traffic.height_m": "above the start",
    "sim.traffic.toward_deg": "where it flies to, true bearing",
    "sim.traffic.speed_m_s": "over ground",
    "sim.traffic.at_s": "start of its reports, on the time of the mission",
    "sim.traffic.for_s": "how long; without it to the end",
    "sim.traffic.name": "its call sign: capitals and digits",
    "sim.traffic.kind": "which message: ADSB_VEHICLE or UTM_GLOBAL_POSITION",
    "vehicles": "One table for each vehicle: `[[vehicles]]`.",
}
"""What the comments of a mission file do not tell: tables in tables."""
_HIDDEN: Final = frozenset({"detector.tables"})
"""Written as tables of their own, one a detector."""
_TYPES: Final = {
    "flight.altitude_m": 'number or `"auto"`',
    "search.altitude_m": 'number or `"auto"`',
    "search.prior": "position, list, or path of a GeoJSON file",
    "fence.zones": "path of a file of zones, or list of paths",
    "terrain.dem": "path of a GeoTIFF",
    "sim.roi.rgb": "red, green, blue, from 0 to 255",
}
"""Where a person writes something else than is kept of it."""
_WORDS: Final = {"metres": "m", "volts": "V", "clock_ppm": "ppm", "slope_percent": "%"}
_KINDS: Final = {
    "number": "number",
    "integer": "whole number",
    "string": "text",
    "boolean": "yes/no",
}


def reference() -> str:
    """The page, in Markdown."""
    root = Mission.model_json_schema()
    lines = [_HEAD]
    for name, schema in _tables("", root, root):
        if name:
            title = f"[[{name}]]" if name in _LISTED else f"[{name}]"
            said = SECTIONS.get(name) or _NESTED[name]
            text = textwrap.fill(_linked(said.replace("\n# ", " ")), 100, break_on_hyphens=False)
            lines += [f"## `{title}`", "", text, ""]
        else:
            lines += ["## The mission", ""]
        if name == "detector":
            lines += [
                "A detector may have a table of its own: [detectors](../how-to/detectors.md).",
                "",
            ]
        lines += ["| key | type | unit | limits | default | what |", "|---|---|---|---|---|---|"]
        lines += [_row(name, key, value, schema, root) for key, value in _keys(name, schema, root)]
        lines.append("")
    return "\n".join(lines).rstrip() + "\n"


_LISTED: Final = frozenset(
    {"vehicles", "search.prior", "sim.roi", "sim.faults", "sim.traffic", "fence.zones"}
)
"""Tables of which there may be several."""


def _tables(name: str, schema: Schema, root: Schema) -> Iterator[tuple[str, Schema]]:
    yield name, schema
    for key, value in schema["properties"].items():
        full = _full(name, key)
        inner = _table_of(value, root)
        if inner is not None and full not in _HIDDEN:
            yield from _tables(full, inner, root)


def _keys(name: str, schema: Schema, root: Schema) -> Iterator[tuple[str, Schema]]:
    """The keys of a table that are no tables of their own, but for those that may also be short."""
    for key, value in schema["properties"].items():
        full = _full(name, key)
        if full not in _HIDDEN and (full in COMMENTS or _table_of(value, root) is None):
            yield key, value


def _row(name: str, key: str, value: Schema, schema: Schema, root: Schema) -> str:
    full = _full(name, key)
    default = "*needed*" if key in schema.get("required", ()) else _default(value)
    kinds = dict.fromkeys(_one_type(option, root) for option in _options(value))
    kind = _TYPES.get(full) or " or ".join(kinds)
    said = _linked(COMMENTS.get(full) or _NESTED.get(full, ""))
    cells = (f"`{key}`", kind, _unit(key), _limits(value), default, said)
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


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
        return " or ".join(f"`{json.dumps(one)}`" for one in value["enum"])
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
