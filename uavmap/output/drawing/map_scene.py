"""The scene of a flown map: cells, tracks, outline, boundary, truth, fence, search box, home."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from missions.units import GridPoint, LatLon
from uavmap.output.drawing import palette
from uavmap.output.drawing.palette import Style
from uavmap.output.drawing.scene import (
    Cells,
    Dot,
    Entry,
    Layer,
    Line,
    Place,
    Scene,
    View,
    bounds_of,
    rings_of,
)
from uavmap.output.facts.map_model import NOT_ROI, MapData, Track, drift_m

Photograph = Callable[[View], NDArray[np.uint8] | None]
"""Makes the photograph of the ground in a view: shape (rows, columns, 4), red, green, blue, and 255
where there is any."""

_FENCE_ROOM = 2.2
"""A fence is shown whole while that makes the map at most this many times larger."""


def map_scene(data: MapData) -> Scene:
    """Create the scene of a map, as it is at the time of the map."""
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
    fences = [_fixed(data, ring) for ring in (data.fence, *data.fence_holes)]
    layers += [
        line_layer("box", [_fixed(data, data.box)], closed=True),
        line_layer("fence", fences, closed=True),
        Layer(
            (Dot(data.grid.fixed(data.start), palette.HOME_DOT),),
            (Entry(palette.HOME_DOT, "home"),),
        ),
    ]
    return Scene(data.mission, _subtitle(data), map_view(data), tuple(layers), cells)


def line_layer(name: str, lines: Iterable[Iterable[Place]], *, closed: bool = False) -> Layer:
    """Create the layer of a named line (`palette.LINES`)."""
    text, style = palette.LINES[name]
    shapes = tuple(Line.through(line, style, closed=closed) for line in lines)
    return Layer(shapes, (Entry(style, text),))


def map_view(data: MapData) -> View:
    """Create the view of cells, tracks, truth, box and home, and of a fence that is near."""
    points = [data.grid.fixed(data.start), *_fixed(data, data.box)]
    if len(data.squares):
        low, high = data.squares[:, :2].min(axis=0), data.squares[:, 2:].max(axis=0)
        points += [GridPoint(*low.tolist()), GridPoint(*high.tolist())]
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
    for code, (state, colour) in enumerate(palette.STATES.items()):
        there = table.are(state)
        codes[there] = code
        if count := np.count_nonzero(there):
            entries.append(Entry(colour, f"{names[state]} ({count})"))
    origin = grid.to_fixed(GridPoint(0.0, 0.0), data.t_s)
    opaque = tuple(state not in NOT_ROI for state in palette.STATES)
    cells = Cells(table.cells, codes, tuple(palette.STATES.values()), grid.cell_m, origin, opaque)
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
    """Yield a track as seen from the region: over the cells it was flown for."""
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
