"""The scenes of a flown map, and of a mission before it is flown."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.flight.state import Setting
from missions.mission.places import homes
from missions.mission.schema import positions
from missions.units import GridPoint, LatLon
from uavmap.output.drawing import palette
from uavmap.output.drawing.palette import Colour, Style
from uavmap.output.drawing.scene import (
    Area,
    Cells,
    Dot,
    Entry,
    Label,
    Layer,
    Line,
    Place,
    Scene,
    Shape,
    View,
    bounds_of,
    rings_of,
)
from uavmap.output.facts.map_model import NOT_ROI, MapData, Track, drift_m

Photograph = Callable[[View], NDArray[np.uint8] | None]
"""A function that draws the photograph of the ground in a view: shape (rows, columns, 4). The last
channel is 255 for each pixel that a picture shows."""

_FENCE_ROOM = 2.2
"""Maximum enlargement of the map, as a factor, for which the whole fence is shown."""


def map_scene(data: MapData) -> Scene:
    """Create the scene of a map at the time of the map."""
    moved_m = drift_m(data.grid, data.t_s)

    def moved(name: str, rings: Iterable[NDArray[np.float64]]) -> Layer:
        return line_layer(name, (ring + moved_m for ring in rings))

    cells, states = _cells(data)
    layers = [states, _tracks(data), moved("outline", rings_of(data.outline))]
    if data.boundary is not None:
        layers.append(moved("boundary", rings_of(data.boundary)))
    if data.truth is not None:
        layers.append(moved("truth", rings_of(data.truth)))
    if data.unsearched:
        layers.append(line_layer("unsearched", (_fixed(data, lane) for lane in data.unsearched)))
    if data.box:  # a replay without a mission has none
        layers.append(line_layer("box", [_fixed(data, data.box)], closed=True))
    if data.fence:
        fences = [_fixed(data, ring) for ring in (data.fence, *data.fence_holes)]
        layers.append(line_layer("fence", fences, closed=True))
    if data.pictures is None:
        home = Dot(data.grid.fixed(data.start), palette.HOME_DOT)
        layers.append(Layer((home,), (Entry(palette.HOME_DOT, "home"),)))
    return Scene(data.mission, _subtitle(data), map_view(data), tuple(layers), cells)


def line_layer(name: str, lines: Iterable[Iterable[Place]], *, closed: bool = False) -> Layer:
    """Create the layer of a named line (`palette.LINES`)."""
    text, style = palette.LINES[name]
    shapes = tuple(Line.through(line, style, closed=closed) for line in lines)
    return Layer(shapes, (Entry(style, text),))


def map_view(data: MapData) -> View:
    """Create the view of cells, tracks, truth, box and home, and of a fence that is near."""
    points = [data.grid.fixed(data.start), *_fixed(data, data.box)]
    if len(data.cells):
        cell_m, moved_m = data.grid.cell_m, drift_m(data.grid, data.t_s)
        low, high = data.cells.cells.min(axis=0), data.cells.cells.max(axis=0)
        corners_m = low * cell_m - cell_m / 2 + moved_m, high * cell_m + cell_m / 2 + moved_m
        points += [GridPoint(*corner_m.tolist()) for corner_m in corners_m]
    points += [point for track in data.tracks for point in _track(data, track)]
    if data.truth is not None and not data.truth.is_empty:
        west, south, east, north = data.truth.bounds
        corners = GridPoint(west, south), GridPoint(east, north)
        points += [data.grid.to_fixed(corner, data.t_s) for corner in corners]
    near, whole = bounds_of(points), bounds_of([*points, *_fixed(data, data.fence)])
    near_m2, whole_m2 = (
        (east - west) * (north - south) for west, south, east, north in (near, whole)
    )
    shown = whole if whole_m2 <= _FENCE_ROOM * near_m2 else near
    return View.around(shown, data.grid.cell_m)


def _cells(data: MapData) -> tuple[Cells, Layer]:
    table, grid = data.cells, data.grid
    names = palette.STATE_NAMES if data.pictures is None else palette.RECORDED_NAMES
    codes = np.zeros(len(table.cells), np.uint8)
    entries = []
    colours, opaque = list[Colour](), list[bool]()
    classes, which = data.class_areas, table.classes
    for state, colour in palette.STATES.items():
        there = table.in_state(state) & (which < 0)
        codes[there] = len(colours)
        colours.append(colour)
        opaque.append(state not in NOT_ROI or state == "unsure")
        if count := np.count_nonzero(there):
            entries.append(Entry(colour, f"{names[state]} ({count})"))
    for column, one in enumerate(classes):
        colour = palette.class_colour(one.number)
        codes[which == column] = len(colours)
        colours.append(colour)
        opaque.append(True)
        if one.cells:
            entries.append(Entry(colour, f"{one.name} ({len(one.cells)})"))
    origin = grid.to_fixed(GridPoint(0.0, 0.0), data.t_s)
    cells = Cells(table.cells, codes, tuple(colours), grid.cell_m, origin, tuple(opaque))
    return cells, Layer((), tuple(entries))


def _tracks(data: MapData) -> Layer:
    lines, entries = [], []
    for track in data.tracks:
        style = Style(palette.track_colour(track.vehicle), palette.TRACK_PX)
        text = "track" if len(data.tracks) == 1 else f"track of vehicle {track.vehicle}"
        lines.append(Line.through(_track(data, track), style))
        entries.append(Entry(style, text if data.pictures is None else "path of the camera"))
    return Layer(tuple(lines), tuple(entries))


def _track(data: MapData, track: Track) -> Iterator[GridPoint]:
    """Yield a track in the frame of the region: over the cells for which it was flown."""
    grid = data.grid
    for t_s, place, _ in track.points:
        yield grid.to_fixed(grid.to_moving(grid.fixed(place), t_s), data.t_s)


def _subtitle(data: MapData) -> str:
    cells, minutes = np.count_nonzero(data.cells.roi), divmod(round(data.t_s), 60)
    after = f"after {minutes[0]}:{minutes[1]:02d} min"
    if data.pictures is not None:
        after = f"from {data.pictures} pictures"
    area_m2 = cells * data.grid.cell_m**2
    drift = data.grid.drift_speed_m_s
    return f"{cells} cells of {data.grid.cell_m:g} m, {area_m2:,.0f} sq m  ·  {after}" + (
        f"  ·  drifting {drift:g} m/s; tracks as seen from the region" if drift else ""
    )


def _fixed(data: MapData, places: Iterable[LatLon]) -> list[GridPoint]:
    return [data.grid.fixed(place) for place in places]


# --- before a flight ------------------------------------------------------------------------------
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
            Style(palette.track_colour(i + 1), width_px)
            for width_px in (_TRANSFER_PX, palette.LANE_PX)
        )
        lines += [Line.through((before[1], lane[0]), thin) for before, lane in pairwise(share)]
        lines += [Line.through(lane, thick) for lane in share]
    heights_m = _heights_m(setting)
    for i, height_m in enumerate(heights_m[:_LISTED]):
        text = f"lanes of vehicle {i + 1}, at {height_m:g} m"
        entries.append(Entry(Style(palette.track_colour(i + 1), palette.LANE_PX), text))
    if more := len(heights_m[_LISTED:]):
        entries.append(
            Entry(Style(palette.track_colour(0), palette.LANE_PX), f"{more} more vehicles")
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
