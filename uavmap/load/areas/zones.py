"""Zones that meet the fence of a mission: they become holes of the fence.

A zone has no effect if it begins above the maximum height of the mission. An upper limit of a zone
does not matter: vehicles take off and land below it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Literal

import numpy as np
import pyproj
import shapely
from numpy.typing import NDArray
from shapely.geometry import Point, Polygon
from shapely.geometry.base import BaseGeometry

from missions.geo.columns import ring
from missions.geo.grid import Grid
from missions.mission.places import drawn, grid_of, positions_near
from missions.mission.schema import Mission, Zone, positions
from missions.units import GridPoint, LatLon
from uavmap.load.areas.zone_files import FileZone, Limit, Volume, read_zones

CORNERS: Final = 48
"""Number of corners of the polygon around a circle."""
_RIM_M: Final = 0.05
"""Distance of a hole from the fence, m: rings of a polygon may not cross."""
_SMALLEST_M2: Final = 0.1
_NEAR_DEG: Final = 0.02
_STEP_DEG: Final = 0.005
"""Maximum length of an edge, degrees: edges that are straight in degrees are curves in metres."""
_ELSEWHERE_M: Final = 100_000.0
_EARTH: Final = pyproj.Geod(ellps="WGS84")
_GEOID_M: Final = 90.0
"""Maximum height of the sea above the ellipsoid, m."""


def with_zones(mission: Mission, files: Sequence[str], folder: Path, where: str) -> Mission:
    """Return the mission with the zones of files that meet its fence, as holes of it.

    A mission with misplaced positions is returned unchanged: its check reports them. Raises
    `MissionFileError`, which begins with `where` and names the file.
    """
    found = [
        (file, zone) for file in files for zone in read_zones(folder / file, f"{where} {file!r}")
    ]
    if any(positions_near(mission)):
        return mission
    grid = grid_of(mission)
    fence, *holes = (drawn(ring, grid) for ring in (mission.fence.polygon, *mission.fence.holes))
    if not all(shape.is_valid for shape in (fence, *holes)):
        return mission
    near = _MissionFence(mission, grid, fence)
    zones: list[Zone] = []
    shapes: list[BaseGeometry] = []
    for file, zone in found:
        parts = [(volume, near.shape(volume)) for volume in zone.volumes]
        parts = [(volume, shape) for volume, shape in parts if shape.area > _SMALLEST_M2]
        if not parts:
            continue
        low = [(volume, shape) for volume, shape in parts if not near.is_above(volume.lower)]
        allowed = bool({zone.name, zone.ident} & set(mission.fence.allowed_zones))
        effect: Literal["hole", "above", "allowed"] = "allowed" if allowed else "hole"
        words = _words(zone, (low or parts)[0][0], Path(file).name)
        zones.append(Zone(name=zone.name, why=words, effect=effect if low else "above"))
        shapes.append(shapely.union_all([shape for _, shape in low if not allowed]))
    return near.with_holes(zones, shapes)


def _words(zone: FileZone, volume: Volume, file: str) -> str:
    """Describe a zone: "prohibited, from 0 m AGL to 120 m AGL; in zones.json"."""
    lower = "the ground" if volume.lower is None else str(volume.lower)
    heights = f"from {lower}" + ("" if volume.upper is None else f" to {volume.upper}")
    parts = [part for part in (zone.restriction, heights) if part]
    times = "; at some times only, which counts as always" if zone.limited_times else ""
    return f"{', '.join(parts)}{times}; in {file}"


class _MissionFence:
    """The fence and the heights of a mission, with which zones are compared."""

    def __init__(self, mission: Mission, grid: Grid, fence: Polygon) -> None:
        self.mission = mission
        self.grid = grid
        self.fence = fence
        self.room = fence.buffer(-_RIM_M, join_style="mitre")
        places = positions(mission.fence.polygon)
        lon = [place.lon_deg for place in places]
        lat = [place.lat_deg for place in places]
        wide_deg = _NEAR_DEG / max(math.cos(math.radians(max(map(abs, lat)))), 0.01)
        self._bounds = (
            min(lon) - wide_deg, min(lat) - _NEAR_DEG, max(lon) + wide_deg, max(lat) + _NEAR_DEG,
        )  # fmt: skip

    def shape(self, volume: Volume) -> BaseGeometry:
        """Return the part of a volume in the fence, in ground metres."""
        if isinstance(volume.shape, Point):
            return self._circle(volume.shape, volume.radius_m)
        shape = volume.shape if volume.shape.is_valid else shapely.make_valid(volume.shape)
        part = shapely.clip_by_rect(shape, *self._bounds)
        if part.is_empty:
            return Polygon()
        part = shapely.segmentize(part, _STEP_DEG)
        ground = shapely.transform(part, self._on_ground)
        return shapely.make_valid(ground).intersection(self.room)

    def _circle(self, centre: Point, radius_m: float) -> BaseGeometry:
        home = self.mission.home
        away_m = _EARTH.inv(home.lon_deg, home.lat_deg, centre.x, centre.y)[2]
        if away_m > radius_m + _ELSEWHERE_M:  # outside of any grid
            return Polygon()
        middle = self.grid.fixed(LatLon(centre.y, centre.x))
        around = ring(middle, radius_m / math.cos(math.pi / CORNERS), CORNERS)
        return Polygon(around).intersection(self.room)

    def _on_ground(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        points = [self.grid.fixed(LatLon(lat, lon)) for lon, lat in places.tolist()]
        return np.array(points, np.float64).reshape(-1, 2)

    def is_above(self, lower: Limit | None) -> bool:
        """Return whether a volume begins above the maximum height of the mission."""
        if lower is None:
            return False
        mission, relief = self.mission, self.mission.relief
        valley_m = 0.0 if relief is None else min(relief.lowest_m, 0.0)
        sea_m = -math.inf
        if "amsl_m" in mission.start.model_fields_set:
            sea_m = lower.height_m - mission.start.amsl_m
        above_start_m = {
            "AGL": lower.height_m + valley_m,
            "AMSL": sea_m,
            "WGS84": sea_m - _GEOID_M,
            None: min(lower.height_m + valley_m, sea_m - _GEOID_M),
        }[lower.reference]
        return above_start_m >= mission.fence.ceiling_m

    def with_holes(self, zones: Sequence[Zone], shapes: Sequence[BaseGeometry]) -> Mission:
        """Return the mission with these zones; they and its own holes are the fence's holes."""
        fence, holes = self.mission.fence, self.mission.fence.holes
        if any(not shape.is_empty for shape in shapes):
            own = [drawn(hole, self.grid).intersection(self.room) for hole in holes]
            parts = _filled(shapely.union_all([*own, *shapes]))
            holes = tuple(
                tuple(self._vertex(GridPoint(*xy)) for xy in part.exterior.coords[:-1])
                for part in parts
            )
            zones = [
                zone.model_copy(
                    update={"holes": tuple(i for i, p in enumerate(parts) if p.intersects(shape))}
                )
                for zone, shape in zip(zones, shapes, strict=True)
            ]
        changed = fence.model_copy(update={"zones": tuple(zones), "holes": holes})
        return self.mission.model_copy(update={"fence": changed})

    def _vertex(self, point: GridPoint) -> tuple[float, float]:
        place = self.grid.position(point)
        return round(place.lat_deg, 9), round(place.lon_deg, 9)


def _filled(shape: BaseGeometry) -> list[Polygon]:
    """Return the parts of an area without holes: ground that zones enclose is out of reach."""
    parts = [part for part in shapely.get_parts(shape) if isinstance(part, Polygon)]
    whole = [Polygon(part.exterior) for part in parts if part.area > _SMALLEST_M2]
    return list(shapely.get_parts(shapely.union_all(whole)))
