"""GeoJSON by RFC 7946: map.geojson of each flight, and the export with a file per layer.

Seven decimals (about a centimetre); a third coordinate, of tracks only, is the height above home,
m. Longitudes run past 180 degrees where a map crosses the antimeridian: no polygon spans the globe.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import LineString, mapping
from shapely.geometry.base import BaseGeometry

from missions.units import LatLon
from uavmap.base.atomic_write import write_parts
from uavmap.output.facts.flown_mission import FlownMission
from uavmap.output.facts.map_model import CellCorners, MapData, turned
from uavmap.output.formats.layers import (
    DECIMALS,
    Layer,
    described,
    in_degrees,
    line_in_degrees,
    outline_in_degrees,
)


def write(data: MapData, path: Path, utc: str | None = None) -> None:
    """Write map.geojson, a feature a line; `utc` is its date, ISO 8601, if known.

    Features by their property `kind`:

    * `cell`: Polygon; `column`, `row`, `state`, `positive` and `votes` (frames); `belief`, 0 to 1,
      for recorded pictures with evidence; `class` for a detector with classes.
    * `class`: Polygon or MultiPolygon around the cells of a class; its name, number and figures.
    * `outline`: Polygon or MultiPolygon around the region's cells; `area_m2`, and `utc`, its date,
      if known. Its geometry is null for a map without a region.
    * `track`: LineString; `vehicle`, `start_s`, `end_s`. A vehicle that never moved has none.
    * `unsearched`: LineString, a stretch of a search lane that no judged frame shows.
    """
    write_parts(path, (part.encode() for part in _map(data, utc)))


def encode(flown: FlownMission, layers: Sequence[Layer]) -> dict[str, bytes]:
    """Encode a file per layer, by name; each has mission, version, dates and grid as members."""
    return {f"{layer.name}.geojson": "".join(_layer(flown, layer)).encode() for layer in layers}


def _layer(flown: FlownMission, layer: Layer) -> Iterator[str]:
    shapes = in_degrees(layer, flown.data)
    head = {"name": layer.name, **described(flown)}
    box = bbox(shapely.get_coordinates(shapes, include_z=layer.heights))
    written = zip(shapely.to_geojson(shapes), layer.records(), strict=True)
    features = (
        feature(number, geometry or "null", values)
        for number, (geometry, values) in enumerate(written, start=1)
    )
    return collection(head, box, features)


# --- map.geojson ---------------------------------------------------------------------------------
def _map(data: MapData, utc: str | None) -> Iterator[str]:
    date = {} if utc is None else {"utc": utc}
    outline = {
        "kind": "outline",
        "mission": data.mission,
        "t_s": round(data.t_s, 3),
        "cells": len(data.roi_cells),
        "area_m2": round(data.outline.area, 3),
        **date,
    }
    marks: list[_Mark] = [
        ("outline", outline_in_degrees(data, data.outline), outline),
        *_classes(data),
        *_tracks(data),
    ]
    for number, lane in enumerate(data.unsearched, start=1):
        line = LineString(line_in_degrees(data, lane))
        marks.append((f"unsearched {number}", line, {"kind": "unsearched"}))
    head = {"mission": data.mission, "t_s": round(data.t_s, 3)} | date

    def features() -> Iterator[str]:
        yield from _cells(data)
        for name, shape, values in marks:
            geometry = "null" if shape.is_empty else json.dumps(mapping(shape))
            yield feature(name, geometry, values)

    return collection(head, _map_bbox(data, [shape for _, shape, _ in marks]), features())


_Mark = tuple[str, BaseGeometry, dict[str, Any]]
"""Id, geometry in degrees and properties of a feature."""


def _tracks(data: MapData) -> Iterator[_Mark]:
    for track in data.tracks:
        if len(track.points) < 2:  # a LineString has at least two positions
            continue
        places = line_in_degrees(data, (place for _, place, _ in track.points))
        heights_m = (round(height_m, 2) for _, _, height_m in track.points)
        line = LineString([(*place, h) for place, h in zip(places, heights_m, strict=True)])
        values = {
            "kind": "track",
            "vehicle": track.vehicle,
            "start_s": round(track.points[0][0], 3),
            "end_s": round(track.points[-1][0], 3),
            "altitude": "metres above home",
        }
        yield f"track {track.vehicle}", line, values


def _classes(data: MapData) -> Iterator[_Mark]:
    for one in data.class_areas:
        values = {"kind": "class", **one.figures()}
        yield f"class {one.number}", outline_in_degrees(data, one.outline), values


def _cells(data: MapData) -> Iterator[str]:
    """Write a line per cell as text: there are thousands, and only a class name needs quoting."""

    parts = zip(data.cells.parts(), written_parts(data.corners, data.start), strict=True)
    for table, rings in parts:
        columns = table.classes.tolist()
        for ring, row, column in zip(rings, table.values(), columns, strict=True):
            place, state, positive, votes, known = row
            belief = "" if known is None else f', "belief": {round(known, 3)!r}'
            if column >= 0:
                belief += f', "class": {json.dumps(data.class_areas[column].name)}'
            values = f'"state": "{state}", "positive": {positive}, "votes": {votes}{belief}'
            yield cell_feature(place, ring, values)


def _map_bbox(data: MapData, shapes: Sequence[BaseGeometry]) -> list[float]:
    lons, lats = turned(data.corners.lon_deg, data.start), data.corners.lat_deg
    places = [shapely.get_coordinates(shape) for shape in shapes]
    if len(lons):
        corners = [[lons.min(), lats.min()], [lons.max(), lats.max()]]
        places.append(np.array(corners).round(DECIMALS))
    box = bbox(np.concatenate(places))
    heights = shapely.get_coordinates([s for s in shapes if s.has_z], include_z=True)[:, 2]
    if not len(heights):
        return box
    return [*box[:2], float(heights.min()), *box[2:], float(heights.max())]


# --- parts ---------------------------------------------------------------------------------------
def collection(head: dict[str, Any], box: list[float], features: Iterable[str]) -> Iterator[str]:
    """Encode a FeatureCollection, a feature a line, from its members, its box and its features."""
    members = {"type": "FeatureCollection", **head, **({"bbox": box} if box else {})}
    yield f'{json.dumps(members, allow_nan=False)[:-1]}, "features": [\n'
    between = ""
    for feature in features:
        yield f"{between}{feature}"
        between = ",\n"
    yield "\n]}\n"


def written_parts(corners: CellCorners, start: LatLon) -> Iterator[list[list[str]]]:
    """Yield the corners of each cell as positions of GeoJSON, many cells at a time."""

    def place(lon_deg: float, lat_deg: float) -> str:
        return f"[{round(lon_deg, DECIMALS)!r}, {round(lat_deg, DECIMALS)!r}]"

    return corners.written(start, place)


def cell_feature(place: Sequence[int], ring: Sequence[str], values: str) -> str:
    """Encode a cell: column and row, its corners, its other properties as JSON without braces."""
    (east, north), (sw, se, ne, nw) = place, ring
    return (
        f'{{"type": "Feature", "id": "cell {east} {north}", "geometry": {{"type": '
        f'"Polygon", "coordinates": [[{sw}, {se}, {ne}, {nw}, {sw}]]}}, '
        f'"properties": {{"kind": "cell", "column": {east}, "row": {north}, {values}}}}}'
    )


def feature(identity: str | int, geometry: str, values: dict[str, Any]) -> str:
    """Encode a feature from its id, its geometry as JSON, and its properties."""
    properties = json.dumps(values, allow_nan=False)
    return (
        f'{{"type": "Feature", "id": {json.dumps(identity)}, "geometry": {geometry}, '
        f'"properties": {properties}}}'
    )


def bbox(points: NDArray[np.float64]) -> list[float]:
    """Return west, south, (lowest,) east, north(, highest); empty without points (section 5)."""
    return [*points.min(axis=0).tolist(), *points.max(axis=0).tolist()] if len(points) else []
