"""Values with their units and frames in the name: the vocabulary of every package.

Frames used throughout:

* **WGS84**: `LatLon`, degrees.
* **grid frame**: `GridPoint`, metres *on the ground* along UTM grid east and grid north from the
  centre of cell (0, 0). It is fixed to the ground, or it moves with a drifting ROI; the name of
  the function gives the frame (`missions.geo.grid`).
* **NED**: the vehicle's north-east-down, true north; attitudes are quaternions from the camera's
  forward-right-down axes to NED, as in CAMERA_IMAGE_CAPTURED.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple


class Cell(NamedTuple):
    """A grid cell by its column (towards grid east) and row (towards grid north).

    >>> Cell(0, 0).neighbours()[0]
    Cell(east=0, north=1)
    """

    east: int
    north: int

    def neighbours(self) -> tuple[Cell, Cell, Cell, Cell]:
        """Return the four neighbours in the order north, east, south, west."""
        e, n = self
        return (Cell(e, n + 1), Cell(e + 1, n), Cell(e, n - 1), Cell(e - 1, n))

    def cross(self) -> tuple[Cell, Cell, Cell, Cell, Cell]:
        """Return the cell itself and its four neighbours: the cells of one frame's votes."""
        return (self, *self.neighbours())


@dataclass(frozen=True, slots=True)
class LatLon:
    """A WGS84 position in degrees."""

    lat_deg: float
    lon_deg: float


class PadHeight(NamedTuple):
    """The height of a vehicle's receiver on its pad above the sea, with its standard deviation,
    m."""

    amsl_m: float
    sigma_m: float


class GridPoint(NamedTuple):
    """Ground metres along grid east and grid north from the centre of cell (0, 0)."""

    east_m: float
    north_m: float

    def distance_to(self, other: GridPoint) -> float:
        """Return the straight distance, m."""
        return math.hypot(self.east_m - other.east_m, self.north_m - other.north_m)

    def towards(self, other: GridPoint, distance_m: float) -> GridPoint:
        """Return the point at `distance_m` from here on the line to another."""
        share = distance_m / max(self.distance_to(other), 1e-9)
        return GridPoint(
            self.east_m + share * (other.east_m - self.east_m),
            self.north_m + share * (other.north_m - self.north_m),
        )


class Quaternion(NamedTuple):
    """A rotation (w, x, y, z), unit length, from body or camera axes to NED."""

    w: float
    x: float
    y: float
    z: float

    @classmethod
    def from_euler(cls, roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quaternion:
        """Return the rotation by aerospace angles (yaw about down, then pitch, then roll).

        >>> Quaternion.from_euler(0.0, 0.0, 0.0)
        Quaternion(w=1.0, x=0.0, y=0.0, z=0.0)
        """
        cr, sr = math.cos(roll_rad / 2), math.sin(roll_rad / 2)
        cp, sp = math.cos(pitch_rad / 2), math.sin(pitch_rad / 2)
        cy, sy = math.cos(yaw_rad / 2), math.sin(yaw_rad / 2)
        return cls(
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        )


@dataclass(frozen=True, slots=True)
class Pose:
    """The position and attitude of a camera when it took a picture.

    `height_m` is above the ground plane, taken to be the level of home. `attitude` turns the
    camera's forward-right-down axes (forward is the optical axis, down the lower edge of the
    picture) to NED, true north.
    """

    position: LatLon
    height_m: float
    attitude: Quaternion
