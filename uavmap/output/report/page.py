"""Pages without a script, that load nothing: report.html, and a plan. All texts are escaped."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path, PurePath
from typing import Any, Final, Literal, NamedTuple

import numpy as np
import shapely
from jinja2 import Environment, PackageLoader, StrictUndefined, Template, select_autoescape
from markupsafe import Markup
from numpy.typing import NDArray

from missions.errors import ImageError
from uavmap.base.image_files import MAX_PICTURE_BYTES, opened
from uavmap.base.printable import printable
from uavmap.base.text_files import read_bytes
from uavmap.base.version import __version__
from uavmap.journal.kept_frames import FRAMES, KeptFrame
from uavmap.output.drawing import svg
from uavmap.output.drawing.judged import FILE as JUDGED
from uavmap.output.drawing.map_scene import map_scene
from uavmap.output.drawing.mosaic_file import Ground
from uavmap.output.drawing.palette import FAINT, INK, UNSEARCHED, Style, css, track_colour
from uavmap.output.drawing.scene import Label, Line, Scene, View
from uavmap.output.drawing.sheet import step_up
from uavmap.output.facts.flight_log import Sortie
from uavmap.output.facts.flown_mission import Flown
from uavmap.output.facts.map_model import drift_m, on_ground
from uavmap.output.formats.map_layers import kept_by_time
from uavmap.output.report import facts


def encode(flown: Flown) -> bytes:
    """Write the page."""
    return _template("page.html").render(_context(flown)).encode(errors="xmlcharrefreplace")


def encode_plan(
    scene: Scene, plan_facts: Sequence[tuple[str, str]], warnings: Sequence[str]
) -> bytes:
    """Write the plan of a mission as a page."""
    drawing = svg.map_drawing(scene)
    values = {"scene": scene, "drawing": drawing, "legend": legend_of(scene), "facts": plan_facts}
    return _template("plan.html").render(values, warnings=warnings).encode()


@lru_cache
def _template(name: str) -> Template:
    # escape in every case, also where a template does not end in .html
    environment = Environment(
        loader=PackageLoader("uavmap.output.report", ""),
        autoescape=select_autoescape(default=True, default_for_string=True),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["printable"] = printable
    return environment.get_template(name)


def _context(flown: Flown) -> dict[str, Any]:
    return {
        "flown": flown,
        "facts": facts,
        "data": flown.data,
        "mission": flown.setting.mission,
        "finding": str(flown.values.get("finding", "")),
        "map": draw_map(flown),
        "timeline": draw_timeline(flown),
        "frames": boundary_frames(flown),
        "judged": _address(flown.folder / JUDGED, _JUDGED_PX),
        "minutes": facts.minutes,
        "written_by": __version__,
    }


# --- the map, with a graticule in degrees and its corners -----------------------------------------
_LINES: Final = 4
"""Number of graticule lines that cross a map, about."""
_LEAST_DEG: Final = 1e-9
_LABEL_PX: Final = 12.0
_STYLE: Final = Style(FAINT, 0.6)


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
    legend: tuple[tuple[Markup, str], ...]
    """Samples with their texts."""
    corners: tuple[Corner, ...]
    true_north_deg: float
    """From the map's upward direction, clockwise."""


def draw_map(flown: Flown) -> Drawing:
    """Draw the map, with the boundary at pixel level if there is one."""
    data, boundary = flown.data, flown.boundary
    if boundary is not None:
        moved_m = drift_m(data.grid, data.t_s)
        region = shapely.transform(boundary.region, lambda points: points - moved_m)
        data = data.with_boundary(region)
    scene = map_scene(data)
    corners = tuple(_corners(flown, scene.view))
    lines, labels = _graticule(flown, scene.view, corners)
    ground = Ground.read(flown.folder, data.grid)
    photograph = None if ground is None else ground.beneath(scene.view)
    drawing = svg.map_drawing(scene, lines, labels, photograph)
    return Drawing(drawing, legend_of(scene), corners, -math.degrees(data.grid.convergence_rad))


