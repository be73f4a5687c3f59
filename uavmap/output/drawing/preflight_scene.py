"""The scene of a mission before it is flown: search box, fence, lanes, homes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

from missions.flight.setting import Setting
from missions.mission.places import homes
from missions.mission.schema import positions
from missions.units import GridPoint
from uavmap.output.drawing import palette
from uavmap.output.drawing.map_scene import line_layer
from uavmap.output.drawing.palette import Style
from uavmap.output.drawing.scene import (
    Area,
    Dot,
    Entry,
    Label,
    Layer,
    Line,
    Scene,
    Shape,
    View,
    bounds_of,
)

_LISTED: Final = 6
"""Maximum number of vehicles in the legend."""
_TRANSFER_PX: Final = 0.6
_SIZE_PX: Final = 14.0
_NUMBERED_DOT: Final = ((7.5, palette.PAPER), (6.0, palette.INK))


def preflight_scene(setting: Setting, notes: Sequence[str] = ()) -> Scene:
    """Create the scene of a mission, with all of its fence in view."""
    mission = setting.mission
    box = _ring(setting, mission.search.box)
    fence, *holes = (_ring(setting, ring) for ring in (mission.fence.polygon, *mission.fence.holes))
    layers = [Layer((Area(box, palette.SEARCHED),), (Entry(palette.SEARCHED, "area to search"),))]
    if holes:
        areas = tuple(Area(hole, palette.HOLE) for hole in holes)
        layers.append(Layer(areas, (Entry(palette.HOLE, "hole of the fence"),)))
    layers += [
        _lanes(setting),
        line_layer("box", [box], closed=True),
        line_layer("fence", (fence, *holes), closed=True),
        _homes(setting),
        _sizes(box),
    ]
    layers_m = ", ".join(f"{height_m:g} m" for height_m in _heights_m(setting)[:_LISTED])
    subtitle = f"{mission.strategy}, {len(mission.vehicles)} vehicles, at {layers_m}"
    if len(mission.vehicles) == 1:
        subtitle = f"{mission.strategy}, 1 vehicle, at {layers_m}"
    elif len(mission.vehicles) > _LISTED:
        subtitle += ", ..."
    view = View.around(bounds_of(fence))
    return Scene(f"Plan of {mission.name}", subtitle, view, tuple(layers), notes=tuple(notes))


def _heights_m(setting: Setting) -> list[float]:
    mission = setting.mission
    return [mission.top_altitude_m(i) for i in range(len(mission.vehicles))]


def _lanes(setting: Setting) -> Layer:
    lines, entries = [], []
    for i, share in enumerate(setting.shares):
        thin, thick = (
            Style(palette.track_colour(i), width_px) for width_px in (_TRANSFER_PX, palette.LANE_PX)
        )
        lines += [Line.through((before[1], lane[0]), thin) for before, lane in pairwise(share)]
        lines += [Line.through(lane, thick) for lane in share]
    heights_m = _heights_m(setting)
    for i, height_m in enumerate(heights_m[:_LISTED]):
        text = f"lanes of vehicle {i + 1}, at {height_m:g} m"
        entries.append(Entry(Style(palette.track_colour(i), palette.LANE_PX), text))
    if more := len(heights_m[_LISTED:]):
        entries.append(
            Entry(Style(palette.track_colour(0), palette.LANE_PX), f"... and {more} vehicles more")
        )
    return Layer(tuple(lines), tuple(entries))


def _homes(setting: Setting) -> Layer:
    pads = [setting.grid.fixed(place) for place in homes(setting.mission)]
    if len(pads) == 1:
        return Layer((Dot(pads[0], palette.HOME_DOT),), (Entry(palette.HOME_DOT, "home"),))
    marks: list[Shape] = []
    for i, pad in enumerate(pads):
        marks += [Dot(pad, _NUMBERED_DOT), Label(pad, str(i + 1), 10.0, palette.PAPER, "middle")]
    return Layer(tuple(marks), (Entry(_NUMBERED_DOT, "homes, numbered"),))


def _sizes(box: Sequence[GridPoint]) -> Layer:
    west, south, east, north = bounds_of(box)
    middle = (west + east) / 2.0, (south + north) / 2.0
    across, up = f"{east - west:.0f} m", f"{north - south:.0f} m"
    below = Label((middle[0], south), across, _SIZE_PX, palette.INK, "middle", (0.0, 14.0))
    return Layer((below, Label((west, middle[1]), up, _SIZE_PX, palette.INK, "end", (-10.0, 0.0))))


def _ring(setting: Setting, ring: Sequence[tuple[float, float]]) -> tuple[GridPoint, ...]:
    return tuple(setting.grid.fixed(place) for place in positions(tuple(ring)))
