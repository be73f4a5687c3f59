"""The text of a mission file from places, a drone and settings, with a comment on each key."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, Literal

import tomlkit
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from missions.mission import flyable
from missions.mission.height_and_speed import MIN_HEIGHT_M, search_layer_faults
from missions.mission.messages import section_of
from missions.mission.schema import Mission, VehicleSection, parse_fields
from missions.mission.sections import AUTO
from missions.units import LatLon
from uavmap.base.printable import printable
from uavmap.load.areas.drones import Camera
from uavmap.load.areas.key_comments import COMMENTS, SECTIONS, UNITS
from uavmap.load.areas.layout import Layout

HIGHEST_M: Final = 60.0
"""Maximum height by default, m: there an error of one degree is a metre on the ground."""
WIND_M_S: Final = 5.0
"""Default wind, that of a fresh day, m/s."""
STRATEGY: Final = "swath"
_CAMERA: Final = ("hfov_deg", "width_px", "height_px", "interval_s", "mounting")
_SETTLE_M_S: Final = 1.5
_HIGH: Final = {
    "search.altitude_m": AUTO,
    "flight.climb_m_s": 2.5,
    "flight.descent_m_s": 1.5,
}
"""Keys of a high search, with the default climb and descent speeds of ArduPilot and PX4."""
_SEARCHED_HIGH: Final = {"search.find": "all", **_HIGH}
_LEAN_RAD: Final = math.radians(10.0)
"""Assumed tilt in the default wind, rad: more than that of a small multicopter."""


@dataclass(frozen=True, slots=True)
class AircraftFigures(Camera):
    """The figures of an aircraft and of its camera that a mission needs."""

    capacity_wh: float
    hover_power_w: float
    max_airspeed_m_s: float
    speed_m_s: float


@dataclass(frozen=True, slots=True)
class FlightChoices:
    """The user's choices for the flight."""

    vehicles: int = 1
    strategy: str = STRATEGY
    wind_m_s: float = WIND_M_S
    altitude_m: float | None = None
    """Height, m; None: as high as the pixels allow, at most `HIGHEST_M`."""
    ceiling_m: float | None = None
    find: Literal["first", "all"] = "all"


def compose(
    name: str,
    origin: str,
    layout: Layout,
    figures: AircraftFigures,
    flying: FlightChoices,
    detector: Mapping[str, Any] = MappingProxyType({}),
) -> str:
    """Write the text of a mission file with the table [detector]. The caller checks it."""
    values = _values(name, layout, figures, flying)
    values |= {f"detector.{key}": value for key, value in detector.items()}
    header = _header(name, origin, layout, figures)
    if flying.altitude_m is None:
        first = mission_text(values, header, flying.vehicles)
        values |= _height_and_pixels(parse_fields(first, name))
    if flying.find == "all" and flying.strategy == STRATEGY:
        values |= _SEARCHED_HIGH
        high = parse_fields(mission_text(values, header, flying.vehicles), name)
        if list(search_layer_faults(high)):  # no room above the layers of the map
            values = {key: value for key, value in values.items() if key not in _HIGH}
    return mission_text(values, header, flying.vehicles)


def _values(
    name: str, layout: Layout, figures: AircraftFigures, flying: FlightChoices
) -> dict[str, Any]:
    values: dict[str, Any] = {
        "name": name,
        "strategy": flying.strategy,
        "start.position": _pair(layout.home),
        "search.box": tuple(map(_pair, layout.box)),
        "fence.polygon": tuple(map(_pair, layout.fence)),
        "grid.cell_m": layout.cell_m,
        "flight.altitude_m": AUTO if flying.altitude_m is None else flying.altitude_m,
        "flight.speed_m_s": figures.speed_m_s,
        "flight.settle_m_s": min(_SETTLE_M_S, figures.speed_m_s),
        "flight.max_airspeed_m_s": figures.max_airspeed_m_s,
        **{f"camera.{key}": getattr(figures, key) for key in _CAMERA},
        "battery.capacity_wh": figures.capacity_wh,
        "battery.hover_power_w": figures.hover_power_w,
        "wind.speed_m_s": flying.wind_m_s,
        "sim.roi": tuple(map(_pair, layout.roi)),
    }
    if layout.holes:
        values["fence.holes"] = tuple(tuple(map(_pair, hole)) for hole in layout.holes)
    if flying.ceiling_m is not None:
        values["fence.ceiling_m"] = flying.ceiling_m
    return values


