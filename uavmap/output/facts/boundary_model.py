"""The boundary of a region at pixel level: as computed, and as read back from boundary.geojson."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.errors import ShapelyError
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from uavmap.base.text_files import read_text
from uavmap.output.facts.map_model import MapData, on_ground


class Line(NamedTuple):
    """A closed line of the boundary.

    Attributes:
        points: Shape (n, 2), its first point again at the end.
        hole: Whether the region lies outside of it.
        uncertainty_m: Half the distance from P = 0.1 to P = 0.9 across it, at each point but the
            last; infinite where P reaches 0.9 nowhere.
    """

    points: NDArray[np.float64]
    hole: bool
    uncertainty_m: NDArray[np.float64]

    def uncertainty(self, share: float) -> float:
        """Return the uncertainty that this share of the line does not exceed, m."""
        return weighted_quantile(self.uncertainty_m, _lengths(self.points), share)


@dataclass(frozen=True, slots=True)
class Boundary:
    """The region, and where its edge may be, in ground metres of the grid's moving frame.

    Attributes:
        probability: P at the boundary.
        region: Where P is at least that; valid, may be empty.
        likely: Where P is at least 0.9.
        possible: Where P is at least 0.1.
        band: Possible and not likely.
        lines: Those of `region`, outer ones first.
        open_lines: Where the boundary runs along the end of the pictures.
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
    """Return the weight of each point of a closed line: half the way to its neighbours."""
    steps = np.hypot(*np.diff(ring, axis=0).T)
    lengths: NDArray[np.float64] = (steps + np.roll(steps, 1)) / 2.0
    return lengths


FILE: Final = "boundary.geojson"
_MOST_BYTES: Final = 50_000_000
_SAME_S: Final = 0.01


@dataclass(frozen=True, slots=True)
class BoundaryTold:
    """The boundary at pixel level, in the fixed frame, m on the ground.

    Attributes:
        low_m2: Where P is at least 0.9.
        high_m2: Where P is at least 0.1.
        length_m: Of all its lines.
        uncertainty_m: Of half of it: half the distance from P = 0.1 to P = 0.9; None where P
            reaches 0.9 nowhere.
        open_m: Where it runs along the end of the pictures.
        position_m: Standard deviation of a picture's place.
    """

    region: Polygon | MultiPolygon
    area_m2: float
    low_m2: float
    high_m2: float
    length_m: float
    uncertainty_m: float | None
    open_m: float
    position_m: float


def read_boundary(folder: Path, data: MapData) -> BoundaryTold | None:
    """Read the boundary in a folder of results; None where there is none of this map.

    A file that was edited, or that is of an earlier part of the flight, does not count.
    """
    try:
        told = json.loads(read_text(folder / FILE, _MOST_BYTES))
        if abs(float(told["t_s"]) - data.t_s) > _SAME_S:
            return None
        return _told(told["features"], data)
    except (OSError, ValueError, TypeError, KeyError, RecursionError, ShapelyError):
        return None


def _told(found: Iterable[Mapping[str, Any]], data: MapData) -> BoundaryTold | None:
    """Read the features; None of a geometry that is no boundary. Any other fault raises."""
    features = {str(one["id"]): one for one in found}
    feature = features["boundary"]
    values = feature["properties"]
    region: Polygon | MultiPolygon = Polygon()
    if feature["geometry"] is not None:
        shape = shapely.from_geojson(json.dumps(feature["geometry"]))
        if not isinstance(shape, Polygon | MultiPolygon):
            return None
        region = shapely.transform(shape, lambda at: on_ground(at, data.grid))
    uncertainty = values["uncertainty_m"]
    lines = (one for name, one in features.items() if name.startswith("line "))
    numbers = [
        float(values["area_m2"]), float(values["area_low_m2"]), float(values["area_high_m2"]),
        float(sum(line["properties"]["length_m"] for line in lines)), float(values["open_m"]),
        float(values["position_m"]), 0.0 if uncertainty is None else float(uncertainty),
    ]  # fmt: skip
    if not np.isfinite(numbers).all() or not np.isfinite(shapely.get_coordinates(region)).all():
        return None
    area_m2, low_m2, high_m2, length_m, open_m, position_m, uncertainty_m = numbers
    return BoundaryTold(
        region, area_m2, low_m2, high_m2, length_m,
        None if uncertainty is None else uncertainty_m, open_m, position_m,
    )  # fmt: skip
