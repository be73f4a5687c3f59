"""A map as layers of geometries with columns: what every file for a GIS is written from.

Geometries are in the UTM zone of the grid, in metres of the projection; `in_degrees` turns them
into WGS84. Names of columns have at most ten letters, for a Shapefile holds no more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from missions.ground.grid import Grid
from missions.units import LatLon

DECIMALS: Final = 7
"""Of a degree: about a centimetre."""

Value = str | int | float | bool | None
Shapes = NDArray[np.object_]
Geometry = Literal["Point", "LineString", "Polygon", "MultiPolygon"]


class Field(NamedTuple):
    """A column; its name has at most ten letters."""

    name: str
    kind: Literal["text", "whole", "number", "yes or no", "time"]


@dataclass(frozen=True, slots=True)
class Layer:
    """Geometries of one kind, each with a row.

    Attributes:
        name: Of a table, or a file.
        title: For people.
        geometry: Of all of them.
        heights: Whether points have a third coordinate: metres above home.
        fields: The columns.
        shapes: In metres of the projection; None for a row without a place.
        rows: As many values as fields.
    """

    name: str
    title: str
    geometry: Geometry
    heights: bool
    fields: tuple[Field, ...]
    shapes: Shapes
    rows: Sequence[tuple[Value, ...]]

    def columns(self) -> dict[str, list[Value]]:
        """The values by column."""
        return {field.name: [row[i] for row in self.rows] for i, field in enumerate(self.fields)}


def in_degrees(layer: Layer, grid: Grid, start: LatLon) -> Shapes:
    """The geometries in WGS84, longitude first, rounded to `DECIMALS`.

    Longitudes are in the turn of the start's, so that no polygon spans the globe.
    """

    def turned(points: NDArray[np.float64]) -> NDArray[np.float64]:
        there = grid.zone.lon_lat(points[:, :2])
        there[:, 0] += 360.0 * np.round((start.lon_deg - there[:, 0]) / 360.0)
        return np.column_stack([there.round(DECIMALS), points[:, 2:]])

    shapes: Shapes = shapely.transform(layer.shapes, turned, include_z=layer.heights)
    return shapes