def _height_and_pixels(mission: Mission) -> dict[str, Any]:
    """Return values for height and pixels that replace `altitude_m = "auto"`, if it does not fit.

    It does not fit above `HIGHEST_M`, and where the lowest of several vehicles would see too little
    ground. Then all vehicles fly higher, and a cell has fewer pixels.
    """
    above_m = (len(mission.vehicles) - 1) * mission.team.layer_m
    top_m = mission.altitude_m(0) + above_m
    if top_m <= HIGHEST_M and not list(flyable.values(mission)):
        return {}
    lowest_m = float(math.floor(max(min(top_m, HIGHEST_M) - above_m, MIN_HEIGHT_M)))
    while lowest_m + above_m <= mission.fence.ceiling_m:
        optics = mission.camera.optics
        pixels = math.floor(optics.pixels_per_cell(lowest_m + above_m, mission.grid.cell_m))
        asked = min(mission.camera.pixels_per_cell, float(max(pixels, 1)))
        tried = mission.model_copy(
            update={
                "flight": mission.flight.model_copy(update={"altitude_m": lowest_m}),
                "camera": mission.camera.model_copy(update={"pixels_per_cell": asked}),
            }
        )
        if not list(flyable.values(tried)):
            return {"flight.altitude_m": lowest_m, "camera.pixels_per_cell": asked}
        lowest_m += 1.0
    return {}  # no height helps: the check of the mission names a remedy


def largest_cell_m(figures: AircraftFigures, flying: FlightChoices) -> float:
    """Return the largest cell of which a picture from at most `HIGHEST_M` shows 3 x 3, m.

    A fixed camera tilts with the vehicle in the wind.
    """
    height_m = flying.altitude_m or min(HIGHEST_M, flying.ceiling_m or HIGHEST_M)
    shape = min(figures.height_px / figures.width_px, 1.0)
    half_rad = math.atan(math.tan(math.radians(figures.hfov_deg) / 2.0) * shape)
    lean_rad = 0.0 if figures.mounting == "gimbal" else _LEAN_RAD
    seen_m = height_m * math.tan(max(half_rad - lean_rad, 0.0)) - flyable.POSITION_ERROR_M
    return max(seen_m, 0.0) / (0.5 + flyable.SEEN_SHARE)


def _header(name: str, origin: str, layout: Layout, figures: AircraftFigures) -> Sequence[str]:
    return (
        # a file may have a name with line breaks, which would end the comment
        f"{name}: map a region somewhere in {layout.name!r} ({printable(origin)}).",
        "",
        "Made by `uavmap new`. The aircraft:",
        f"{figures.title}.",
        "Check the figures of battery, camera and wind below before you fly.",
    )


def _pair(place: LatLon) -> tuple[float, float]:
    return place.lat_deg, place.lon_deg


# --- the text -------------------------------------------------------------------------------------
Values = Mapping[str, Any]
"""The values of a mission that are not defaults, by dotted key."""

_COLUMN: Final = 40
_LISTED_LAST: Final = frozenset({"sim.roi"})
_HIDDEN: Final = frozenset({"detector.tables"})
_OF_THRESHOLD: Final = frozenset(
    f"detector.{key}" for key in ("intensity", "dilations", "polarity", "greenness")
)
"""Keys of the detector `threshold`, which other detectors do not use."""
_WITHOUT_DEFAULT: Final = frozenset({"start.amsl_m"})
"""Keys without a default that suits any place."""


