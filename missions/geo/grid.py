"""The grid: square cells aligned with UTM grid north, its origin at the start.

Cells are measured in metres on the ground, so the projection's scale factor lies between a cell and
its UTM coordinates. True north and grid north differ by the meridian convergence. A grid may move
with a drifting ROI: a cell then keeps its name and its ground, and changes its position.

Two frames of ground metres share their axes:

* *fixed*: tied to the ground. Home, search box and geofence live here.
* *moving*: tied to the ROI, equal to the fixed frame at `t_s = 0`. Cells live here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from shapely.geometry import Point, Polygon

from missions.geo.geodesy import Utm, UtmZone
from missions.units import Cell, GridPoint, LatLon


@dataclass(frozen=True, slots=True)
class Grid:
    """Cells of `cell_m` metres around `start`, drifting with (`drift_east_m_s`, `drift_north_m_s`).

    The drift is along the grid's axes. Times `t_s` are mission seconds.

    >>> grid = Grid.at(LatLon(48.0, 11.0), cell_m=4.0)
    >>> grid.cell_at(grid.centre(Cell(3, -2), t_s=0.0), t_s=0.0)
    Cell(east=3, north=-2)
    """

    zone: UtmZone
    origin: Utm
    scale: float
    convergence_rad: float
    cell_m: float
    drift_east_m_s: float = 0.0
    drift_north_m_s: float = 0.0

    @classmethod
    def at(
        cls,
        start: LatLon,
        cell_m: float,
        drift_speed_m_s: float = 0.0,
        drift_toward_deg: float = 0.0,
    ) -> Grid:
        """Return a grid whose cell (0, 0) is centred on `start`; the ROI drifts towards a true
        bearing.

        Raises `GeodesyError` outside 80 S to 84 N.
        """
        zone = UtmZone.containing(start)
        convergence = zone.convergence_rad(start)
        bearing = math.radians(drift_toward_deg) - convergence
        return cls(
            zone,
            zone.to_utm(start),
            zone.scale(start),
            convergence,
            cell_m,
            drift_speed_m_s * math.sin(bearing),
            drift_speed_m_s * math.cos(bearing),
        )

    @property
    def drift_m_s(self) -> tuple[float, float]:
        """Velocity of the ROI over ground, east and north."""
        return self.drift_east_m_s, self.drift_north_m_s

    @property
    def drift_speed_m_s(self) -> float:
        """Speed of the ROI over ground."""
        return math.hypot(self.drift_east_m_s, self.drift_north_m_s)

    # --- WGS84 and the fixed frame -------------------------------------------------------
    def fixed(self, position: LatLon) -> GridPoint:
        """Return a position in ground metres along the grid's axes."""
        utm = self.zone.to_utm(position)
        return GridPoint(
            (utm.east_m - self.origin.east_m) / self.scale,
            (utm.north_m - self.origin.north_m) / self.scale,
        )

    def position(self, point: GridPoint) -> LatLon:
        """Return the WGS84 position: the inverse of `fixed`."""
        return self.zone.to_wgs84(
            Utm(
                self.origin.east_m + point.east_m * self.scale,
                self.origin.north_m + point.north_m * self.scale,
            )
        )

    # --- fixed and moving frame ----------------------------------------------------------
    def to_moving(self, point: GridPoint, t_s: float) -> GridPoint:
        """Return a point of the ground in the frame of the ROI at time `t_s`."""
        return GridPoint(
            point.east_m - self.drift_east_m_s * t_s, point.north_m - self.drift_north_m_s * t_s
        )

    def to_fixed(self, point: GridPoint, t_s: float) -> GridPoint:
        """Return a point of the ROI over ground at time `t_s`."""
        return GridPoint(
            point.east_m + self.drift_east_m_s * t_s, point.north_m + self.drift_north_m_s * t_s
        )

    # --- cells ---------------------------------------------------------------------------
    def cell_of(self, point: GridPoint) -> Cell:
        """Return the cell that holds a point of the moving frame."""
        return Cell(
            math.floor(point.east_m / self.cell_m + 0.5),
            math.floor(point.north_m / self.cell_m + 0.5),
        )

    def centre_of(self, cell: Cell) -> GridPoint:
        """Return the centre of a cell in the moving frame."""
        return GridPoint(cell.east * self.cell_m, cell.north * self.cell_m)

    def cell_at(self, position: LatLon, t_s: float) -> Cell:
        """Return the cell over which a position lies at time `t_s`."""
        return self.cell_of(self.to_moving(self.fixed(position), t_s))

    def centre(self, cell: Cell, t_s: float) -> LatLon:
        """Return the centre of a cell at time `t_s`."""
        return self.position(self.to_fixed(self.centre_of(cell), t_s))

    def cells_in(self, area: Polygon) -> list[Cell]:
        """Return the cells whose centre an area of the moving frame covers, by column."""
        west, south, east, north = area.bounds
        columns = range(math.ceil(west / self.cell_m), math.floor(east / self.cell_m) + 1)
        rows = range(math.ceil(south / self.cell_m), math.floor(north / self.cell_m) + 1)
        cells = (Cell(i, j) for i in columns for j in rows)
        return [cell for cell in cells if area.covers(Point(self.centre_of(cell)))]

    def corners_of(self, cell: Cell) -> tuple[GridPoint, GridPoint, GridPoint, GridPoint]:
        """Return the south-west, south-east, north-east, north-west corner in the moving frame."""
        (e, n), h = self.centre_of(cell), self.cell_m / 2
        return (
            GridPoint(e - h, n - h),
            GridPoint(e + h, n - h),
            GridPoint(e + h, n + h),
            GridPoint(e - h, n + h),
        )
