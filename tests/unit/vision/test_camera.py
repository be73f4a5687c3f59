"""The homography against projections that are written out here."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.geo.geodesy import LocalPlane
from missions.geo.grid import Grid
from missions.units import GridPoint, LatLon, Pose, Quaternion
from tests.unit.vision.scene import camera_axes
from vision.camera import Camera, project

PLACES = [LatLon(48.0, 11.9), LatLon(-33.9, 147.3), LatLon(64.0, 8.9), LatLon(0.0, 9.0)]


def test_footprint_and_angles_of_a_right_angled_camera() -> None:
    camera = Camera(math.radians(90.0), 640, 480)
    assert camera.focal_px == pytest.approx(320.0)
    assert camera.vfov_rad == pytest.approx(2 * math.atan(240 / 320))
    assert camera.footprint(40.0) == pytest.approx((80.0, 60.0))


@pytest.mark.parametrize(
    ("hfov_rad", "width_px", "height_px"), [(0.0, 640, 480), (math.pi, 640, 480), (1.0, 0, 480)]
)
def test_what_is_not_a_camera_is_refused(hfov_rad: float, width_px: int, height_px: int) -> None:
    with pytest.raises(ValueError, match=r"hfov_rad|no pixels"):
        Camera(hfov_rad, width_px, height_px)


def test_level_camera_puts_grid_north_up() -> None:
    """10 m up, focal length 100 px: a metre is ten pixels."""
    grid = Grid.at(LatLon(0.0, 9.0), 4.0)  # on the central meridian: no convergence
    camera = Camera(2 * math.atan(0.5), 100, 80)
    down = Quaternion.from_euler(0.0, -math.pi / 2, 0.0)
    matrix = camera.homography(Pose(LatLon(0.0, 9.0), 10.0, down), grid, 0.0)
    pixels, depth = project(matrix, np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 3.0]]))
    assert pixels == pytest.approx(np.array([[49.5, 39.5], [69.5, 39.5], [49.5, 9.5]]))
    assert depth == pytest.approx(np.array([10.0, 10.0, 10.0]))


def test_points_behind_the_camera_have_no_pixels() -> None:
    grid = Grid.at(LatLon(0.0, 9.0), 4.0)
    camera = Camera(1.0, 100, 80)
    north = Quaternion.from_euler(0.0, math.radians(-20.0), 0.0)
    matrix = camera.homography(Pose(LatLon(0.0, 9.0), 10.0, north), grid, 0.0)
    pixels, depth = project(matrix, np.array([[0.0, 50.0], [0.0, -50.0]]))
    assert np.isfinite(pixels[0]).all()
    assert np.isnan(pixels[1]).all()
    assert depth[0] > 0.0 > depth[1]


@settings(max_examples=60, deadline=None)
@given(
    place=st.sampled_from(PLACES),
    roll_deg=st.floats(-25, 25),
    pitch_deg=st.floats(-115, -65),
    yaw_deg=st.floats(-180, 180),
    height_m=st.sampled_from([12.0, 20.0, 40.0]),
    off=st.tuples(st.floats(-200, 200), st.floats(-200, 200)),
    point=st.tuples(st.floats(-4, 4), st.floats(-4, 4)),
    t_s=st.sampled_from([0.0, 300.0]),
)
def test_homography_agrees_with_a_projection_in_the_true_north_plane(
    place: LatLon,
    roll_deg: float,
    pitch_deg: float,
    yaw_deg: float,
    height_m: float,
    off: tuple[float, float],
    point: tuple[float, float],
    t_s: float,
) -> None:
    """The ground point goes over WGS84 into a plane that knows nothing of UTM."""
    grid = Grid.at(place, 4.0, drift_speed_m_s=0.4, drift_toward_deg=120.0)
    camera_at = grid.position(GridPoint(*off))
    ground = GridPoint(off[0] + point[0], off[1] + point[1])
    east_m, north_m = LocalPlane(camera_at).to_plane(grid.position(ground))

    roll, pitch, yaw = (math.radians(a) for a in (roll_deg, pitch_deg, yaw_deg))
    forward, right, down = camera_axes(roll, pitch, yaw)
    ray = np.array([north_m, east_m, height_m])
    depth = ray @ forward
    focal = 320 / math.tan(0.5)
    expected = (319.5 + focal * (ray @ right) / depth, 239.5 + focal * (ray @ down) / depth)

    pose = Pose(camera_at, height_m, Quaternion.from_euler(roll, pitch, yaw))
    matrix = Camera(1.0, 640, 480).homography(pose, grid, t_s)
    pixels, _ = project(matrix, np.array(grid.to_moving(ground, t_s)))
    assert pixels == pytest.approx(expected, abs=0.05)