def mission_text(values: Values, header: Sequence[str], vehicles: int = 1) -> str:
    """Return the text of a mission file: a header, and every key with its value and a comment.

    Keys that are not in `values` have their defaults; keys without one are comments.
    """
    lines = [f"# {line}".rstrip() for line in header]
    lines += [
        "#",
        "# Positions are [latitude, longitude] in degrees (WGS84); angles are clockwise from true",
        "# north. A key that is left out takes its default; an unknown key is an error.",
        "",
    ]
    for key, field in Mission.model_fields.items():
        if key == "vehicles":
            lines += _vehicles(vehicles)
        elif (section := section_of(field.annotation)) is None:
            lines += _line(key, key, field, values)
        else:
            lines += _section(key, section, values, optional=field.default is None)
    return "\n".join(lines) + "\n"


def _section(
    name: str, section: type[BaseModel], values: Values, *, optional: bool
) -> Iterator[str]:
    yield ""
    yield f"# {SECTIONS[name]}"
    given = any(key.startswith(f"{name}.") for key in values)
    off = "# " if optional and not given else ""
    yield f"{off}[{name}]"
    hidden = _LISTED_LAST | _HIDDEN
    if values.get("detector.name", "threshold") != "threshold":
        hidden |= _OF_THRESHOLD
    for key, field in section.model_fields.items():
        full = f"{name}.{key}"
        if full not in hidden:
            yield from _line(key, full, field, values)
    for table, keys in values.get(f"{name}.tables", {}).items():
        yield ""
        yield f"[{name}.{table}]"
        for key, value in keys.items():
            yield f"{key} = {tomlkit.item(value).as_string()}"
    for full in sorted(_LISTED_LAST):
        if full.startswith(f"{name}.") and full in values:
            yield ""
            yield f"# {COMMENTS[full]}"
            yield f"[[{full}]]"
            yield from _rings("polygon", values[full])


def with_zone_files(text: str, files: Sequence[str]) -> str:
    """Return the text of a new mission with files of zones in it."""
    listed = tomlkit.item(list(files)).as_string()
    line = re.compile(r"^# zones = *", re.MULTILINE)
    return line.sub(lambda found: f"zones = {listed}  ", text, count=1)


def _vehicles(count: int) -> Iterator[str]:
    for number in range(count):
        yield ""
        yield "[[vehicles]]"
        if number == 0:
            for key, field in VehicleSection.model_fields.items():
                yield from _line(key, f"vehicles.{key}", field, {})


def _line(key: str, full: str, field: FieldInfo, values: Values) -> Iterator[str]:
    comment = "; ".join(filter(None, (COMMENTS.get(full, ""), _limits(key, field))))
    value = values.get(
        full, None if field.is_required() else field.get_default(call_default_factory=True)
    )
    if isinstance(value, tuple) and full in values:
        yield f"# {comment}"
        yield from _rings(key, value)
        return
    # a table of its own, or no default: the key is written as a comment
    missing = value is None or isinstance(value, BaseModel | Mapping) or value == ()
    missing |= full in _WITHOUT_DEFAULT and full not in values
    text = f"# {key} =" if missing else f"{key} = {tomlkit.item(value).as_string()}"
    yield f"{text:{_COLUMN - 1}} # {comment}".rstrip(" #")


def _rings(key: str, value: Any) -> Iterator[str]:
    if isinstance(value[0], float):
        yield f"{key} = {_place(value)}"
        return
    yield f"{key} = ["
    for one in value:
        place = isinstance(one[0], float)
        yield f"    {_place(one)}," if place else f"    [{', '.join(map(_place, one))}],"
    yield "]"


def _place(value: Sequence[float]) -> str:
    return f"[{value[0]:.7f}, {value[1]:.7f}]"


def _limits(key: str, field: FieldInfo) -> str:
    unit = next((unit for suffix, unit in UNITS if key.endswith(suffix)), "")
    words = (("ge", "from"), ("gt", "above"), ("le", "up to"), ("lt", "below"))
    limits = [
        f"{word} {getattr(limit, name):g}"
        for name, word in words
        for limit in field.metadata
        if hasattr(limit, name)
    ]
    return ", ".join(filter(None, (unit, *limits)))
