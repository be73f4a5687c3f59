"""A map as layers of geometries with columns: what every file for a GIS is written from.

Geometries are in the UTM zone of the grid, in metres of the projection; `in_degrees` turns them
into WGS84. Names of columns have at most ten letters, for a Shapefile holds no more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from missions.ground.grid import Grid
from missions.units import LatLon
from uavmap.results.cell_table import AT_ONCE

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
        made: The geometries, in metres of the projection; None for a row without a place. Where
            there are many, what makes those of a part.
        rows: As many values as fields.
    """

    name: str
    title: str
    geometry: Geometry
    heights: bool
    fields: tuple[Field, ...]
    made: Shapes | Callable[[slice], Shapes]
    rows: Sequence[tuple[Value, ...]]

    @property
    def shapes(self) -> Shapes:
        """All geometries."""
        return self._part(slice(0, len(self.rows)))

    def parts(self) -> Iterator[tuple[Shapes, Sequence[tuple[Value, ...]]]]:
        """Geometries and rows, at most `AT_ONCE` at a time."""
        for first in range(0, len(self.rows), AT_ONCE):
            part = slice(first, min(first + AT_ONCE, len(self.rows)))
            yield self._part(part), self.rows[part]

    def _part(self, part: slice) -> Shapes:
        return self.made(part) if callable(self.made) else self.made[part]

    def column(self, name: str) -> Iterator[Value]:
        """The values of a column."""
        at = [field.name for field in self.fields].index(name)
        return (row[at] for row in self.rows)

    def columns(self) -> dict[str, list[Value]]:
        """The values by column."""
        return {field.name: list(self.column(field.name)) for field in self.fields}


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
