"""Results as a plot of matplotlib, in the colours of `map.png`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import shapely
from shapely.geometry.base import BaseGeometry

from missions.errors import UavmapError
from uavmap.base.extras import install_command
from uavmap.output.drawing.palette import (
    LINES,
    STATE_NAMES,
    STATES,
    TRACK_PX,
    Colour,
    Style,
    track_colour,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_POINTS_A_PIXEL = 0.65


@dataclass(frozen=True, slots=True)
class Plot:
    """What is drawn, in metres of the UTM zone `utm_crs`; `squares` by the cells' state."""

    squares: Mapping[str, Sequence[BaseGeometry]]
    region: BaseGeometry
    boundary: BaseGeometry | None
    tracks: Mapping[int, BaseGeometry]
    utm_crs: str
    title: str


def draw(plot: Plot, ax: Axes | None) -> Axes:
    """Draw cells by state, the outline, the boundary and the tracks, in metres of the UTM zone.

    Raises `UavmapError` where matplotlib is not installed.
    """
    try:
        from matplotlib import pyplot as plt  # noqa: PLC0415 - an extra, and heavy
        from matplotlib.collections import PolyCollection  # noqa: PLC0415
    except ImportError:
        raise UavmapError(f"a plot needs matplotlib: {install_command('study')}") from None
    if ax is None:
        ax = plt.subplots(figsize=(7.0, 7.0), layout="constrained")[1]
    for state, colour in STATES.items():
        squares = [shapely.get_coordinates(cell) for cell in plot.squares.get(state, ())]
        if squares:
            label = f"{STATE_NAMES[state]} ({len(squares)})"
            ax.add_collection(
                PolyCollection(
                    squares, facecolor=_rgb(colour), edgecolor="white", linewidth=0.3, label=label
                )
            )
    _lines(ax, shapely.boundary(plot.region), *LINES["outline"])
    if plot.boundary is not None:
        _lines(ax, shapely.boundary(plot.boundary), *LINES["boundary"])
    for number, track in plot.tracks.items():
        label = "track" if len(plot.tracks) == 1 else f"track of vehicle {number}"
        _lines(ax, track, label, Style(track_colour(number), TRACK_PX))
    ax.autoscale_view()
    ax.set_aspect("equal")
    ax.ticklabel_format(useOffset=False, style="plain")
    ax.tick_params(labelsize="small")
    ax.set_xlabel(f"easting, m ({plot.utm_crs})")
    ax.set_ylabel("northing, m")
    ax.set_title(plot.title, fontsize="small")
    ax.legend(fontsize="small", loc="best")
    return ax


def _lines(ax: Axes, lines: BaseGeometry, label: str, style: Style) -> None:
    width = _POINTS_A_PIXEL * style.width_px
    for part in shapely.get_parts(lines):
        places = shapely.get_coordinates(part)
        ax.plot(places[:, 0], places[:, 1], color=_rgb(style.colour), linewidth=width, label=label)
        label = "_"  # the first alone is in the legend


def _rgb(colour: Colour) -> tuple[float, float, float]:
    red, green, blue = (channel / 255.0 for channel in colour)
    return red, green, blue
