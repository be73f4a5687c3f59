"""The map of a report as SVG: cells, lines, a graticule in degrees, a scale, north."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import shapely
from markupsafe import Markup, escape
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from missions.units import GridPoint
from uavmap.results.boundary_told import BoundaryTold
from uavmap.results.flown import Flown
from uavmap.results.legend import nice_length_m
from uavmap.results.outline import runs
from uavmap.results.palette import (
    BOUNDARY,
    OUTLINE,
    STATES,
    TRUTH,
    UNSEARCHED,
    Colour,
    track_colour,
)
from uavmap.results.picture import BOX, FENCE, INK, NAMES
from uavmap.results.view import View, ground, ring_on_map, track_on_map, view_of

MARGIN_PX: Final = 46
_LINES: Final = 4
"""About so many lines of the graticule cross a map."""
_LEAST_PX: Final = 0.4
"""Points of a line that lie nearer to each other than that are left out."""


class Legend(NamedTuple):
    """A line of the legend: a sample, and what it stands for."""

    sample: Markup
    text: str


class Corner(NamedTuple):
    """A corner of the map."""

    name: str
    lat_deg: float
    lon_deg: float
    east_m: float
    north_m: float


@dataclass(frozen=True, slots=True)
class Drawing:
    """The map and what belongs beside it."""

    svg: Markup
    legend: tuple[Legend, ...]
    corners: tuple[Corner, ...]
    true_north_deg: float
    """From the map's upward direction to true north, clockwise."""


def draw_map(flown: Flown, boundary: BoundaryTold | None) -> Drawing:
    """The drawing."""
    view = view_of(flown.data)
    width, height = view.width_px + 2 * MARGIN_PX, view.height_px + 2 * MARGIN_PX
    marks = "\n".join(_marks(flown, view, boundary))
    frame = (
        f'<rect width="{view.width_px}" height="{view.height_px}" fill="none" stroke="{css(INK)}"/>'
    )
    svg = Markup(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img" '
        'aria-label="map">'
        f'<defs><clipPath id="map"><rect width="{view.width_px}" height="{view.height_px}"/>'
        f'</clipPath></defs><g transform="translate({MARGIN_PX} {MARGIN_PX})">'
        f'<rect width="{view.width_px}" height="{view.height_px}" fill="#f7f7f3"/>'
        f'<g clip-path="url(#map)">\n{marks}\n</g>{frame}\n{_graticule(flown, view)}\n'
        f"{_scale(view)}</g></svg>"
    )
    convergence_deg = math.degrees(flown.data.grid.convergence_rad)
    legend = tuple(_legend(flown, boundary))
    return Drawing(svg, legend, tuple(_corners(flown, view)), -convergence_deg)


def css(colour: Colour) -> str:
    """A colour as style sheets write it.

    >>> css((255, 0, 16))
    '#ff0010'
    """
    return "#" + "".join(f"{channel:02x}" for channel in colour)


# --- what is on the map --------------------------------------------------------------------------
def _marks(flown: Flown, view: View, boundary: BoundaryTold | None) -> Iterator[str]:
    data = flown.data
    yield from _cells(flown, view)
    yield _rings(_rings_of(flown, flown.extent.outline), view, OUTLINE, 2.5)
    if data.truth is not None:
        yield _rings(_rings_of(flown, data.truth), view, TRUTH, 1.6)
    if boundary is not None:
        yield _rings(_coordinates(boundary.region), view, BOUNDARY, 1.4)
    for track in data.tracks:
        points = np.array(track_on_map(data, track), dtype=np.float64)
        yield _line(points, view, track_colour(track.vehicle), 1.1, 'stroke-opacity="0.75"')
    for lane in data.unsearched:
        yield _line(np.array(ring_on_map(data, lane)), view, UNSEARCHED, 3.0)
    dashed = 'stroke-dasharray="9 7"'
    yield _rings([_closed(ring_on_map(data, data.box))], view, BOX, 1.6, dashed)
    fences = [_closed(ring_on_map(data, ring)) for ring in (data.fence, *data.fence_holes)]
    yield _rings(fences, view, FENCE, 1.6, 'stroke-dasharray="4 4"')
    x, y = view.pixel(data.grid.fixed(data.start))
    yield (
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5" fill="{css(INK)}" stroke="#fff" '
        'stroke-width="1.5"/>'
    )


