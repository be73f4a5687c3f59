"""The boundary of a region at pixel level, and boundary.geojson (docs/how-to/replay.md).

RFC 7946, WGS84, eight decimals (a millimetre).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from pydantic_core import to_json
from shapely.geometry import MultiPolygon, mapping
from shapely.geometry.base import BaseGeometry

from missions.geo.grid import Grid
from missions.units import LatLon
from uavmap.base.atomic_write import write_text
from uavmap.output.facts.cell_outlines import Runs, runs
from uavmap.output.facts.map_model import placed
from uavmap.output.formats import geojson_encoder as geojson

DECIMALS: Final = 8
_ROWS: Final = 1_000_000  # number of cells that are processed at a time

Feature = dict[str, Any]


class Line(NamedTuple):
    """A closed line of the boundary.

    Attributes:
        points: Shape (n, 2); the last point is the first one.
        hole: True if the region lies outside of the line.
        uncertainty_m: Half the distance from P = 0.1 to P = 0.9 at each point but the last;
            infinite where P reaches 0.9 nowhere.
    """

    points: NDArray[np.float64]
    hole: bool
    uncertainty_m: NDArray[np.float64]

    def uncertainty(self, share: float) -> float:
        """Return the uncertainty that this share of the line does not exceed, m."""
        return weighted_quantile(self.uncertainty_m, _lengths(self.points), share)


@dataclass(frozen=True, slots=True)
class Boundary:
    """The region and the band of its edge, in ground metres of the grid's moving frame.

    Attributes:
        probability: P at the boundary.
        region: Ground with at least that P; valid, may be empty.
        likely: Ground with P of at least 0.9.
        possible: Ground with P of at least 0.1.
        band: Ground that is possible and not likely.
        lines: The lines of `region`, outer ones first.
        open_lines: The parts of the boundary along the end of the pictures.
        pitch_m: Edge of a pixel of the raster, m on the ground.
        tolerance_m: Maximum shift of lines when points were left out, m.
    """

    probability: float
    region: MultiPolygon
    likely: MultiPolygon
    possible: MultiPolygon
    band: MultiPolygon
    lines: tuple[Line, ...]
    open_lines: BaseGeometry
    pitch_m: float
    tolerance_m: float

    def uncertainty_m(self, share: float) -> float | None:
        """Return the uncertainty that this share of all lines does not exceed, m."""
        if not self.lines:
            return None
        steps = np.concatenate([_lengths(line.points) for line in self.lines])
        values = np.concatenate([line.uncertainty_m for line in self.lines])
        return weighted_quantile(values, steps, share)


def weighted_quantile(
    values: NDArray[np.float64], weights: NDArray[np.float64], share: float
) -> float:
    """Return the value that this share of the weight does not exceed.

    >>> weighted_quantile(np.array([3.0, 1.0, 2.0]), np.array([1.0, 8.0, 1.0]), 0.85)
    2.0
    """
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    at = int(np.searchsorted(total, share * total[-1]))
    return float(values[order][min(at, len(values) - 1)])


def _lengths(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the weight of each point of a closed line: half the distance to its neighbours."""
    steps = np.hypot(*np.diff(ring, axis=0).T)
    lengths: NDArray[np.float64] = (steps + np.roll(steps, 1)) / 2.0
    return lengths


# --- the file ------------------------------------------------------------------------------------
@dataclass(frozen=True, slots=True)
class BoundaryMap:
    """The content of the file at mission time `t_s`.

    Attributes:
        start: The start; longitudes are within 180 degrees of it.
        box: The search box, fixed to the ground.
        position_m: Standard deviation of a picture's place, by which the whole map may be shifted.
        seen: Cells that pictures show, sorted; shape (n, 2).
        undecided: Cells of `seen` in too few pictures.
        classes: The boundary of each class of the region, by name.
    """

    mission: str
    grid: Grid
    t_s: float
    start: LatLon
    box: Sequence[LatLon]
    boundary: Boundary
    position_m: float
    seen: NDArray[np.int32]
    undecided: NDArray[np.int32]
    classes: Mapping[str, Boundary] = field(default_factory=dict)

    def figures(self) -> dict[str, Any]:
        """Return the figures for the summary, with those of classes if there are classes."""
        found = self.boundary
        classes = [{"name": name, **_class_figures(one)} for name, one in self.classes.items()]
        return {
            "boundary_m2": round(found.region.area, 1),
            "boundary_low_m2": round(found.likely.area, 1),
            "boundary_high_m2": round(found.possible.area, 1),
            "boundary_uncertainty_m": _rounded(found.uncertainty_m(0.5)),
            "boundary_open_m": round(found.open_lines.length, 1),
            **({"boundary_classes": classes} if classes else {}),
        }


def write(data: BoundaryMap, path: Path) -> None:
    """Write the file."""
    features = features_of(data)
    head = {
        "mission": data.mission,
        "t_s": round(data.t_s, 3),
        "computed_in": f"EPSG:{data.grid.zone.epsg}",
    }
    boxes = np.array([f["bbox"] for f in features if "bbox" in f])
    bbox = []
    if len(boxes):
        bbox = [*boxes[:, :2].min(axis=0).tolist(), *boxes[:, 2:].max(axis=0).tolist()]
    # thousands of coordinates, all finite: the json module takes seven times as long
    lines = (to_json(feature).decode() for feature in features)
    write_text(path, "".join(geojson.collection(head, bbox, lines)))


