"""A GeoJSON file a layer (RFC 7946): WGS84, seven decimals, right-handed rings, a bounding box.

What a file is of stands beside its features, as members of its own: mission, version, dates, and
the coordinate system of the grid, which the coordinates are not in.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import shapely

from uavmap.results.flown import Flown
from uavmap.results.layers import Layer, in_degrees
from uavmap.results.told import described


def encode(flown: Flown, layers: Sequence[Layer]) -> dict[str, bytes]:
    """The files by name, a feature a line."""
    return {f"{layer.name}.geojson": _collection(flown, layer).encode() for layer in layers}


def _collection(flown: Flown, layer: Layer) -> str:
    shapes = in_degrees(layer, flown.data.grid, flown.data.start)
    head: dict[str, Any] = {"type": "FeatureCollection", "name": layer.name, **described(flown)}
    if box := _bbox(layer, shapes):
        head["bbox"] = box
    names = [field.name for field in layer.fields]
    lines = []
    for number, (geometry, row) in enumerate(
        zip(shapely.to_geojson(shapes), layer.rows, strict=True), start=1
    ):
        values = json.dumps(dict(zip(names, row, strict=True)), allow_nan=False)
        lines.append(
            f'{{"type": "Feature", "id": {number}, "geometry": {geometry or "null"}, '
            f'"properties": {values}}}'
        )
    features = ",\n".join(lines)
    return f'{json.dumps(head, allow_nan=False)[:-1]}, "features": [\n{features}\n]}}\n'


def _bbox(layer: Layer, shapes: Any) -> list[float]:
    """West, south, (lowest,) east, north(, highest); empty without any geometry."""
    points = shapely.get_coordinates(shapes, include_z=layer.heights)
    if not len(points):
        return []
    low, high = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    return [*low, *high]
