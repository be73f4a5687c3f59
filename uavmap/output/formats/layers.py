"""A map as layers of geometries with columns: the source of every file for a GIS.

Geometries are in the UTM zone of the grid, in metres of the projection; `in_degrees` projects them
to WGS84. Column names have at most ten letters, the limit of a Shapefile.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, NamedTuple, Self

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import MultiPolygon, Polygon

from missions.units import LatLon
from uavmap.base.printable import printable
from uavmap.base.version import __version__
from uavmap.output.facts.flown_mission import FlownMission
from uavmap.output.facts.map_model import MapData, placed, turned

DECIMALS: Final = 7
"""Decimals of degrees: about a centimetre."""

Value = str | int | float | bool | None
Row = tuple[Value, ...]
Shapes = NDArray[np.object_]
Geometry = Literal["Point", "LineString", "Polygon", "MultiPolygon"]


class Field(NamedTuple):
    """A column; its name has at most ten letters."""

    name: str
    kind: str
    """One of: text, whole, number, yes or no, time."""


@dataclass(frozen=True, slots=True)
class Layer:
    """Geometries of one kind, each with a row.

    Attributes:
        title: Name for readers.
        heights: True if points have a third coordinate: metres above home.
        parts: A function that yields geometries (None for a row without a place) and their rows, at
            most `AT_ONCE` cells at a time.
    """

    name: str
    title: str
    geometry: Geometry
    heights: bool
    fields: tuple[Field, ...]
    parts: Callable[[], Iterable[tuple[Shapes, Iterable[Row]]]]

    @classmethod
    def whole(
        cls,
        name: str,
        title: str,
        geometry: Geometry,
        fields: tuple[Field, ...],
        shapes: Shapes,
        rows: Sequence[Row],
        *,
        heights: bool = False,
    ) -> Self:
        """Create a layer from geometries and rows in memory."""
        return cls(name, title, geometry, heights, fields, lambda: [(shapes, rows)])

    @property
    def shapes(self) -> Shapes:
        """All geometries."""
        return np.concatenate([shapes for shapes, _ in self.parts()])

    @property
    def rows(self) -> Iterator[Row]:
        """All rows."""
        return (row for _, rows in self.parts() for row in rows)

    def column(self, name: str) -> list[Value]:
        """Return the values of a column."""
        at = [field.name for field in self.fields].index(name)
        return [row[at] for row in self.rows]

    def records(self) -> Iterator[dict[str, Value]]:
        """Yield the rows, each value by its column."""
        names = [field.name for field in self.fields]
        return (dict(zip(names, row, strict=True)) for row in self.rows)


# --- in degrees ----------------------------------------------------------------------------------
def in_degrees(layer: Layer, data: MapData) -> Shapes:
    """Return the geometries in WGS84, longitude first, rounded, within 180 degrees of the start."""

    def projected(points: NDArray[np.float64]) -> NDArray[np.float64]:
        there = data.grid.zone.lon_lat(points[:, :2])
        there[:, 0] = turned(there[:, 0], data.start)
        return np.column_stack([there.round(DECIMALS), points[:, 2:]])

    shapes: Shapes = shapely.transform(layer.shapes, projected, include_z=layer.heights)
    return shapes


def outline_in_degrees(data: MapData, outline: Polygon | MultiPolygon) -> Polygon | MultiPolygon:
    """Return an outline of the moving frame in degrees, in the form of `in_degrees`."""
    where = data.grid, data.t_s, data.start, DECIMALS
    shape: Polygon | MultiPolygon = shapely.transform(
        outline, lambda points: placed(points, *where)
    )
    return shape


def line_in_degrees(data: MapData, places: Iterable[LatLon]) -> list[tuple[float, float]]:
    """Return longitudes and latitudes of places, in the form of `in_degrees`."""
    known = list(places)
    lons = turned(np.array([place.lon_deg for place in known]), data.start).tolist()
    return [
        (round(lon, DECIMALS), round(place.lat_deg, DECIMALS))
        for lon, place in zip(lons, known, strict=True)
    ]


# --- texts ---------------------------------------------------------------------------------------
def text_of(value: object) -> str:
    """Write a value for readers.

    >>> text_of(True), text_of(2.5)
    ('yes', '2.5')
    """
    if isinstance(value, bool):
        return "yes" if value else "no"
    return str(value)


def described(flown: FlownMission) -> dict[str, Any]:
    """Return mission, version, dates, coordinate system and extent of a map, by name."""
    data = flown.data
    return {
        "mission": data.mission,
        "completed": flown.completed,
        "finding": printable(str(flown.values.get("finding", ""))),
        "version": __version__,
        "begun_utc": flown.calendar.utc(0.0),
        "map_utc": flown.calendar.utc(data.t_s),
        "t_s": round(data.t_s, 3),
        "simulated": flown.simulated,
        "computed_in": flown.crs,
        **flown.extent.figures(),
    }
