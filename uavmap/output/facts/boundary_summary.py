"""What boundary.geojson says, read back: of a flight that kept its frames, or of a replay."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.errors import ShapelyError
from shapely.geometry import MultiPolygon, Polygon

from uavmap.base.text_files import read_text
from uavmap.output.facts.map_model import MapData

FILE: Final = "boundary.geojson"
_MOST_BYTES: Final = 50_000_000
_SAME_S: Final = 0.01


@dataclass(frozen=True, slots=True)
class BoundaryTold:
    """The boundary at pixel level, in the fixed frame, metres on the ground.

    Attributes:
        region: What it encloses.
        area_m2: Of that.
        low_m2: Where P is at least 0.9.
        high_m2: Where P is at least 0.1.
        length_m: Of all its lines.
        uncertainty_m: Of half of it, the half of the way from P = 0.1 to P = 0.9; None where P
            comes to 0.9 nowhere.
        open_m: Where it runs along the end of what pictures show.
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
    """The boundary in a folder of results; None where there is none that belongs to this map.

    A file that somebody has changed, or that is of an earlier part of the flight, is none.
    """
    try:
        told = json.loads(read_text(folder / FILE, _MOST_BYTES))
        if abs(float(told["t_s"]) - data.t_s) > _SAME_S:
            return None
        return boundary_of(told["features"], data)
    except (OSError, ValueError, TypeError, KeyError, RecursionError, ShapelyError):
        return None


def boundary_of(told: Iterable[Mapping[str, Any]], data: MapData) -> BoundaryTold | None:
    """What the features of the file say; None of a geometry that is no boundary.

    Raises as what is missing, or of another type, does.
    """
    features = {str(one["id"]): one for one in told}
    feature = features["boundary"]
    values = feature["properties"]
    region: Polygon | MultiPolygon = Polygon()
    if feature["geometry"] is not None:
        shape = shapely.from_geojson(json.dumps(feature["geometry"]))
        if not isinstance(shape, Polygon | MultiPolygon):
            return None
        region = shapely.transform(shape, lambda points: _fixed(data, points))
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


def _fixed(data: MapData, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points of the fixed frame from longitudes and latitudes."""
    grid = data.grid
    origin = np.array([grid.origin.east_m, grid.origin.north_m])
    fixed: NDArray[np.float64] = (grid.zone.utm(points) - origin) / grid.scale
    return fixed
