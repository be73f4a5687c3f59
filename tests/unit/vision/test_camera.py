"""Cameras: the homography against projections written out here; real lenses straightened."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.geo.geodesy import LocalPlane
from missions.geo.grid import Grid
from missions.units import GridPoint, LatLon, Pose, Quaternion
from tests.unit.vision.scene import camera_axes
from vision.camera import Camera, Lens, Model, distorted, project, straightening

PLACES = [LatLon(48.0, 11.9), LatLon(-33.9, 147.3), LatLon(64.0, 8.9), LatLon(0.0, 9.0)]


def test_footprint_and_angles_of_a_right_angled_camera_are_those_by_hand() -> None:
    camera = Camera(math.radians(90.0), 640, 480)
    assert camera.focal_px == pytest.approx(320.0)
    assert camera.footprint(40.0) == pytest.approx((80.0, 60.0))


@pytest.mark.parametrize(
    ("hfov_rad", "width_px", "height_px"), [(0.0, 640, 480), (math.pi, 640, 480), (1.0, 0, 480)]
)
def test_impossible_camera_is_refused(hfov_rad: float, width_px: int, height_px: int) -> None:
    with pytest.raises(ValueError, match=r"hfov_rad|no pixels"):
        Camera(hfov_rad, width_px, height_px)


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
    """The ground point goes over WGS84 into a plane without UTM."""
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


WIDTH, HEIGHT = 160, 120
LENSES = {
    "brown": Lens(
        WIDTH, HEIGHT, 130.0, 131.0, 82.0, 57.0, "brown", (-0.25, 0.06, 1e-3, -5e-4, 0.0)
    ),
    "pincushion": Lens(WIDTH, HEIGHT, 130.0, 130.0, 79.5, 59.5, "brown", (0.12, 0.0, 0.0, 0.0)),
    "fisheye": Lens(WIDTH, HEIGHT, 70.0, 70.0, 79.5, 59.5, "fisheye", (0.02, -0.01, 0.0, 0.0)),
}


def chequers(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return a smooth pattern over the plane at distance 1."""
    return 128 + 60 * np.sin(9 * x) * np.cos(8 * y) + 40 * np.cos(5 * x + 4 * y)


def taken(lens: Lens) -> np.ndarray:
    """Return the picture of the pattern by the lens; iteration finds each pixel's ray."""
    u, v = np.meshgrid(np.arange(WIDTH, dtype=float), np.arange(HEIGHT, dtype=float))
    pixels = np.stack([u, v], axis=-1).reshape(-1, 1, 2)
    matrix = np.array([[lens.fx_px, 0, lens.cx_px], [0, lens.fy_px, lens.cy_px], [0, 0, 1]])
    coefficients = np.array(lens.distortion)
    if lens.model == "fisheye":
        rays = cv2.fisheye.undistortPoints(pixels, matrix, coefficients)
    else:
        end = (cv2.TERM_CRITERIA_COUNT, 100, 0.0)
        rays = cv2.undistortPoints(
            pixels, matrix, coefficients, None, np.eye(3), np.eye(3), criteria=end
        )
    x, y = rays.reshape(-1, 2).T
    gray = chequers(x, y).reshape(HEIGHT, WIDTH)
    return np.repeat(np.clip(gray, 0, 255).astype(np.uint8)[..., None], 3, axis=2)


@pytest.mark.parametrize("name", LENSES)
def test_a_straightened_picture_is_that_of_its_pinhole(name: str) -> None:
    lens = LENSES[name]
    plan = straightening(lens)
    image = plan.applied(taken(lens))
    u, v = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    focal = plan.camera.focal_px
    expected = chequers((u - (WIDTH - 1) / 2) / focal, (v - (HEIGHT - 1) / 2) / focal)
    off = np.abs(image[:, :, 0].astype(float) - np.clip(expected, 0, 255))
    assert off.max() < 8.0  # nothing is past the rim, and nothing has moved
    assert off.mean() < 1.0


@pytest.mark.parametrize("name", LENSES)
def test_a_scaled_lens_shows_the_same(name: str) -> None:
    lens = LENSES[name]
    double = lens.scaled(2 * WIDTH, 2 * HEIGHT)
    rays = np.array([[0.1, -0.2], [0.3, 0.25]])
    assert (distorted(lens, rays) + 0.5) * 2 - 0.5 == pytest.approx(distorted(double, rays))
    assert straightening(double).camera.hfov_rad == pytest.approx(
        straightening(lens).camera.hfov_rad, abs=1e-3
    )


def test_a_pinhole_needs_no_straightening() -> None:
    lens = Lens.pinhole(math.radians(70.0), WIDTH, HEIGHT)
    assert lens.is_pinhole
    assert not LENSES["brown"].is_pinhole
    image = taken(
        Lens(WIDTH, HEIGHT, lens.fx_px, lens.fx_px, lens.cx_px, lens.cy_px, "brown", (0.0,) * 4)
    )
    assert np.abs(straightening(lens).applied(image).astype(int) - image).max() <= 1


@pytest.mark.parametrize(
    ("change", "blamed"),
    [
        ({"fx_px": 0.0}, "above 0"),
        ({"cx_px": 500.0}, "principal point"),
        ({"distortion": (0.1,)}, "coefficients"),
        ({"fy_px": math.nan}, "finite"),
        ({"model": "fisheye"}, "coefficients"),
    ],
)
def test_impossible_lens_is_refused(change: dict[str, object], blamed: str) -> None:
    model: Model = "brown"
    values = {"fx_px": 100.0, "fy_px": 100.0, "cx_px": 80.0, "cy_px": 60.0, "model": model}
    with pytest.raises(ValueError, match=blamed):
        Lens(WIDTH, HEIGHT, **{**values, **change})  # type: ignore[arg-type]