def features_of(data: BoundaryMap) -> list[Feature]:
    """Create the features of the file."""
    open_lines = data.boundary.open_lines
    return [
        _region(data),
        *_lines(data),
        _shape(data, "band", data.boundary.band, {"from": 0.1, "to": 0.9}),
        _shape(data, "open", open_lines, {"length_m": round(float(open_lines.length), 1)}),
        *_classes(data),
        _cells(data, "undecided", runs(data.undecided)),
        _cells(data, "unseen", unseen(data)),
    ]


# --- the features --------------------------------------------------------------------------------
def _class_figures(found: Boundary) -> dict[str, float | None]:
    return {
        "area_m2": round(found.region.area, 1),
        "area_low_m2": round(found.likely.area, 1),
        "area_high_m2": round(found.possible.area, 1),
        "uncertainty_m": _rounded(found.uncertainty_m(0.5)),
    }


def _classes(data: BoundaryMap) -> Iterator[Feature]:
    for name, found in data.classes.items():
        properties = {"class": name, **_class_figures(found)}
        yield _shape(data, "class", found.region, properties, f"class {name}")


def _region(data: BoundaryMap) -> Feature:
    found = data.boundary
    return _shape(
        data,
        "boundary",
        found.region,
        {
            "probability": round(found.probability, 3),
            "area_m2": round(found.region.area, 1),
            "area_low_m2": round(found.likely.area, 1),
            "area_high_m2": round(found.possible.area, 1),
            "uncertainty_m": _rounded(found.uncertainty_m(0.5)),
            "uncertainty_95_m": _rounded(found.uncertainty_m(0.95)),
            "position_m": round(data.position_m, 2),
            "open_m": round(found.open_lines.length, 1),
            "parts": len(found.region.geoms),
            "holes": sum(len(part.interiors) for part in found.region.geoms),
            "pixel_m": round(found.pitch_m, 4),
            "tolerance_m": round(found.tolerance_m, 4),
        },
    )


def _lines(data: BoundaryMap) -> Iterator[Feature]:
    for number, line in enumerate(data.boundary.lines, start=1):
        values = {
            "line": number,
            "hole": line.hole,
            "length_m": round(float(np.hypot(*np.diff(line.points, axis=0).T).sum()), 1),
            "uncertainty_m": _rounded(line.uncertainty(0.5)),
            "uncertainty_95_m": _rounded(line.uncertainty(0.95)),
        }
        yield _shape(data, "line", shapely.LineString(line.points), values, f"line {number}")


def _cells(data: BoundaryMap, kind: str, found: Runs) -> Feature:
    half_m = data.grid.cell_m / 2.0
    row, first, last = data.grid.cell_m * np.array(found, dtype=np.float64).reshape(-1, 3).T
    boxes = shapely.box(first - half_m, row - half_m, last + half_m, row + half_m)
    values = {"cells": sum(last - first + 1 for _, first, last in found), "runs": found}
    return _shape(data, kind, shapely.orient_polygons(shapely.union_all(boxes)), values)


def unseen(data: BoundaryMap) -> Runs:
    """Return the cells of the search box that no picture shows."""
    grid = data.grid
    box = shapely.Polygon([grid.to_moving(grid.fixed(p), data.t_s) for p in data.box])
    shapely.prepare(box)
    west, south, east, north = (np.array(box.bounds) / grid.cell_m).round().astype(int).tolist()
    seen = data.seen
    found: Runs = []
    columns = np.arange(west, east + 1)
    for row in range(south, north + 1, step := max(1, _ROWS // len(columns))):
        rows = np.arange(row, min(row + step, north + 1))
        at_m = columns[None, :] * grid.cell_m, rows[:, None] * grid.cell_m
        missing = shapely.contains_xy(box, *at_m)
        low, high = (west, rows[0]), (east, rows[-1])
        near = seen[((seen >= low) & (seen <= high)).all(axis=1)]
        missing[near[:, 1] - rows[0], near[:, 0] - west] = False
        found += runs(np.argwhere(missing.T) + np.array([west, rows[0]]))
    return found


# --- geometry ------------------------------------------------------------------------------------
def _shape(
    data: BoundaryMap, kind: str, shape: BaseGeometry, values: dict[str, Any], name: str = ""
) -> Feature:
    """Create a feature; without a geometry it has null."""

    def on_map(points: NDArray[np.float64]) -> NDArray[np.float64]:
        found = placed(points, data.grid, data.t_s, data.start, DECIMALS)
        if not np.isfinite(found).all():  # JSON has no infinite numbers
            raise ValueError("a point of the boundary lies nowhere on Earth")
        return found

    feature: Feature = {"type": "Feature", "id": name or kind, "geometry": None}
    if not shape.is_empty:
        there = shapely.transform(shape, on_map)
        feature["bbox"] = list(there.bounds)
        feature["geometry"] = mapping(there)
    return {**feature, "properties": {"kind": kind, **values}}


def _rounded(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else round(value, 3)
