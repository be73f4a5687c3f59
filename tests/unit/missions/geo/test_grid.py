"""The grid on the ground: true metres, true bearings, and a drift that carries the cells along."""

from __future__ import annotations

import math

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
drifts = st.tuples(st.floats(0, 3), st.floats(0, 360))
times = st.floats(0, 7200)


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


@FAST
@given(starts, points)
def test_there_and_back_again(start: LatLon, point: GridPoint) -> None:
    grid = Grid.at(start, 4.0)
    again = grid.fixed(grid.position(point))
    assert again.distance_to(point) < 1e-5


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


@FAST
@given(st.integers(-500, 500), st.integers(-500, 500), st.floats(0.5, 20))
def test_a_cell_is_a_square_round_its_centre(east: int, north: int, cell_m: float) -> None:
    grid = Grid.at(PLACES[0], cell_m)
    cell = Cell(east, north)
    centre = grid.centre_of(cell)
    south_west, south_east, north_east, north_west = grid.corners_of(cell)
    assert south_east.east_m - south_west.east_m == pytest.approx(cell_m)
    assert north_west.north_m - south_west.north_m == pytest.approx(cell_m)
    assert (north_east.east_m, north_east.north_m) == pytest.approx(
        (south_east.east_m, north_west.north_m)
    )
    for corner in grid.corners_of(cell):
        assert corner.distance_to(centre) == pytest.approx(cell_m / math.sqrt(2))
    assert grid.cell_of(centre) == cell


@FAST
@given(st.integers(-99, 99), st.integers(-99, 99))
def test_neighbours_share_an_edge(east: int, north: int) -> None:
    grid = Grid.at(PLACES[0], 4.0)
    cell = Cell(east, north)
    for near in cell.neighbours():
        assert len(set(grid.corners_of(cell)) & set(grid.corners_of(near))) == 2
        assert grid.centre_of(cell).distance_to(grid.centre_of(near)) == pytest.approx(4.0)


# --- drift -----------------------------------------------------------------------------------
@FAST
@given(starts, drifts, points, times)
def test_the_two_frames_are_inverse_to_each_other(
    start: LatLon, drift: tuple[float, float], point: GridPoint, t_s: float
) -> None:
    grid = Grid.at(start, 4.0, *drift)
    again = grid.to_moving(grid.to_fixed(point, t_s), t_s)
    assert again.distance_to(point) < 1e-6
    assert grid.to_fixed(point, 0.0) == point


@FAST
@given(starts, drifts, times)
def test_the_speed_of_the_drift_is_what_was_given(
    start: LatLon, drift: tuple[float, float], t_s: float
) -> None:
    grid = Grid.at(start, 4.0, *drift)
    assert grid.drift_speed_m_s == pytest.approx(drift[0], abs=1e-12)
    moved = grid.to_fixed(GridPoint(0, 0), t_s)
    assert moved.distance_to(GridPoint(0, 0)) == pytest.approx(drift[0] * t_s, abs=1e-6)


def test_without_a_drift_time_does_not_matter() -> None:
    grid = Grid.at(PLACES[0], 4.0)
    point = GridPoint(3.0, -8.0)
    assert grid.to_fixed(point, 9999.0) == grid.to_moving(point, 9999.0) == point
    assert grid.drift_speed_m_s == 0.0
