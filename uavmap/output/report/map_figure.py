"""The map of a report: the scene of the flight under a graticule in degrees, and its corners."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, Literal, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from uavmap.output.drawing.map_scene import map_scene
from uavmap.output.drawing.palette import FAINT, INK, Style
from uavmap.output.drawing.scene import Label, Line, Scene, View
from uavmap.output.drawing.sheet import step_up
from uavmap.output.facts.flown_mission import FlownMission
from uavmap.output.facts.map_model import drift_m, on_ground

_LINES: Final = 4
"""Approximate number of graticule lines across a map."""
_MIN_DEG: Final = 1e-9
_LABEL_PX: Final = 12.0
_STYLE: Final = Style(FAINT, 0.6)


CORNER_HEADS: Final = ("Corner", "Latitude", "Longitude", "Easting, m", "Northing, m")


class Corner(NamedTuple):
    """A corner of the map."""

    name: str
    lat_deg: float
    lon_deg: float
    east_m: float
    north_m: float

    def row(self) -> tuple[str, ...]:
        """Return the corner as a row under `CORNER_HEADS`."""
        return (
            self.name,
            f"{self.lat_deg:.6f}",
            f"{self.lon_deg:.6f}",
            f"{self.east_m:.1f}",
            f"{self.north_m:.1f}",
        )


@dataclass(frozen=True, slots=True)
class MapFigure:
    """The map of a report, with the data around it."""

    scene: Scene
    lines: tuple[Line, ...]
    """The graticule, in metres."""
    labels: tuple[Label, ...]
    """The degrees of the graticule, in pixels from the map's upper left corner."""
    corners: tuple[Corner, ...]
    true_north_deg: float
    """Direction of true north, clockwise from the map's upward direction."""


def map_figure(flown: FlownMission, size_px: tuple[int, int] | None = None) -> MapFigure:
    """Create the map, with the boundary at pixel level if there is one; `size_px` is its size."""
    data, boundary = flown.data, flown.boundary
    if boundary is not None:
        moved_m = drift_m(data.grid, data.t_s)
        region = shapely.transform(boundary.region, lambda points: points - moved_m)
        data = data.with_boundary(region)
    scene = map_scene(data)
    if size_px is not None:
        scene = replace(scene, view=scene.view.sized(*size_px))
    corners = tuple(_corners(flown, scene.view))
    lines, labels = _graticule(flown, scene.view, corners)
    true_north_deg = -math.degrees(data.grid.convergence_rad)
    return MapFigure(scene, tuple(lines), tuple(labels), corners, true_north_deg)


def _graticule(
    flown: FlownMission, view: View, corners: tuple[Corner, ...]
) -> tuple[list[Line], list[Label]]:
    lats, lons = [c.lat_deg for c in corners], [c.lon_deg for c in corners]
    lines: list[Line] = []
    labels: list[Label] = []
    for along, across, letters in ((lons, lats, "EW"), (lats, lons, "NS")):
        step = step_up(max((max(along) - min(along)) / _LINES, _MIN_DEG))
        digits = max(0, -math.floor(math.log10(step) + 1e-9))
        other = np.linspace(min(across), max(across), 5)
        for k in range(math.ceil(min(along) / step), math.floor(max(along) / step) + 1):
            same = np.full_like(other, k * step)
            places = np.column_stack([same, other] if letters == "EW" else [other, same])
            line = Line(on_ground(places, flown.data.grid), _STYLE)
            lines.append(line)
            labels += _degrees(view.pixels(line.places), view, k * step, digits, letters)
    return lines, labels


def _degrees(
    pixels: NDArray[np.float64], view: View, value: float, digits: int, letters: str
) -> Iterator[Label]:
    turned = (value + 180.0) % 360.0 - 180.0 if letters == "EW" else value
    text = f"{abs(turned):.{digits}f}° {letters[turned < 0]}"
    anchor: Literal["middle", "end"]
    if letters == "EW":
        x = float(np.interp(view.height_px, pixels[::-1, 1], pixels[::-1, 0]))
        place, inside, anchor = (x, view.height_px + 12.0), 0 <= x <= view.width_px, "middle"
    else:
        y = float(np.interp(0.0, pixels[:, 0], pixels[:, 1]))
        place, inside, anchor = (-6.0, y), 0 <= y <= view.height_px, "end"
    if inside:
        yield Label(place, text, _LABEL_PX, INK, anchor)


def _corners(flown: FlownMission, view: View) -> Iterator[Corner]:
    """Yield the corners in degrees, within 180 degrees of the start, and in projected metres."""
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