def _cells(flown: Flown, view: View) -> Iterator[str]:
    """A path a state: neighbours in a row are one rectangle."""
    data, cell_m = flown.data, flown.data.grid.cell_m
    size = cell_m * view.px_per_m
    for state, colour in STATES.items():
        cells = data.table.cells[data.table.are(state)]
        if not len(cells):
            continue
        parts = []
        for north, first, last in runs(cells):
            corner = GridPoint((first - 0.5) * cell_m, (north + 0.5) * cell_m)
            x, y = view.pixel(ground(data, corner))
            wide = (last - first + 1) * size
            parts.append(f"M{x:.1f} {y:.1f}h{wide:.2f}v{size:.2f}h{-wide:.2f}z")
        yield f'<path d="{"".join(parts)}" fill="{css(colour)}" shape-rendering="crispEdges"/>'


def _rings_of(flown: Flown, shape: BaseGeometry) -> list[NDArray[np.float64]]:
    """The rings of a shape of the moving frame, where they are at the time of the map."""
    move = np.array(ground(flown.data, GridPoint(0.0, 0.0)))
    return [ring + move for ring in _coordinates(shape)]


def _coordinates(shape: BaseGeometry) -> list[NDArray[np.float64]]:
    areas = [part for part in shapely.get_parts(shape) if part.geom_type == "Polygon"]
    return [
        shapely.get_coordinates(ring)
        for area in areas
        if not area.is_empty
        for ring in (area.exterior, *area.interiors)
    ]


def _closed(points: Sequence[GridPoint]) -> NDArray[np.float64]:
    return np.array([*points, points[0]], dtype=np.float64)


def _rings(
    rings: Iterable[NDArray[np.float64]], view: View, colour: Colour, width: float, more: str = ""
) -> str:
    path = "".join(f"{_path(ring, view)}z" for ring in rings)
    return (
        f'<path d="{path}" fill="none" stroke="{css(colour)}" stroke-width="{width:g}" '
        f'stroke-linejoin="round" {more}/>'
    )


def _line(
    points: NDArray[np.float64], view: View, colour: Colour, width: float, more: str = ""
) -> str:
    if len(points) < 2:
        return ""
    return (
        f'<path d="{_path(points, view)}" fill="none" stroke="{css(colour)}" '
        f'stroke-width="{width:g}" stroke-linejoin="round" {more}/>'
    )


def _path(points: NDArray[np.float64], view: View) -> str:
    """Points of the ground as a path, without those that nobody could tell apart."""
    pixels = (points - [view.left_m, view.top_m]) * [view.px_per_m, -view.px_per_m]
    far = np.hypot(*np.diff(pixels, axis=0).T) >= _LEAST_PX
    pixels = pixels[np.concatenate([[True], far])]
    return "M" + " ".join(f"{x:.1f},{y:.1f}" for x, y in pixels.tolist())


# --- around the map ------------------------------------------------------------------------------
def _graticule(flown: Flown, view: View) -> str:
    """Lines of equal longitude and latitude, with their degrees at the rim."""
    corners = list(_corners(flown, view))
    lats, lons = [c.lat_deg for c in corners], [c.lon_deg for c in corners]
    grid = flown.data.grid
    origin = np.array([grid.origin.east_m, grid.origin.north_m])
    parts, steps = [], np.linspace(0.0, 1.0, 5)
    for along, across, letters in ((lons, lats, "EW"), (lats, lons, "NS")):
        step = nice_degrees((max(along) - min(along)) / _LINES)
        digits = max(0, -math.floor(math.log10(step) + 1e-9))
        for k in range(math.ceil(min(along) / step), math.floor(max(along) / step) + 1):
            value = k * step
            other = min(across) + steps * (max(across) - min(across))
            same = np.full_like(other, value)
            places = np.column_stack([same, other] if letters == "EW" else [other, same])
            points = (grid.zone.utm(places) - origin) / grid.scale
            parts.append(
                f'<path d="{_path(points, view)}" fill="none" stroke="#787e84" '
                'stroke-width="0.6" clip-path="url(#map)"/>'
            )
            pixels = (points - [view.left_m, view.top_m]) * [view.px_per_m, -view.px_per_m]
            parts.append(_degrees(pixels, view, value, digits, letters))
    return "\n".join(parts)


def _degrees(
    pixels: NDArray[np.float64], view: View, value: float, digits: int, letters: str
) -> str:
    """The label of a line, where it meets the lower or the left rim."""
    turned = (value + 180.0) % 360.0 - 180.0 if letters == "EW" else value
    text = f"{abs(turned):.{digits}f}° {letters[turned < 0]}"
    if letters == "EW":
        x = float(np.interp(view.height_px, pixels[::-1, 1], pixels[::-1, 0]))
        if not 0 <= x <= view.width_px:
            return ""
        return _text(x, view.height_px + 16, text)
    y = float(np.interp(0.0, pixels[:, 0], pixels[:, 1]))
    if not 0 <= y <= view.height_px:
        return ""
    return _text(-8, y, text, turn=True)


