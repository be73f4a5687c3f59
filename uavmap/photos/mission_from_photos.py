"""A mission file from recorded pictures: their area, at their resolution."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Sequence
from pathlib import PurePath
from statistics import median
from typing import Final

from missions.geo.footprint import Optics
from missions.geo.grid import Grid
from missions.units import GridPoint, LatLon
from uavmap.output.drawing.sheet import step_near
from uavmap.photos.sources.inventory import Gathered
from uavmap.photos.sources.picture_record import Placed, credible
from vision.camera import Lens

WIDTH_PX: Final = 1000
"""Width at which pictures are judged, pixels: finer than a cell needs, and fast."""
PIXELS_A_CELL: Final = 25
_HFOV_DEG: Final = 75.0  # of most drones' cameras, for pictures without an angle of view
_MIN_CELLS: Final = 8  # across the shorter side of a picture
_OVERLAPPING: Final = 1.5  # pictures of a place, on the mean
DETECTOR: Final = """\
[detector]
# This detector depends least on the light: it finds bare ground among plants. Another region needs
# another detector, or other limits.
name = "paved"
greenness = 0.04
intensity = 90
dilations = 1
share = 0.5
view = "all"
"""


def derived(
    gathered: Gathered,
    lens: Lens | None = None,
    *,
    any_day: bool = False,
    detector: str = DETECTOR,
) -> str:
    """Return the text of a mission file for these pictures, with the table `detector` in it.

    The start is the middle of the visible ground, and the box surrounds it. A cell has
    `PIXELS_A_CELL` pixels from their usual height. Raises `ImageError` if no picture can be used.
    """
    verdicts = credible(gathered.posed, any_day=any_day)
    placed = [verdict for verdict in verdicts if isinstance(verdict, Placed)]
    if not placed:
        names = (picture.name for picture in gathered.pictures)
        raise gathered.none_usable(
            {name: str(reason) for name, reason in zip(names, verdicts, strict=True)}
        )
    optics = _optics(placed, lens)
    height_m = median(p.pose.height_m for p in placed)
    short_m = optics.footprint(height_m).short_m
    cell_m = step_near(min(PIXELS_A_CELL * optics.gsd_m(height_m), short_m / _MIN_CELLS))
    pixels = min(PIXELS_A_CELL, math.floor(optics.pixels_per_cell(height_m, cell_m)))
    start, box, fence = _places(placed, optics, height_m)
    frames, positive = _votes(placed, optics, start)
    view_from = _view_from(placed, gathered, lens)
    name = PurePath(gathered.source).stem or "pictures"
    clean = "".join(c if c.isalnum() or c in "-_ " else "-" for c in name).strip(" .")[:60]
    return f"""\
# Derived from {len(placed)} pictures: edit it, and give it with --mission.

name = {json.dumps(clean or "pictures", ensure_ascii=False)}
[start]
position = {_place(start)}
[search]
box = [{", ".join(map(_place, box))}]
[fence]
polygon = [{", ".join(map(_place, fence))}]
ceiling_m = {max(120.0, math.ceil(height_m) + 10.0)}
[grid]
cell_m = {cell_m:g}
[flight]
altitude_m = {height_m:.1f}
[camera]
hfov_deg = {math.degrees(optics.hfov_rad):.2f}  # {view_from}
width_px = {optics.width_px}
height_px = {optics.height_px}
mounting = "gimbal"
pixels_per_cell = {max(1, pixels - 1)}
{detector}[votes]
frames = {frames}
positive = {positive}
"""


def _optics(placed: Sequence[Placed], lens: Lens | None) -> Optics:
    """Return the usual camera, at the working width."""
    views = [
        (lens or p.picture.lens).hfov_rad  # type: ignore[union-attr]
        for p in placed
        if lens or p.picture.lens
    ]
    hfov_rad = median(views) if views else math.radians(_HFOV_DEG)
    shape = float(median([p.picture.height_px / p.picture.width_px for p in placed]))
    width_px = min(WIDTH_PX, int(median([float(p.picture.width_px) for p in placed])))
    return Optics(hfov_rad, max(16, width_px), max(16, round(width_px * shape)))


def _view_from(placed: Sequence[Placed], gathered: Gathered, lens: Lens | None) -> str:
    """Return the source of the angle of view, for its line."""
    if lens is not None:
        return "from the calibration"
    sources = Counter(p.picture.lens_from for p in placed if p.picture.lens_from)
    if sources:
        name, count = min(sources.items(), key=lambda item: (-item[1], item[0]))
        whence = f"from {name} of {count} of {len(placed)} pictures"
    else:
        whence = "a guess: no picture states its angle of view; see --calibration"
    refined = any(p.picture.name in gathered.refined for p in placed)
    return f"{whence}, corrected by overlaps" if refined else whence


def _places(
    placed: Sequence[Placed], optics: Optics, height_m: float
) -> tuple[LatLon, list[LatLon], list[LatLon]]:
    """Return start, box and fence around all the visible ground."""
    first = Grid.at(placed[0].pose.position, 1.0)
    points = [first.fixed(p.pose.position) for p in placed]
    reach_m = math.hypot(*optics.footprint(height_m)) / 2.0
    west, east = min(p.east_m for p in points) - reach_m, max(p.east_m for p in points) + reach_m
    south, north = (
        min(p.north_m for p in points) - reach_m,
        max(p.north_m for p in points) + reach_m,
    )
    start = first.position(GridPoint((west + east) / 2.0, (south + north) / 2.0))
    margin_m = max(10.0, 0.1 * max(east - west, north - south))

    def ring(by_m: float) -> list[LatLon]:
        low, high = GridPoint(west - by_m, south - by_m), GridPoint(east + by_m, north + by_m)
        corners = (low, GridPoint(high.east_m, low.north_m), high)
        return [first.position(p) for p in (*corners, GridPoint(low.east_m, high.north_m))]

    return start, ring(0.0), ring(margin_m)


def _votes(placed: Sequence[Placed], optics: Optics, start: LatLon) -> tuple[int, int]:
    """Return the votes of a place, and their majority: two of three if pictures overlap.

    They are never two: both would have to agree, even where more pictures show the place.
    """
    grid = Grid.at(start, 1.0)
    points = [grid.fixed(p.pose.position) for p in placed]
    across_m, along_m = optics.footprint(median(p.pose.height_m for p in placed))
    each_m2 = across_m * along_m
    east = max(p.east_m for p in points) - min(p.east_m for p in points) + across_m
    north = max(p.north_m for p in points) - min(p.north_m for p in points) + along_m
    overlap = len(placed) * each_m2 / (east * north)
    frames = 3 if overlap >= _OVERLAPPING else 1
    return frames, frames // 2 + 1


def _place(place: LatLon) -> str:
    return f"[{place.lat_deg:.7f}, {place.lon_deg:.7f}]"
