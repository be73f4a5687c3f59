"""The timeline of a report: sorties, charge and faults of each vehicle, as shapes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from uavmap.output.drawing.palette import (
    FAINT,
    FENCE,
    INK,
    LAND,
    PAPER,
    UNSEARCHED,
    Colour,
    Style,
    track_colour,
)
from uavmap.output.drawing.scene import Area, Box, Dot, Label, Line, Shape, View
from uavmap.output.facts.flight_log import Sortie
from uavmap.output.facts.flown_mission import FlownMission
from uavmap.output.report.facts import minutes

LEFT_PX: Final = 70.0
_AXIS_PX: Final = 42.0
_RIGHT_PX: Final = 16.0
_BAR_PX: Final = 15.0
_GAP_PX: Final = 4.0
_POINTS: Final = 300
_TICK_PX: Final = 70.0
"""Minimum distance of two labels of the axis, px."""
_TICKS: Final = (10, 20, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 14400, 28800, 86400)
_MARKS: Final = 200
_SWAP_DOT: Final = ((5.5, INK), (4.0, PAPER))
_PALE: Final = 0.4


class Timeline(NamedTuple):
    """The shapes of a timeline, and the page on which they stand."""

    view: View
    shapes: tuple[Shape, ...]
    left_out: int
    """Number of vehicles without a row."""


def timeline(flown: FlownMission, width_px: float, row_px: float, most: int) -> Timeline | None:
    """Draw the timeline of at most `most` vehicles; None for a replay, or without a sortie."""
    sorties = flown.log.sorties()
    if flown.recorded or not sorties:
        return None
    vehicles = sorted({sortie.vehicle for sortie in sorties})
    end_s = max(1.0, flown.data.t_s, *(sortie.end_s for sortie in sorties))
    px_per_s = (width_px - LEFT_PX - _RIGHT_PX) / end_s
    shapes: list[Shape] = []
    for number, vehicle in enumerate(vehicles[:most]):
        own = [sortie for sortie in sorties if sortie.vehicle == vehicle]
        band = (number * row_px, row_px)
        shapes.extend(_row(flown, vehicle, own, band, px_per_s))
    low = min(len(vehicles), most) * row_px
    shapes.extend(_axis(flown, end_s, px_per_s, low))
    view = View.page(width_px, low + _AXIS_PX)
    return Timeline(view, tuple(shapes), max(0, len(vehicles) - most))


def _row(
    flown: FlownMission,
    vehicle: int,
    sorties: Sequence[Sortie],
    band: tuple[float, float],
    px_per_s: float,
) -> Iterator[Shape]:
    top, high = band[0] + 8.0, band[1] - 8.0
    yield Label((0.0, top + _BAR_PX / 2.0), f"vehicle {vehicle}", 13.0, INK)
    yield from _charge(flown, vehicle, (top + _BAR_PX + _GAP_PX, top + high - _GAP_PX), px_per_s)
    for sortie in sorties:
        left, right = LEFT_PX + sortie.start_s * px_per_s, LEFT_PX + sortie.end_s * px_per_s
        colour = track_colour(vehicle)
        shown = colour if sortie.ended else _pale(colour)
        yield Box((left, top), (max(right, left + 1.0), top + _BAR_PX), shown)
        yield Label((left + 3.0, top + _BAR_PX / 2.0), str(sortie.number), 11.0, PAPER)
    for number, t_s in flown.log.swaps:
        if number == vehicle:
            yield Dot((LEFT_PX + t_s * px_per_s, top + _BAR_PX / 2.0), _SWAP_DOT)
    troubles = [t for t in flown.log.troubles if t.vehicle in (vehicle, 0) and t.kind != "text"]
    for trouble in troubles[:_MARKS]:
        x = LEFT_PX + trouble.t_s * px_per_s
        yield Area(((x, top + 2.0), (x - 4.0, top - 6.0), (x + 4.0, top - 6.0)), UNSEARCHED)


def _charge(
    flown: FlownMission, vehicle: int, band: tuple[float, float], px_per_s: float
) -> Iterator[Shape]:
    battery = flown.setting.mission.battery
    fixes = flown.log.fixes.get(vehicle, [])
    every = max(1, len(fixes) // _POINTS)
    top, low = band
    end_s = max((fix.t_s for fix in fixes), default=0.0)
    right = LEFT_PX + end_s * px_per_s
    yield Label((0.0, (top + low) / 2.0), "battery", 11.0, FAINT)
    yield Box((LEFT_PX, top), (right, low), LAND)
    reserve = low - (low - top) * battery.reserve
    yield Line.through([(LEFT_PX, reserve), (right, reserve)], Style(FENCE, 0.8, 4.0))
    share = np.array([fix.remaining_wh for fix in fixes[::every]]) / battery.capacity_wh
    yield Line.through(
        (
            (LEFT_PX + fix.t_s * px_per_s, low - (low - top) * part)
            for fix, part in zip(fixes[::every], np.clip(share, 0.0, 1.0).tolist(), strict=True)
        ),
        Style(INK, 1.3),
    )


def _axis(flown: FlownMission, end_s: float, px_per_s: float, top: float) -> Iterator[Shape]:
    step = next((tick for tick in _TICKS if tick * px_per_s >= _TICK_PX), _TICKS[-1])
    line = Style(INK, 1.0)
    yield Line.through([(LEFT_PX, top + 2.0), (LEFT_PX + end_s * px_per_s, top + 2.0)], line)
    for k in range(int(end_s // step) + 1):
        x = LEFT_PX + k * step * px_per_s
        yield Line.through([(x, top + 2.0), (x, top + 7.0)], line)
        yield Label((x, top + 15.0), minutes(k * step), 11.0, INK, "middle")
    began = flown.calendar.in_words(0.0)
    yield Label((LEFT_PX, top + 32.0), f"mission time, min:s; 0:00 is {began}", 11.0, FAINT)


def _pale(colour: Colour) -> Colour:
    red, green, blue = (round(255 - _PALE * (255 - part)) for part in colour)
    return red, green, blue