def nice_degrees(about: float) -> float:
    """The next step of 1, 2 or 5 times a power of ten, of degrees.

    >>> nice_degrees(0.00031), nice_degrees(0.7)
    (0.0005, 1.0)
    """
    power = 10.0 ** math.floor(math.log10(max(about, 1e-9)))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= 0.999999 * about)


def _text(x: float, y: float, text: str, *, turn: bool = False) -> str:
    turned = f' transform="rotate(-90 {x:.1f} {y:.1f})"' if turn else ""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="middle" font-size="12"{turned}>'
        f"{escape(text)}</text>"
    )


def _scale(view: View) -> str:
    """A bar of a round length below the map, and an arrow above its right corner."""
    length_m = nice_length_m(190.0 / view.px_per_m)
    length, y = length_m * view.px_per_m, view.height_px + 26
    bar = (
        f'<rect x="0" y="{y}" width="{length:.1f}" height="6" fill="#fff" stroke="{css(INK)}"/>'
        f'<rect x="0" y="{y}" width="{length / 2:.1f}" height="6" fill="{css(INK)}"/>'
        f'<text x="{length + 8:.1f}" y="{y + 7}" font-size="12">{length_m:g} m</text>'
    )
    x = view.width_px - 10
    arrow = (
        f'<path d="M{x} -38L{x - 8} -6L{x} -13L{x + 8} -6Z" fill="{css(INK)}"/>'
        f'<text x="{x - 14}" y="-14" text-anchor="end" font-size="12">grid north</text>'
    )
    return bar + arrow


def _corners(flown: Flown, view: View) -> Iterator[Corner]:
    """The corners in degrees, in the turn of the start's, and in metres of the projection."""
    grid, start = flown.data.grid, flown.data.start
    east = (view.left_m, view.left_m + view.width_px / view.px_per_m)
    north = (view.top_m, view.top_m - view.height_px / view.px_per_m)
    named = (("NW", 0, 0), ("NE", 1, 0), ("SE", 1, 1), ("SW", 0, 1))
    for name, i, k in named:
        utm = np.array([[
            grid.origin.east_m + east[i] * grid.scale, grid.origin.north_m + north[k] * grid.scale
        ]])  # fmt: skip
        ((lon, lat),) = grid.zone.lon_lat(utm).tolist()
        lon += 360.0 * round((start.lon_deg - lon) / 360.0)
        yield Corner(name, lat, lon, *utm[0].tolist())


# --- the legend ----------------------------------------------------------------------------------
def _legend(flown: Flown, boundary: BoundaryTold | None) -> Iterator[Legend]:
    data = flown.data
    counts = data.table.counts()
    for state, colour in STATES.items():
        if count := counts.get(state, 0):
            name = "region" if flown.recorded and state == "explored" else NAMES.get(state, state)
            yield Legend(_square(colour), f"{name} ({count})")
    yield Legend(_stroke(OUTLINE, 2.5), "outline of the cells")
    if boundary is not None:
        yield Legend(_stroke(BOUNDARY, 2.0), "boundary by pixels")
    if data.truth is not None:
        yield Legend(_stroke(TRUTH, 1.6), "true region")
    for track in data.tracks:
        told = "way of the camera" if flown.recorded else f"track of vehicle {track.vehicle}"
        yield Legend(_stroke(track_colour(track.vehicle), 1.4), told)
    if data.unsearched:
        yield Legend(_stroke(UNSEARCHED, 3.0), "search lane without a judged frame")
    yield Legend(_stroke(BOX, 1.6, "9 7"), "search box")
    yield Legend(_stroke(FENCE, 1.6, "4 4"), "geofence")


def _square(colour: Colour) -> Markup:
    return Markup(
        f'<svg class="sample" viewBox="0 0 30 16"><rect x="7" y="1" width="16" height="14" '
        f'fill="{css(colour)}" stroke="#787e84"/></svg>'
    )


def _stroke(colour: Colour, width: float, dashes: str = "none") -> Markup:
    return Markup(
        f'<svg class="sample" viewBox="0 0 30 16"><path d="M0 8H30" stroke="{css(colour)}" '
        f'stroke-width="{width:g}" stroke-dasharray="{dashes}"/></svg>'
    )
