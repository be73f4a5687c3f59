"""A polygon with holes, in metres, from a file: WKT, JSON, or an area as `uavmap new` reads it.

* WKT in metres: `POLYGON ((0 0, 40 0, 40 20, 0 0), (20 4, 30 4, 30 8, 20 4))`.
* JSON in metres: `{"polygon_m": [[0, 0], [40, 0], [40, 20]], "holes_m": [[[5, 2], ...]]}`.
* GeoJSON, KML and the others of `uavmap.load.areas.reading`: one area, in metres true east and true
north of its south-western corner. A keep-out zone is a hole.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import shapely
from shapely.errors import ShapelyError
from shapely.geometry import Polygon

from missions.errors import AreaError
from missions.geo.geodesy import LocalPlane
from missions.lab.cooperation.space import Point, Space
from missions.units import LatLon
from uavmap.base.printable import printable
from uavmap.base.text_files import read_text
from uavmap.load.areas.drawing import Positions
from uavmap.load.areas.reading import read_area_file

_MOST_BYTES: Final = 2_000_000


@dataclass(frozen=True, slots=True)
class Ground:
    """A ground to explore."""

    space: Space
    plane: LocalPlane | None
    """Where its metres lie on the earth; None for a file in metres."""


def read_polygon_file(name: str) -> Ground:
    """Read the polygon of a file. Raises `AreaError` with the file, the fault and the remedy."""
    try:
        text = read_text(Path(name), _MOST_BYTES).lstrip("\ufeff \t\r\n")
    except (OSError, ValueError):
        text = ""  # what is no text is for the readers of areas, and they say what is wrong
    try:
        if text[:7].casefold() == "polygon":
            return Ground(_of_wkt(text), None)
        if text.startswith("{") and '"polygon_m"' in text:
            return Ground(_of_json(text), None)
        return _of_area(name)
    except AreaError as error:
        said = str(error)
        raise AreaError(said if said.startswith(name) else f"{name}: {said}") from None


def _of_wkt(text: str) -> Space:
    try:
        polygon = shapely.from_wkt(text)
    except ShapelyError as error:
        raise AreaError(
            f"not WKT ({printable(str(error), 80)}); give POLYGON ((x y, ...), ...), each "
            "ring ending where it begins"
        ) from None
    if not isinstance(polygon, Polygon) or polygon.is_empty:
        raise AreaError("WKT, but no polygon with corners; give POLYGON ((x y, ...), ...)")
    return _space_of(polygon)


def _of_json(text: str) -> Space:
    try:
        root = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise AreaError(f"not JSON ({printable(str(error), 80)})") from None
    holes = root.get("holes_m", [])
    if not isinstance(holes, list):
        raise AreaError("holes_m: expected a list of rings, [[[east, north], ...], ...]")
    rings = [_ring(root["polygon_m"], "polygon_m")]
    rings += [_ring(hole, f"holes_m[{i}]") for i, hole in enumerate(holes)]
    return Space(rings[0], rings[1:])


def _ring(value: Any, key: str) -> list[Point]:
    found = []
    for i, pair in enumerate(value if isinstance(value, list) else [value]):
        good = (
            isinstance(pair, list) and len(pair) == 2 and all(type(v) in (int, float) for v in pair)
        )
        if not good:
            shown = json.dumps(pair)[:40]
            raise AreaError(f"{key}[{i}] = {shown}: expected [east, north] in metres")
        found.append((float(pair[0]), float(pair[1])))
    return found


def _of_area(name: str) -> Ground:
    drawing = read_area_file(name)
    if len(drawing.areas) > 1:
        names = ", ".join(area.name for area in drawing.areas[:5])
        raise AreaError(
            f"{len(drawing.areas)} areas ({names}); save the one to explore alone in a file"
        )
    area = drawing.areas[0]
    corner = LatLon(min(p.lat_deg for p in area.ring), min(p.lon_deg for p in area.ring))
    plane = LocalPlane(corner)

    def ring(positions: Positions) -> list[Point]:
        return [plane.to_plane(position) for position in positions]

    polygon = Polygon(ring(area.ring), [ring(hole) for hole in area.holes])
    if not polygon.is_valid:
        raise AreaError(f"{area.name}: its rings cross; draw it anew")
    zones = [Polygon(ring(zone.ring)).buffer(0.0) for zone in drawing.keep_out]
    left = polygon.difference(shapely.union_all(zones))
    if not isinstance(left, Polygon) or left.is_empty:
        raise AreaError(f"{area.name}: the keep-out zones leave no single piece of it; move them")
    return Ground(_space_of(left), plane)


def _space_of(polygon: Polygon) -> Space:
    return Space(
        [(x, y) for x, y, *_ in polygon.exterior.coords[:-1]],
        [[(x, y) for x, y, *_ in hole.coords[:-1]] for hole in polygon.interiors],
    )