def legend_of(scene: Scene) -> tuple[tuple[Markup, str], ...]:
    """Return the samples of a legend with their texts."""
    return tuple((svg.sample(entry), entry.text) for entry in scene.legend)


def _graticule(
    flown: Flown, view: View, corners: tuple[Corner, ...]
) -> tuple[list[Line], list[Label]]:
    lats, lons = [c.lat_deg for c in corners], [c.lon_deg for c in corners]
    lines: list[Line] = []
    labels: list[Label] = []
    for along, across, letters in ((lons, lats, "EW"), (lats, lons, "NS")):
        step = step_up(max((max(along) - min(along)) / _LINES, _LEAST_DEG))
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


def _corners(flown: Flown, view: View) -> Iterator[Corner]:
    """Yield the corners in degrees, in the turn of the start's, and in metres of the projection."""
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


# --- the timeline: sorties, charge and faults of each vehicle -------------------------------------
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
            f"{facts.minutes(k * step)}</text>"
        )
    yield (
        f'<text x="{LEFT_PX}" y="{top + 35}" font-size="11" fill="#5a6066">'
        f"mission time, min:s; 0:00 is {Markup.escape(flown.calendar.in_words(0.0))}</text>"
    )


# --- kept frames nearest to the boundary ----------------------------------------------------------
MOST: Final = 8
_WIDE_PX: Final = 280
_JUDGED_PX: Final = 560
_QUALITY: Final = 70


class Shown(NamedTuple):
    """A picture for the page."""

    name: str
    kept: KeptFrame
    address: str
    """With the picture in it: `data:image/jpeg;base64,...`."""


def boundary_frames(flown: Flown) -> list[Shown]:
    """Return at most `MOST` readable frames, in their order along the boundary."""
    shown = []
    for frame in _nearest(flown, list(kept_by_time(flown).values())):
        name = PurePath(frame.frame).name  # never a path that leads elsewhere
        address = _address(flown.folder / FRAMES / name, _WIDE_PX)
        if address is not None:
            shown.append(Shown(printable(name), frame, address))
    return shown


def _nearest(flown: Flown, kept: Sequence[KeptFrame]) -> list[KeptFrame]:
    """Return the frame over each of some points at equal distances along the boundary."""
    grid, boundary = flown.data.grid, flown.boundary
    if not kept:
        return []
    if boundary is not None and not boundary.region.is_empty:
        moved_m = drift_m(grid, flown.data.t_s)
        line = shapely.transform(boundary.region.boundary, lambda points: points - moved_m)
    else:
        line = flown.extent.outline.boundary
    if line.is_empty:
        return []
    longest = max(shapely.get_parts(line), key=lambda ring: ring.length)
    points = shapely.get_coordinates(
        [longest.interpolate((i + 0.5) / MOST, normalized=True) for i in range(MOST)]
    )
    places = [frame.pose.position for frame in kept]
    degrees = np.array([(place.lon_deg, place.lat_deg) for place in places], dtype=np.float64)
    taken = on_ground(degrees, grid) - [drift_m(grid, frame.t_s) for frame in kept]
    found: list[int] = []
    for point in points:
        order = np.argsort(np.hypot(*(taken - point).T))
        best = next((int(i) for i in order[:MOST] if int(i) not in found), None)
        if best is not None:
            found.append(best)
    return [kept[i] for i in found]


def _address(path: Path, wide_px: int) -> str | None:
    """Return an address with a picture in it; None of one that cannot be read."""
    try:
        data = read_bytes(path, MAX_PICTURE_BYTES)
        with opened(io.BytesIO(data), path.name) as picture:
            high = max(1, round(picture.height * wide_px / picture.width))
            picture.draft("RGB", (wide_px, high))
            small = picture.convert("RGB").resize((wide_px, high))
    except (ImageError, OSError, ValueError):
        return None
    buffer = io.BytesIO()
    small.save(buffer, "JPEG", quality=_QUALITY)
    text = base64.b64encode(buffer.getvalue()).decode()
    return f"data:image/jpeg;base64,{text}"
