"""The grid on the ground: true metres, across the edges of zones, and one cell for each point."""

from __future__ import annotations

import pyproj
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.geo.geodesy import UtmZone
from missions.geo.grid import Grid
from missions.units import Cell, GridPoint, LatLon

FAST = settings(max_examples=120, deadline=None)
GEOD = pyproj.Geod(ellps="WGS84")

PLACES = [
    LatLon(48.0, 11.0),
    LatLon(37.1973, -80.5789),
    LatLon(-36.85, 174.76),
    LatLon(69.6, 18.2),
    LatLon(0.0, 9.0),
    LatLon(-79.5, -179.9),
]
starts = st.sampled_from(PLACES)
points = st.builds(GridPoint, st.floats(-2000, 2000), st.floats(-2000, 2000))


# --- metres ----------------------------------------------------------------------------------
@FAST
@given(starts, points, points)
def test_a_metre_of_the_grid_is_a_metre_on_the_ground(
    start: LatLon, a: GridPoint, b: GridPoint
) -> None:
    """Measured on the ellipsoid; the projection alone would be 0.04 % short."""
    grid = Grid.at(start, 4.0)
    one, other = grid.position(a), grid.position(b)
    metres = GEOD.inv(one.lon_deg, one.lat_deg, other.lon_deg, other.lat_deg)[2]
    # the scale is that of the start: 2 km away it is off by at most a few parts in 100,000
    assert a.distance_to(b) == pytest.approx(metres, rel=1e-4, abs=1e-3)


def test_a_place_beyond_the_edge_of_the_zone_stays_in_the_grid_of_the_start() -> None:
    """A mission that crosses 12 degrees east is one grid, not two."""
    start = LatLon(48.0, 11.9999)
    grid = Grid.at(start, 4.0)
    beyond = LatLon(48.0, 12.001)
    assert UtmZone.of(beyond) != grid.zone
    away_m = GEOD.inv(start.lon_deg, start.lat_deg, beyond.lon_deg, beyond.lat_deg)[2]
    assert grid.fixed(beyond).distance_to(GridPoint(0, 0)) == pytest.approx(away_m, rel=1e-4)


# --- cells -----------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("east_m", "north_m", "cell"),
    [(0, 0, (0, 0)), (1.99, -1.99, (0, 0)), (2.0, 0, (1, 0)), (-2.0, 0, (0, 0)),
     (-2.01, 0, (-1, 0)), (6.1, -6.1, (2, -2))],
)  # fmt: skip
def test_every_point_is_in_one_cell(east_m: float, north_m: float, cell: tuple[int, int]) -> None:
    """The western and southern edges belong to a cell, the others to its neighbours."""
    assert Grid.at(PLACES[0], 4.0).cell_of(GridPoint(east_m, north_m)) == Cell(*cell)
