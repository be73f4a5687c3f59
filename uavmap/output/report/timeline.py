"""Sorties, charge and faults of each vehicle over time: a drawing in SVG."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from markupsafe import Markup

from uavmap.output.drawing.palette import UNSEARCHED, css, track_colour
from uavmap.output.facts.flight_log import Sortie
from uavmap.output.facts.flown_mission import Flown

WIDTH_PX: Final = 900
LEFT_PX: Final = 90
ROW_PX: Final = 74
_AXIS_PX: Final = 40
_RIGHT_PX: Final = 20
_POINTS: Final = 300
_TICKS: Final = (10, 20, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 14400, 28800, 86400)
_MARKS: Final = 200


def draw_timeline(flown: Flown) -> Markup | None:
    """Draw the timeline; None of a replay, or without a sortie."""
    sorties = flown.log.sorties()
    if flown.recorded or not sorties:
        return None
    vehicles = sorted({sortie.vehicle for sortie in sorties})
    end_s = max(1.0, flown.data.t_s, *(sortie.end_s for sortie in sorties))
    scale = (WIDTH_PX - LEFT_PX - _RIGHT_PX) / end_s
    rows: list[str] = []
    for number, vehicle in enumerate(vehicles):
        own = [sortie for sortie in sorties if sortie.vehicle == vehicle]
        rows.extend(_row(flown, vehicle, own, number * ROW_PX, scale))
    low = len(vehicles) * ROW_PX
    axis, drawn = "".join(_axis(flown, end_s, scale, low)), "\n".join(rows)
    return Markup(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH_PX} {low + _AXIS_PX}" '
        f'role="img" aria-label="timeline">\n{drawn}\n{axis}</svg>'
    )


def _row(
    flown: Flown, vehicle: int, sorties: list[Sortie], top: float, scale: float
) -> Iterator[str]:
    colour = css(track_colour(vehicle))
    yield f'<text x="0" y="{top + 20}" font-size="13">vehicle {vehicle}</text>'
    yield f'<text x="0" y="{top + 48}" font-size="11" fill="#5a6066">battery</text>'
    for sortie in sorties:
        x, wide = LEFT_PX + sortie.start_s * scale, (sortie.end_s - sortie.start_s) * scale
        yield (
            f'<rect x="{x:.1f}" y="{top + 6}" width="{max(wide, 1.0):.1f}" height="18" '
            f'fill="{colour}" fill-opacity="{0.85 if sortie.ended else 0.4}"/>'
        )
        yield (
            f'<text x="{x + 3:.1f}" y="{top + 19}" font-size="11" fill="#fff">{sortie.number}'
            "</text>"
        )
    yield _charge(flown, vehicle, top, scale)
    for number, t_s in flown.log.swaps:
        if number == vehicle:
            x = LEFT_PX + t_s * scale
            yield (
                f'<circle cx="{x:.1f}" cy="{top + 15}" r="4.5" fill="#fff" stroke="#23272b" '
                'stroke-width="1.5"/>'
            )
    troubles = [t for t in flown.log.troubles if t.vehicle in (vehicle, 0) and t.kind != "words"]
    for trouble in troubles[:_MARKS]:
        x, mark = LEFT_PX + trouble.t_s * scale, css(UNSEARCHED)
        yield f'<path d="M{x:.1f} {top + 7}l-4 -7h8z" fill="{mark}"/>'


def _charge(flown: Flown, vehicle: int, top: float, scale: float) -> str:
    battery = flown.setting.mission.battery
    fixes = flown.log.fixes.get(vehicle, [])
    low, tall = top + 60.0, 28.0
    every = max(1, len(fixes) // _POINTS)
    share = np.array([fix.remaining_wh for fix in fixes[::every]]) / battery.capacity_wh
    points = " ".join(
        f"{LEFT_PX + fix.t_s * scale:.1f},{low - tall * part:.1f}"
        for fix, part in zip(fixes[::every], np.clip(share, 0.0, 1.0).tolist(), strict=True)
    )
    reserve = low - tall * battery.reserve
    right = WIDTH_PX - _RIGHT_PX
    return (
        f'<rect x="{LEFT_PX}" y="{low - tall}" width="{right - LEFT_PX}" height="{tall}" '
        'fill="#f7f7f3" stroke="#c9cdd1"/>'
        f'<path d="M{LEFT_PX} {reserve:.1f}H{right}" stroke="#be283c" stroke-width="0.8" '
        'stroke-dasharray="4 4"/>'
        f'<polyline points="{points}" fill="none" stroke="#23272b" stroke-width="1.3"/>'
    )


def _axis(flown: Flown, end_s: float, scale: float, top: float) -> Iterator[str]:
    step = next((tick for tick in _TICKS if end_s / tick <= 9), _TICKS[-1])
    yield f'<path d="M{LEFT_PX} {top + 2}H{LEFT_PX + end_s * scale:.1f}" stroke="#23272b"/>'
    for k in range(int(end_s // step) + 1):
        x = LEFT_PX + k * step * scale
        yield f'<path d="M{x:.1f} {top + 2}v5" stroke="#23272b"/>'
        yield (
            f'<text x="{x:.1f}" y="{top + 19}" font-size="11" text-anchor="middle">'
            f"{minutes(k * step)}</text>"
        )
    yield (
        f'<text x="{LEFT_PX}" y="{top + 35}" font-size="11" fill="#5a6066">'
        f"mission time, min:s; 0:00 is {Markup.escape(flown.calendar.told(0.0))}</text>"
    )


def minutes(t_s: float) -> str:
    """Write seconds as whole minutes and seconds.

    >>> minutes(125.9), minutes(0.0)
    ('2:05', '0:00')
    """
    whole = int(t_s)
    return f"{whole // 60}:{whole % 60:02d}"
