"""The border between heights above the ground, which a mission reckons in, and heights above home.

An autopilot is told, and tells, heights above its home. Where a mission flies above the ground
(`flight.height_above`), the height of the ground below is added to every height that is sent and
taken from every height that is heard: here and nowhere else, for both drivers. The ground is
reckoned from where the vehicle's own home is in the terrain, so what satellite navigation says of
heights above the sea does not matter.
"""

from __future__ import annotations

import math

from missions.errors import GeodesyError
from missions.geo.grid import Grid
from missions.geo.terrain import Terrain
from missions.units import GridPoint, LatLon


class GroundBelow:
    """The ground of one vehicle, relative to its home.

    `home` is taken when it is told; until then the vehicle stands on its home.
    """

    def __init__(self, terrain: Terrain, grid: Grid) -> None:
        self.terrain = terrain
        self.grid = grid
        self._home: LatLon | None = None
        self._home_m = 0.0

    def above_home_m(self, place: LatLon, home: LatLon | None) -> float:
        """How much higher the ground at a place is than at home; 0 for what is no place."""
        try:
            point = self.grid.fixed(place)
        except GeodesyError:
            return 0.0
        return self.lift_m(point, home) if all(map(math.isfinite, point)) else 0.0

    def lift_m(self, point: GridPoint, home: LatLon | None) -> float:
        """The same for a point of the fixed frame."""
        return 0.0 if home is None else self.terrain.height_m(point) - self._at_home_m(home)

    def climb_m_s(self, point: GridPoint, v_east_m_s: float, v_north_m_s: float) -> float:
        """How fast the ground rises below what moves over it."""
        ahead_s = 0.25
        a, b = (
            GridPoint(point.east_m + s * v_east_m_s, point.north_m + s * v_north_m_s)
            for s in (-ahead_s, ahead_s)
        )
        return (self.terrain.height_m(b) - self.terrain.height_m(a)) / (2.0 * ahead_s)

    def _at_home_m(self, home: LatLon) -> float:
        if home != self._home:
            self._home = home
            self._home_m = self.terrain.height_m(self.grid.fixed(home))
        return self._home_m
