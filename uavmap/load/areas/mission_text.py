"""From places, a drone and the user's wishes to the text of a mission, with a comment on each key.

The keys come from the schema. A test requires a comment for every one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import tomlkit
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from missions.mission import flyable
from missions.mission.height_and_speed import LEAST_HEIGHT_M, search_layer_faults
from missions.mission.schema import Mission, VehicleSection, parse_fields
from missions.mission.sections import AUTO
from missions.units import LatLon
from uavmap.base.printable import printable
from uavmap.load.areas.drones import Camera
from uavmap.load.areas.layout import Layout

HIGHEST_M: Final = 60.0
"""Nobody is sent higher unasked: there an error of one degree is a metre on the ground."""
WIND_M_S: Final = 5.0
"""What is reckoned with where nobody says: a fresh day, not a calm one."""
STRATEGY: Final = "swath"
_CAMERA: Final = ("hfov_deg", "width_px", "height_px", "interval_s", "mounting")
_SETTLE_M_S: Final = 1.5
_HIGH: Final = {
    "search.altitude_m": AUTO,
    "flight.climb_m_s": 2.5,
    "flight.descent_m_s": 1.5,
}
"""A search from on high, and the speeds at which ArduPilot and PX4 climb and descend by default."""
_SEARCHED_HIGH: Final = {"search.find": "all", **_HIGH}
_LEAN_RAD: Final = math.radians(10.0)
"""More than a small multicopter leans in `WIND_M_S`."""


@dataclass(frozen=True, slots=True)
class Figures(Camera):
    """What a mission needs to know of an aircraft: its camera, and these."""

    capacity_wh: float
    hover_power_w: float
    max_airspeed_m_s: float
    speed_m_s: float


@dataclass(frozen=True, slots=True)
class Flying:
    """How the mission is to be flown."""

    vehicles: int = 1
    strategy: str = STRATEGY
    wind_m_s: float = WIND_M_S
    altitude_m: float | None = None
    """None: as high as the pixels allow, `HIGHEST_M` at most."""
    ceiling_m: float | None = None
    find: Literal["first", "all"] = "all"


def compose(name: str, origin: str, layout: Layout, figures: Figures, flying: Flying) -> str:
    """The text of a mission file. It is not checked yet."""
    values = _values(name, layout, figures, flying)
    header = _header(name, origin, layout, figures)
    if flying.altitude_m is None:
        first = mission_text(values, header, flying.vehicles)
        values |= _seeing_enough(parse_fields(first, name))
    if flying.find == "all" and flying.strategy == STRATEGY:
        values |= _SEARCHED_HIGH
        high = parse_fields(mission_text(values, header, flying.vehicles), name)
        if list(search_layer_faults(high)):  # no room above the layers of the map
            values = {key: value for key, value in values.items() if key not in _HIGH}
    return mission_text(values, header, flying.vehicles)


def _values(name: str, layout: Layout, figures: Figures, flying: Flying) -> dict[str, Any]:
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


def _seeing_enough(mission: Mission) -> dict[str, Any]:
    """Return the height for `altitude_m = "auto"`, and what it requires of the camera's pixels.

    It stays "auto" unless that is above `HIGHEST_M`, or the lowest of several vehicles would see
    too little: then all fly higher, and a cell has fewer pixels.
    """
    above_m = (len(mission.vehicles) - 1) * mission.team.layer_m
    top_m = mission.altitude_m(0) + above_m
    if top_m <= HIGHEST_M and not list(flyable.values(mission)):
        return {}
    lowest_m = float(math.floor(max(min(top_m, HIGHEST_M) - above_m, LEAST_HEIGHT_M)))
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
    return {}  # no height helps: the check of the mission says what would


def largest_cell_m(figures: Figures, flying: Flying) -> float:
    """Return the largest cell of which a picture shows 3 x 3, from at most `HIGHEST_M`, m.

    A fixed camera looks aside while the vehicle leans into the wind.
    """
    height_m = flying.altitude_m or min(HIGHEST_M, flying.ceiling_m or HIGHEST_M)
    shape = min(figures.height_px / figures.width_px, 1.0)
    half_rad = math.atan(math.tan(math.radians(figures.hfov_deg) / 2.0) * shape)
    lean_rad = 0.0 if figures.mounting == "gimbal" else _LEAN_RAD
    seen_m = height_m * math.tan(max(half_rad - lean_rad, 0.0)) - flyable.POSITION_ERROR_M
    return max(seen_m, 0.0) / (0.5 + flyable.SEEN_SHARE)


def _header(name: str, origin: str, layout: Layout, figures: Figures) -> Sequence[str]:
    return (
        # a file may have a name with line breaks, which would end the comment
        f"{name}: map a region somewhere in {layout.name!r} ({printable(origin)}).",
        "",
        "Made by `uavmap new`. The aircraft:",
        f"{figures.title}.",
        "Look at the figures of battery, camera and wind below before you fly.",
    )


def _pair(place: LatLon) -> tuple[float, float]:
    return place.lat_deg, place.lon_deg


# --- the text -------------------------------------------------------------------------------------
Values = Mapping[str, Any]
"""What a mission says besides the defaults, by dotted key."""

_COLUMN: Final = 40
UNITS: Final = (
    ("_m_s", "m/s"), ("_wh", "Wh"), ("_w", "W"), ("_deg", "degrees"), ("_px", "pixels"),
    ("_m", "m"), ("_s", "s"),
)  # fmt: skip

SECTIONS: Final[Mapping[str, str]] = {
    "start": "Home of the first vehicle, and the middle of the grid's first cell.",
    "search": "The area that is searched lane by lane until the region is seen; from then on "
    "the\n# vehicles follow the region, also out of this area.",
    "fence": "No vehicle leaves this polygon, or enters a hole of it.",
    "grid": "The map.",
    "flight": "How the vehicles fly.",
    "camera": "The camera looks straight down.",
    "detector": "What tells the region in a picture (docs/detectors.md).",
    "votes": "How sure the map is.",
    "battery": "Measure hover_power_w: hover a battery down, divide its energy by the hours.",
    "wind": "The worst wind of the day: the way home is planned against it.",
    "drift": "A region that moves as a whole, such as an oil film.",
    "team": "How several vehicles keep apart.",
    "guardian": "What the guardians of the aircraft do when the mission is gone.",
    "navigation": "When satellites are lost, or lie (docs/navigation.md).",
    "terrain": "Where the ground is not flat (docs/terrain.md).",
    "sim": "For `--sim` alone; a real flight never reads it.",
}

COMMENTS: Final[Mapping[str, str]] = {
    "name": "results go into results/NAME-1, and so on",
    "strategy": "how vehicles find their way: `uavmap strategies`",
    "start.position": "[latitude, longitude]",
    "start.amsl_m": "the ground's height above the sea, for `uavmap export`",
    "search.box": "[latitude, longitude] of each corner, once around",
    "search.prior": "where in it the region probably is (docs/prior.md)",
    "search.find": '"first": the piece seen first; "all": all in the box (docs/strategies.md)',
    "search.altitude_m": 'of the lowest vehicle that searches higher up; for find = "all"',
    "search.pixels_per_cell": "of the edge of a cell, for a suspicion from up there",
    "search.layer_m": "height between two who search; 0: all in one layer",
    "fence.polygon": "with room for a region that reaches out of the area",
    "fence.holes": "polygons that nobody flies over",
    "fence.margin_m": "plan legs this far inside",
    "fence.ceiling_m": "no vehicle is sent higher above the start",
    "grid.cell_m": "edge of a cell on the ground",
    "flight.altitude_m": 'of the lowest vehicle; "auto": as high as pixels and ceiling allow',
    "flight.height_above": 'what heights are above: "home", or "ground" with [terrain]',
    "flight.speed_m_s": "over ground",
    "flight.settle_m_s": "who stops takes pictures once slower than this",
    "flight.max_airspeed_m_s": "what the airframe holds against the wind",
    "flight.accel_m_s2": "along and across paths that are flown without stopping",
    "flight.climb_m_s": "that the autopilot is set to; then climbed on the way, too",
    "flight.descent_m_s": "that the autopilot is set to, down to 10 m",
    "camera.hfov_deg": "field of view across the width of a picture",
    "camera.width_px": "of a picture",
    "camera.height_px": "of a picture",
    "camera.mounting": '"fixed" tilts with the airframe, "gimbal" looks straight down',
    "camera.yaw_deg": "bearing of the picture's upper edge from the nose",
    "camera.pitch_deg": "so far it looks forward of straight down",
    "camera.roll_deg": "so far it looks to the left of straight down",
    "camera.latency_s": "from the exposure until a picture is there",
    "camera.interval_s": "between two pictures",
    "camera.pixels_per_cell": "that the edge of a cell must have for the detector",
    "camera.pose_error_m": "how far off the rim of a picture may lie on the ground",
    "camera.exposure_s": "how long the shutter is open",
    "camera.max_blur_px": "what the flight may blur a picture by",
    "camera.hosts": "pictures may be fetched from these, too",
    "camera.calibration": "of recorded pictures: a file of OpenCV",
    "camera.noiseless": "only for a simulated camera without noise",
    "detector.name": "`threshold`, `paved`, `learned`, ...",
    "detector.model": "the file of a model, of a detector that has one",
    "detector.model_sha256": "of that file",
    "detector.intensity": "of threshold: darker than this is dark",
    "detector.dilations": "times that the bright part grows by a pixel",
    "detector.polarity": '"dark" or "bright": the region, beside the ground',
    "detector.greenness": "of paved: what is greener grows",
    "detector.share": "of a cell's pixels, to see the cell as region",
    "detector.view": '"cross", or "all": what a picture taken at rest judges',
    "votes.frames": "pictures of every cell",
    "votes.positive": "that must say yes",
    "votes.recorded": '"evidence" or "count", of recorded pictures (docs/replay.md)',
    "battery.capacity_wh": "of a full battery",
    "battery.hover_power_w": "while it hovers, with its camera",
    "battery.reserve": "share that is left at touch-down",
    "wind.speed_m_s": "the worst of the day",
    "wind.from_deg": "where it blows from, true bearing",
    "drift.speed_m_s": "of the region",
    "drift.toward_deg": "where it moves to, true bearing",
    "guardian.orphan_hold_s": "a vehicle whose mission process has died holds, then returns",
    "team.separation_m": "two airborne vehicles never come nearer",
    "team.layer_m": "height between two vehicles; more than the separation",
    "navigation.gnss_loss": '"rtl", "land"; on by "map" (own pictures) or "leapfrog"',
    "navigation.watch": 'hold positions against pictures; by default with "map"',
    "navigation.tolerated_m": "that satellites and pictures may disagree",
    "navigation.tag_m": "side of the marker on the mapper, for a leapfrog",
    "navigation.tag_dictionary": "of OpenCV; the mapper's number is 1",
    "vehicles.url": "where it is reached; or `uavmap fly --connect`",
    "vehicles.camera": "as `uavmap fly --camera` (docs/cameras.md)",
    "vehicles.home": "where it stands; without it in a row east of the start",
    "vehicles.home_height_m": "of its home above the start; else from `terrain.dem`, or 0",
    "vehicles.layer": "from 0, the lowest; shared by vehicles that work far apart",
    "terrain.dem": 'a GeoTIFF of heights beside this file, such as "dem.tif"',
    "terrain.source": '"autopilot": its own terrain database',
    "sim.autopilot": '"ardupilot" or "px4"',
    "sim.roi": "the true region; the one below is invented",
    "sim.roi_intensity": "how bright the region is painted",
    "sim.ground_intensity": "how bright the ground is painted",
    "sim.texture": "how uneven the ground is",
    "sim.sensor_noise": "of a pixel",
    "sim.illumination": "how much the light changes over the ground",
    "sim.gust_m_s": "of the wind",
    "sim.gps_sigma_m": "error of positions, standard deviation",
    "sim.gps_tau_s": "how long such an error lasts",
    "sim.optical_flow": "whether it flies on without satellites",
    "sim.odometry_drift": "share of the distance that flying on without satellites errs by",
    "sim.swap_s": "what the crew needs for a battery",
    "sim.tag_m": "marker on top of each vehicle; 0: none; by default in a leapfrog only",
    "sim.tag_dictionary": "of OpenCV; the number is the vehicle's; by default navigation's",
    "sim.terrain": "ground that is not level (docs/simulator.md)",
    "sim.quirks": "what real aircraft do (docs/simulator.md)",
    "sim.parameters": "of the simulated autopilot",
    "sim.faults": "what goes wrong, and when (docs/simulator.md)",
}
_LISTED_LAST: Final = frozenset({"sim.roi"})
_HIDDEN: Final = frozenset({"detector.tables"})
_UNSAID: Final = frozenset({"start.amsl_m"})
"""Whoever needs it asks for it where it is not said: its default is no height of any place."""


def mission_text(values: Values, header: Sequence[str], vehicles: int = 1) -> str:
    """Return the text of a mission file: a header, and every key with its value and a comment.

    Keys that are not in `values` have their defaults; keys without one are comments.
    """
    lines = [f"# {line}".rstrip() for line in header]
    lines += [
        "#",
        "# Positions are [latitude, longitude] in degrees (WGS84); angles are clockwise from true",
        "# north. A key that is left out takes its default; a key that is not known is an error.",
        "",
    ]
    for key, field in Mission.model_fields.items():
        if key == "vehicles":
            lines += _vehicles(vehicles)
        elif (section := section_of(field)) is None:
            lines += _line(key, key, field, values)
        else:
            lines += _section(key, section, values, optional=field.default is None)
    return "\n".join(lines) + "\n"


def section_of(field: FieldInfo) -> type[BaseModel] | None:
    """The table that a key stands for, if it is one."""
    kinds = (field.annotation, *getattr(field.annotation, "__args__", ()))
    return next((k for k in kinds if isinstance(k, type) and issubclass(k, BaseModel)), None)


def _section(
    name: str, section: type[BaseModel], values: Values, *, optional: bool
) -> Iterator[str]:
    yield ""
    yield f"# {SECTIONS[name]}"
    given = any(key.startswith(f"{name}.") for key in values)
    off = "# " if optional and not given else ""
    yield f"{off}[{name}]"
    for key, field in section.model_fields.items():
        full = f"{name}.{key}"
        if full not in _LISTED_LAST and full not in _HIDDEN:
            yield from _line(key, full, field, values)
    for full in sorted(_LISTED_LAST):
        if full.startswith(f"{name}.") and full in values:
            yield ""
            yield f"# {COMMENTS[full]}"
            yield f"[[{full}]]"
            yield from _rings("polygon", values[full])


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
    # a table of its own, or no default: shown, but not said
    missing = value is None or isinstance(value, BaseModel | Mapping) or value == ()
    missing |= full in _UNSAID and full not in values
    text = f"# {key} =" if missing else f"{key} = {tomlkit.item(value).as_string()}"
    yield f"{text:{_COLUMN - 1}} # {comment}".rstrip(" #")


def _rings(key: str, value: Any) -> Iterator[str]:
    """A position, a ring or several, a line a corner."""
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
    """The unit by the name of the key, and what is allowed by the schema."""
    unit = next((unit for suffix, unit in UNITS if key.endswith(suffix)), "")
    words = (("ge", "from"), ("gt", "above"), ("le", "up to"), ("lt", "below"))
    limits = [
        f"{word} {getattr(limit, name):g}"
        for name, word in words
        for limit in field.metadata
        if hasattr(limit, name)
    ]
    return ", ".join(filter(None, (unit, *limits)))
