"""Golden values against pyproj: zones, projection, convergence, scale, the grid on the ground."""

import math

import pyproj
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.errors import GeodesyError
from missions.geo.geodesy import LocalPlane, UtmZone
from missions.geo.grid import Grid
from missions.units import Cell, GridPoint, LatLon

FAST = settings(max_examples=150, deadline=None)
GEOD = pyproj.Geod(ellps="WGS84")

places = st.builds(LatLon, st.floats(-80, 84), st.floats(-180, 180))
PLACES = [
    LatLon(48.0, 11.0),
    LatLon(-33.9, 151.2),
    LatLon(0.0, 0.0),
    LatLon(-0.001, 5.999),
    LatLon(37.1973, -80.5789),
    LatLon(60.4, 5.3),  # Bergen: zone 32 reaches west
    LatLon(78.2, 15.6),  # Svalbard: zone 33 is twelve degrees wide
    LatLon(-79.99, -179.99),
    LatLon(83.99, 179.99),
    LatLon(10.0, 180.0),
]


@pytest.mark.parametrize("place", PLACES)
def test_projection_agrees_with_proj(place):
    zone = UtmZone.containing(place)
    to_utm = pyproj.Transformer.from_crs(4326, zone.epsg, always_xy=True)
    east_m, north_m = to_utm.transform(place.lon_deg, place.lat_deg)
    utm = zone.to_utm(place)
    assert (utm.east_m, utm.north_m) == pytest.approx((east_m, north_m), abs=1e-4)
    back = zone.to_wgs84(utm)
    assert back.lat_deg == pytest.approx(place.lat_deg, abs=1e-9)
    assert math.remainder(back.lon_deg - place.lon_deg, 360) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg", "epsg"),
    [
        (48, 5.9999, 32631),
        (48, 6, 32632),
        (48, -180, 32601),
        (48, 179.9999, 32660),
        (48, 180, 32660),
        (0, 3, 32631),
        (-1e-9, 3, 32731),
        # south-west Norway
        (55.9999, 4, 32631),
        (56, 2.9999, 32631),
        (56, 3, 32632),
        (63.9999, 11.9999, 32632),
        (64, 4, 32631),
        # Svalbard
        (71.9999, 8, 32632),
        (72, 8.9999, 32631),
        (72, 9, 32633),
        (75, 20.9999, 32633),
        (75, 21, 32635),
        (75, 32.9999, 32635),
        (75, 33, 32637),
        (84, 41.9999, 32637),
        (75, 42, 32638),
        (75, -0.0001, 32630),
        (-80, 0, 32731),
    ],
)
def test_zone_at_its_edge_is_that_of_the_standard(lat_deg, lon_deg, epsg):
    assert UtmZone.containing(LatLon(lat_deg, lon_deg)).epsg == epsg


@FAST
@given(places)
def test_the_zone_is_one_that_proj_names(place):
    """Outside the exceptions, PROJ's own database of areas of use agrees."""
    zone = UtmZone.containing(place)
    crs = pyproj.CRS.from_epsg(zone.epsg)
    assert f"zone {zone.number}{'S' if zone.south else 'N'}" in crs.name


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg"), [(84.0001, 0), (-80.0001, 0), (90, 0), (0, 180.5), (0, -181)]
)
def test_place_beyond_the_limits_of_utm_is_refused(lat_deg, lon_deg):
    with pytest.raises(GeodesyError, match=f"{lat_deg:g}|{lon_deg:g}"):
        UtmZone.containing(LatLon(lat_deg, lon_deg))
    with pytest.raises(GeodesyError):
        Grid.at(LatLon(lat_deg, lon_deg), cell_m=4.0)


# --- the grid --------------------------------------------------------------------------------
offsets = st.integers(-120, 120)
drifts = st.tuples(st.floats(0, 2), st.floats(0, 360))


@FAST
@given(places, offsets, offsets, drifts, st.floats(0, 3000))
def test_a_cell_is_where_its_centre_is(start, east, north, drift, t_s):
    grid = Grid.at(start, 4.0, *drift)
    cell = Cell(east, north)
    centre = grid.centre(cell, t_s)
    assert grid.cell_at(centre, t_s) == cell
    corners = [
        grid.position(
            grid.to_fixed(GridPoint(0.99 * c.east_m + 0.01 * m.east_m,
                                    0.99 * c.north_m + 0.01 * m.north_m), t_s)
        )
        for m in (grid.centre_of(cell),)
        for c in grid.corners_of(cell)
    ]  # fmt: skip
    assert {grid.cell_at(corner, t_s) for corner in corners} == {cell}


@FAST
@given(places)
def test_the_start_is_the_middle_of_the_first_cell(start):
    grid = Grid.at(start, 4.0)
    assert grid.fixed(start) == GridPoint(0.0, 0.0)
    assert grid.cell_at(start, 0.0) == Cell(0, 0)


@FAST
@given(places)
def test_grid_north_lies_the_convergence_away_from_true_north(start):
    grid = Grid.at(start, 4.0)
    tip = grid.centre(Cell(0, 10), 0.0)
    azimuth_deg, _, _ = GEOD.inv(start.lon_deg, start.lat_deg, tip.lon_deg, tip.lat_deg)
    off_rad = math.remainder(math.radians(azimuth_deg) - grid.convergence_rad, math.tau)
    assert off_rad == pytest.approx(0.0, abs=2e-4)


