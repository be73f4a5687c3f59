"""ROIs from files, and grown by name.

* Sets of cells, as JSON: `{"rois": [{"start": [east, north], "cells": [[east, north], ...]}]}`;
other keys are ignored.
* GeoJSON (RFC 7946): a cell is ROI from half covered on, on a grid aligned with UTM.
* A growth by name, `KIND:CELLS:SEED`, such as `eden:120:7`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry import Point, Polygon
from shapely.geometry.base import BaseGeometry

from missions.errors import GeodesyError, RoiError
from missions.geo.grid import Grid
from missions.lab.arena.roi import KINDS, MAX_CELLS, Roi, boundary, component, grown
from missions.mapping.tree import patches
from missions.units import Cell, LatLon
from uavmap.base.text_files import read_text
from uavmap.output.facts.score import MISSED_SHARE, cells_near, shares_of

_FARTHEST: Final = 2**31
_LARGEST_BYTES: Final = 200_000_000
_SHOWN: Final = 40
_WIDEST_DEG: Final = 6.0


def load_rois(name: str, *, cell_m: float = 4.0, start: LatLon | None = None) -> list[Roi]:
    """Read the ROIs of a file, or grow the one of `KIND:CELLS:SEED`.

    Args:
        name: A path, or the name of a growth.
        cell_m: Size of a cell, for GeoJSON.
        start: Start of all robots, for GeoJSON: then all polygons together are one ROI. By default
            each is a ROI, entered at the westernmost cell of its largest part.

    Raises `RoiError` with the file, the place in it, the value, and what was expected.
    """
    try:
        text = read_text(Path(name), _LARGEST_BYTES)
    except (OSError, ValueError) as error:
        if name.partition(":")[0] in KINDS:
            kind, *numbers = name.split(":")
            good = all(n.isascii() and n.isdigit() and len(n) < 19 for n in numbers)
            if len(numbers) != 2 or not good:
                raise RoiError(
                    f"{name}: a growth is named KIND:CELLS:SEED, such as eden:120:7"
                ) from None
            return [grown(kind, int(numbers[0]), int(numbers[1]))]
        reason = getattr(error, "strerror", None) or "not a text file in UTF-8"
        raise RoiError(
            f"{name}: cannot be read ({reason}); give a file, or a growth such as eden:120:7 "
            f"({', '.join(KINDS)})"
        ) from None
    try:
        root = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise RoiError(f"{name}: not JSON ({error})") from None
    if isinstance(root, dict) and "rois" in root:
        if start is not None:
            raise RoiError(f"{name}: holds cells with starts of their own; leave out --start")
        rois = root["rois"]
        if not isinstance(rois, list) or not rois:
            raise _fault(name, "rois", rois, "expected a list with at least one ROI")
        return [_set(name, f"rois[{i}]", values) for i, values in enumerate(rois)]
    if isinstance(root, dict) and isinstance(root.get("type"), str):
        return _regions(name, text, cell_m, start)
    raise RoiError(f'{name}: neither {{"rois": [{{"start", "cells"}}]}} nor GeoJSON')


# --- sets of cells ---------------------------------------------------------------------------
def _set(name: str, key: str, values: object) -> Roi:
    if not isinstance(values, dict):
        raise _fault(name, key, values, 'expected {"start": [east, north], "cells": [...]}')
    for part in ("start", "cells"):
        if part not in values:
            raise RoiError(f"{name}: {key}.{part}: missing")
    listed = values["cells"]
    if not isinstance(listed, list) or not listed:
        raise _fault(name, f"{key}.cells", listed, "expected a list of [east, north]")
    if len(listed) > MAX_CELLS:
        raise RoiError(f"{name}: {key}.cells: {len(listed)} cells; at most {MAX_CELLS}")
    start = _cell(name, f"{key}.start", values["start"])
    cells: dict[Cell, int] = {}
    for i, value in enumerate(listed):
        cell = _cell(name, f"{key}.cells[{i}]", value)
        if cell in cells:
            raise _fault(name, f"{key}.cells[{i}]", value, f"is cells[{cells[cell]}] again")
        cells[cell] = i
    if start not in cells:
        raise _fault(name, f"{key}.start", values["start"], "not among the cells")
    reached = component(cells, start)
    for cell, i in cells.items():
        if cell not in reached:
            raise _fault(name, f"{key}.cells[{i}]", listed[i], "is not connected with the start")
    return Roi(key, start, frozenset(cells))


def _cell(name: str, key: str, value: object) -> Cell:
    whole = isinstance(value, list) and len(value) == 2 and all(type(part) is int for part in value)
    if not isinstance(value, list) or not whole:
        raise _fault(name, key, value, "expected two whole numbers, [east, north]")
    if max(map(abs, value)) >= _FARTHEST:
        raise _fault(name, key, value, f"farther out than {_FARTHEST} cells")
    return Cell(*value)


def _fault(name: str, key: str, value: object, remedy: str) -> RoiError:
    shown = json.dumps(value)
    if len(shown) > _SHOWN:
        shown = shown[: _SHOWN - 3] + "..."
    return RoiError(f"{name}: {key} = {shown}: {remedy}")


# --- GeoJSON ---------------------------------------------------------------------------------
def _regions(name: str, text: str, cell_m: float, start: LatLon | None) -> list[Roi]:
    polygons = _polygons(name, text)
    if start is not None:
        grid = _grid(name, start, cell_m)
        regions = [_on_ground(polygon, grid) for polygon in polygons]
        cells = {cell for region in regions for cell in _covered(name, region, grid)}
        return [Roi.around(Path(name).stem, _entered_at(name, start, cells, regions, grid), cells)]
    rois = []
    for number, polygon in enumerate(polygons, 1):
        middle = polygon.representative_point()
        grid = _grid(name, LatLon(middle.y, middle.x), cell_m)
        cells = set(_covered(name, _on_ground(polygon, grid), grid))
        if not cells:
            raise RoiError(
                f"{name}: polygon {number} covers half of no cell of {cell_m:g} m; choose a "
                "smaller --cell-m"
            )
        part = set(patches(cells)[0])
        rois.append(Roi(f"{Path(name).stem}[{number}]", boundary(part)[0], frozenset(part)))
    return rois


def _entered_at(
    name: str, start: LatLon, cells: set[Cell], regions: Sequence[BaseGeometry], grid: Grid
) -> Cell:
    """Return the cell of a start in the region; at its rim, where cells are less than half covered,
    the nearest."""
    if not cells:
        raise RoiError(
            f"{name}: covers half of no cell of {grid.cell_m:g} m; choose a smaller --cell-m"
        )
    if Cell(0, 0) in cells:
        return Cell(0, 0)
    near = min(cells, key=lambda cell: (cell.east**2 + cell.north**2, cell))
    if min(region.distance(Point(0.0, 0.0)) for region in regions) <= grid.cell_m / 2:
        return near
    place, away_m = grid.centre(near, 0.0), grid.cell_m * math.hypot(near.east, near.north)
    raise RoiError(
        f"{name}: --start {start.lat_deg:g},{start.lon_deg:g} is not in the region; its nearest "
        f"cell is {away_m:.0f} m away: --start {place.lat_deg:.6f},{place.lon_deg:.6f}"
    )


def _polygons(name: str, text: str) -> list[Polygon]:
    try:
        geometry = shapely.from_geojson(text)
    except (shapely.errors.ShapelyError, TypeError, ValueError) as error:
        raise RoiError(f"{name}: not GeoJSON ({str(error).splitlines()[0]})") from None
    todo: list[BaseGeometry] = [geometry]
    found: list[Polygon] = []
    while todo:
        part = todo.pop(0)
        if isinstance(part, Polygon):
            found.append(part)
        elif part is not None and hasattr(part, "geoms"):
            todo[:0] = part.geoms
    if not found:
        raise RoiError(f"{name}: no Polygon or MultiPolygon in this file")
    for number, polygon in enumerate(found, 1):
        xy = shapely.get_coordinates(polygon)
        if polygon.is_empty or not (abs(xy) <= (180.0, 90.0)).all():
            raise RoiError(
                f"{name}: polygon {number}: expected [longitude, latitude] in degrees, within "
                "180 and 90"
            )
        if (np.ptp(xy, axis=0) > _WIDEST_DEG).any():
            raise RoiError(f"{name}: polygon {number}: wider than a UTM zone")
        if not polygon.is_valid:
            raise RoiError(f"{name}: polygon {number}: {shapely.is_valid_reason(polygon)}")
    return found


def _grid(name: str, origin: LatLon, cell_m: float) -> Grid:
    try:
        return Grid.at(origin, cell_m)
    except GeodesyError as error:
        raise RoiError(f"{name}: {error}") from None


def _on_ground(polygon: Polygon, grid: Grid) -> BaseGeometry:
    def moved(points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return np.array([grid.fixed(LatLon(lat, lon)) for lon, lat in points.tolist()])

    return shapely.transform(polygon, moved)


def _covered(name: str, region: BaseGeometry, grid: Grid) -> list[Cell]:
    west, south, east, north = region.bounds
    if ((east - west) / grid.cell_m + 1) * ((north - south) / grid.cell_m + 1) > MAX_CELLS:
        raise RoiError(
            f"{name}: {east - west:.0f} m x {north - south:.0f} m is more than {MAX_CELLS} cells; "
            "choose a larger --cell-m"
        )
    shares = shares_of(cells_near(region, grid), region, grid)
    return [cell for cell, share in shares.items() if share >= MISSED_SHARE]
