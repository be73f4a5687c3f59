"""The table of a mission file that says what the ground is like, and its relief in the fence."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, model_validator
from pydantic_core import PydanticCustomError
from shapely.geometry import Polygon

from missions.geo.grid import Grid
from missions.geo.terrain import Relief, Terrain, decoded, relief_of
from missions.mission.sections.fields import Count, Number, Positive, Ring, Section, Vertex
from missions.units import LatLon

MOST_POINTS = 250_000
"""Of a lattice: what a journal keeps of the ground stays small."""


class Lattice(Section):
    """The heights of the ground, as they are kept with a mission; `uavmap.load.dem` writes them.

    In metres along the grid's axes around the start (`missions.geo.terrain`).
    """

    west_m: Number
    south_m: Number
    step_m: Positive
    columns: Annotated[Count, Field(ge=2, le=MOST_POINTS)]
    rows: Annotated[Count, Field(ge=2, le=MOST_POINTS)]
    heights: str

    @model_validator(mode="after")
    def _whole(self) -> Lattice:
        if self.rows * self.columns > MOST_POINTS:
            raise ValueError(f"{self.rows} x {self.columns} are more than {MOST_POINTS} heights")
        decoded(self.heights, self.rows, self.columns)
        return self


def _lattice(value: object) -> object:
    if isinstance(value, str):
        raise PydanticCustomError(
            "dem_path", "a GeoTIFF is read only beside the mission file that names it"
        )
    return value


class TerrainSection(Section):
    """Where the heights of the ground come from: a digital elevation model, or the autopilot."""

    dem: Annotated[Lattice | None, BeforeValidator(_lattice)] = None
    """The path of a GeoTIFF, relative to the mission file; what is kept of it is a lattice."""
    source: Literal["autopilot"] | None = None
    """The autopilot's own terrain database, which is asked before take-off."""

    @model_validator(mode="after")
    def _one(self) -> TerrainSection:
        if (self.dem is None) == (self.source is None):
            raise ValueError('give it either dem = "FILE.tif" or source = "autopilot"')
        return self


@lru_cache(maxsize=8)
def terrain_in(lattice: Lattice) -> Terrain:
    """The terrain of a lattice."""
    heights = decoded(lattice.heights, lattice.rows, lattice.columns)
    heights.setflags(write=False)
    return Terrain(lattice.west_m, lattice.south_m, lattice.step_m, heights)


@lru_cache(maxsize=8)
def relief_in(lattice: Lattice, start: Vertex, fence: Ring, *, hull: bool = False) -> Relief:
    """The relief of the ground inside a fence; `hull`: also of what straight ways in it cross."""
    grid = Grid.at(LatLon(*start), 1.0)
    ring = [grid.fixed(LatLon(*vertex)) for vertex in fence]
    area = Polygon(ring)
    return relief_of(terrain_in(lattice), area.convex_hull if hull else area)