def test_the_convergence_has_the_right_sign():
    """East of the central meridian: clockwise in the north, anticlockwise in the south."""
    assert UtmZone.containing(LatLon(48, 11)).convergence_rad(LatLon(48, 11)) > 0.01
    assert UtmZone.containing(LatLon(-48, 11)).convergence_rad(LatLon(-48, 11)) < -0.01
    assert UtmZone.containing(LatLon(48, 9)).convergence_rad(LatLon(48, 9)) == pytest.approx(
        0, abs=1e-12
    )
    assert UtmZone.containing(LatLon(48, 9)).scale(LatLon(48, 9)) == pytest.approx(0.9996, abs=1e-9)


@FAST
@given(places, st.floats(0.1, 3), st.floats(0, 360), st.floats(1, 600))
def test_a_drifting_cell_moves_along_its_true_bearing(start, speed_m_s, toward_deg, t_s):
    grid = Grid.at(start, 4.0, speed_m_s, toward_deg)
    then = grid.centre(Cell(0, 0), t_s)
    azimuth_deg, _, far_m = GEOD.inv(start.lon_deg, start.lat_deg, then.lon_deg, then.lat_deg)
    assert far_m == pytest.approx(speed_m_s * t_s, rel=1e-3)
    if far_m > 1.0:
        # true bearings turn along the way where meridians run together
        turn_deg = math.degrees(far_m / 6.3e6 * math.tan(math.radians(abs(start.lat_deg))))
        assert abs(math.remainder(azimuth_deg - toward_deg, 360)) < 0.05 + turn_deg


points = st.builds(GridPoint, st.floats(-2000, 2000), st.floats(-2000, 2000))


@FAST
@given(st.sampled_from(PLACES), points, points)
def test_a_metre_of_the_grid_is_a_metre_on_the_ground(start, a, b):
    """The distance is measured on the ellipsoid; the projection alone would be 0.04 % short."""
    grid = Grid.at(start, 4.0)
    one, other = grid.position(a), grid.position(b)
    metres = GEOD.inv(one.lon_deg, one.lat_deg, other.lon_deg, other.lat_deg)[2]
    # the scale is that of the start: 2 km away it is off by at most a few parts in 100,000
    assert a.distance_to(b) == pytest.approx(metres, rel=1e-4, abs=1e-3)


def test_a_place_beyond_the_edge_of_the_zone_stays_in_the_grid_of_the_start():
    """A mission that crosses 12 degrees east is one grid, not two."""
    start = LatLon(48.0, 11.9999)
    grid = Grid.at(start, 4.0)
    beyond = LatLon(48.0, 12.001)
    assert UtmZone.containing(beyond) != grid.zone
    away_m = GEOD.inv(start.lon_deg, start.lat_deg, beyond.lon_deg, beyond.lat_deg)[2]
    assert grid.fixed(beyond).distance_to(GridPoint(0, 0)) == pytest.approx(away_m, rel=1e-4)


@pytest.mark.parametrize(
    ("east_m", "north_m", "cell"),
    [(0, 0, (0, 0)), (1.99, -1.99, (0, 0)), (2.0, 0, (1, 0)), (-2.0, 0, (0, 0)),
     (-2.01, 0, (-1, 0)), (6.1, -6.1, (2, -2))],
)  # fmt: skip
def test_every_point_is_in_one_cell(east_m, north_m, cell):
    """The western and southern edges belong to a cell, the others to its neighbours."""
    assert Grid.at(PLACES[0], 4.0).cell_of(GridPoint(east_m, north_m)) == Cell(*cell)


# --- the local plane -------------------------------------------------------------------------
@FAST
@given(
    st.builds(LatLon, st.floats(-80, 80), st.floats(-180, 180)),
    st.floats(-1400, 1400),
    st.floats(-1400, 1400),
)
def test_local_plane_agrees_with_an_azimuthal_projection(origin, east_m, north_m):
    plane = LocalPlane(origin)
    aeqd = pyproj.Proj(proj="aeqd", lat_0=origin.lat_deg, lon_0=origin.lon_deg, ellps="WGS84")
    place = plane.to_wgs84(east_m, north_m)
    assert aeqd(place.lon_deg, place.lat_deg) == pytest.approx((east_m, north_m), abs=0.01)
    assert plane.to_plane(place) == pytest.approx((east_m, north_m), abs=1e-4)


@FAST
@given(st.builds(LatLon, st.floats(-79, 83), st.floats(-179, 179)), st.floats(0, 360))
def test_plane_and_grid_differ_by_the_convergence(start, bearing_deg):
    """Both ways from the ground to degrees agree."""
    grid, plane = Grid.at(start, 4.0), LocalPlane(start)
    bearing_rad = math.radians(bearing_deg)
    place = plane.to_wgs84(100 * math.sin(bearing_rad), 100 * math.cos(bearing_rad))
    turned_rad = bearing_rad - grid.convergence_rad
    expected = (100 * math.sin(turned_rad), 100 * math.cos(turned_rad))
    assert grid.fixed(place) == pytest.approx(expected, abs=0.02)
