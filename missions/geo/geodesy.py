"""WGS84 to and from UTM, and a true-north plane around a place.

PROJ (through pyproj) does the projection. This module chooses the zone, and computes the meridian
convergence and the scale factor. A vehicle measures metres on the ground and true north. The grid
has metres of the projection and grid north.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pyproj
from numpy.typing import NDArray

from missions.errors import GeodesyError
from missions.units import LatLon

SOUTH_LIMIT_DEG, NORTH_LIMIT_DEG = -80.0, 84.0

# WGS84 ellipsoid
_A_M = 6378137.0
_E2 = 6.69437999014e-3


@dataclass(frozen=True, slots=True)
class Utm:
    """A position in a UTM zone: easting and northing in metres of the projection."""

    east_m: float
    north_m: float


@dataclass(frozen=True, slots=True)
class UtmZone:
    """A UTM zone of WGS84.

    >>> UtmZone.containing(LatLon(48.0, 11.0))
    UtmZone(number=32, south=False)
    >>> UtmZone.containing(LatLon(-33.9, 151.2)).epsg
    32756
    """

    number: int
    south: bool

    @classmethod
    def containing(cls, position: LatLon) -> UtmZone:
        """Return the zone of a position, with the exceptions for south-west Norway and Svalbard.

        Raises `GeodesyError` outside 80 S to 84 N and for longitudes beyond 180 degrees.
        """
        lat, lon = position.lat_deg, position.lon_deg
        if not SOUTH_LIMIT_DEG <= lat <= NORTH_LIMIT_DEG:
            raise GeodesyError(
                f"latitude {lat:g} lies outside the UTM grid (80 S to 84 N); "
                "polar missions are not supported"
            )
        if not -180.0 <= lon <= 180.0:
            raise GeodesyError(f"longitude {lon:g} lies outside -180 to 180 degrees")
        number = min(int((lon + 180.0) // 6.0), 59) + 1
        if 56.0 <= lat < 64.0 and 3.0 <= lon < 12.0:
            number = 32
        elif lat >= 72.0 and 0.0 <= lon < 42.0:
            number = 31 if lon < 9.0 else 33 if lon < 21.0 else 35 if lon < 33.0 else 37
        return cls(number, lat < 0.0)

    @property
    def epsg(self) -> int:
        """EPSG code of WGS 84 / UTM in this zone."""
        return (32700 if self.south else 32600) + self.number

    def to_utm(self, position: LatLon) -> Utm:
        """Return the UTM position; exact also a little outside the zone."""
        east, north = _proj(self)(position.lon_deg, position.lat_deg)
        return Utm(float(east), float(north))

    def to_wgs84(self, point: Utm) -> LatLon:
        """Return the WGS84 position: the inverse of `to_utm`."""
        lon, lat = _proj(self)(point.east_m, point.north_m, inverse=True)
        return LatLon(float(lat), float(lon))

    def lon_lat(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return longitudes and latitudes, shape (n, 2), of UTM eastings and northings, shape (n,
        2)."""
        east, north = np.ascontiguousarray(points.T)
        return np.column_stack(_proj(self)(east, north, inverse=True))

    def utm(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return UTM eastings and northings: the inverse of `lon_lat`."""
        lon, lat = np.ascontiguousarray(points.T)
        return np.column_stack(_proj(self)(lon, lat))

    def convergence_rad(self, position: LatLon) -> float:
        """Return the angle from true north to grid north at a place, clockwise positive, rad.

        East of the central meridian (northern hemisphere) grid north points east of true north.
        """
        factors = _proj(self).get_factors(position.lon_deg, position.lat_deg)
        return math.radians(factors.meridian_convergence)

    def scale(self, position: LatLon) -> float:
        """Return metres of the projection per metre on the ground, 0.9996 on the central
        meridian."""
        factors = _proj(self).get_factors(position.lon_deg, position.lat_deg)
        return float(factors.meridional_scale)


@lru_cache(maxsize=8)
def _proj(zone: UtmZone) -> pyproj.Proj:
    return pyproj.Proj(proj="utm", zone=zone.number, south=zone.south, ellps="WGS84")


@dataclass(frozen=True, slots=True)
class LocalPlane:
    """A plane of metres along true east and true north around an origin.

    It uses the radii of curvature of the ellipsoid at the origin: good to a centimetre within two
    kilometres away from the poles. It is independent of UTM, so that each can check the other.
    """

    origin: LatLon

    def to_plane(self, position: LatLon) -> tuple[float, float]:
        """Return the metres (true east, true north) of a position."""
        lat0 = math.radians(self.origin.lat_deg)
        dlat = math.radians(position.lat_deg) - lat0
        dlon = math.remainder(math.radians(position.lon_deg - self.origin.lon_deg), math.tau)
        meridian = _meridian_m(lat0 + dlat / 2)
        east = _prime_vertical_m(lat0 + dlat) * math.cos(lat0 + dlat) * dlon
        # a parallel bends towards the pole, away from the tangent at the origin
        north = meridian * dlat + 0.5 * east * dlon * math.sin(lat0 + dlat)
        return east, north

    def to_wgs84(self, east_m: float, north_m: float) -> LatLon:
        """Return the position: the inverse of `to_plane`, to below a tenth of a millimetre."""
        lat0 = math.radians(self.origin.lat_deg)
        dlat, dlon = 0.0, 0.0
        for _ in range(4):
            lat, last = lat0 + dlat, dlat
            dlon = east_m / (_prime_vertical_m(lat) * math.cos(lat))
            dlat = (north_m - 0.5 * east_m * dlon * math.sin(lat)) / _meridian_m(lat0 + dlat / 2)
            if dlat == last:  # another round would change nothing
                break
        lon = math.remainder(self.origin.lon_deg + math.degrees(dlon), 360.0)
        return LatLon(math.degrees(lat0 + dlat), lon)


def _meridian_m(lat_rad: float) -> float:
    """Return the radius of curvature along the meridian, m."""
    return _A_M * (1.0 - _E2) / math.pow(1.0 - _E2 * math.sin(lat_rad) ** 2, 1.5)


def _prime_vertical_m(lat_rad: float) -> float:
    """Return the radius of curvature across the meridian, m."""
    return _A_M / math.sqrt(1.0 - _E2 * math.sin(lat_rad) ** 2)
