from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from missions.units import LatLon, Pose, Quaternion
from sitl.camera.pinhole import CameraSpec, Shot
from sitl.camera.render import render
from sitl.world.world import Patch as Region
from sitl.world.world import World, WorldSpec
from tests.unit.vision.own_map.test_own_map import taken
from tests.unit.vision.scene import decoded
from vision.camera import Camera
from vision.own_map.ground_match import Match, compare, match, resized
from vision.own_map.ground_patch import patch, resolution_m
from vision.projection import Frame

PHOTOGRAPHS = Path(__file__).resolve().parents[4] / "../shared/data/brighton_beach"
ORIGIN = LatLon(48.0, 11.0)
SPEC = CameraSpec(hfov_deg=80.0, width_px=640, height_px=480)
CAMERA = Camera(math.radians(80.0), 640, 480)
PLANE = World(WorldSpec(ORIGIN, 0.0, ())).plane
STRIP = Region(
    tuple(PLANE.to_wgs84(e, n) for e, n in ((3.0, -60.0), (20.0, -60.0), (20.0, 60.0), (3.0, 60.0)))
)
WORLD = World(WorldSpec(ORIGIN, 0.0, (STRIP,), seed=5))
DOWN = Quaternion.from_euler(0.0, -math.pi / 2.0, 0.0)


def frame(
    east_m,
    north_m,
    height_m,
    attitude=(0.0, 0.0, 0.0),
    reported_yaw_rad=None,
    seed=1,
    world=WORLD,
):
    data = render(world, SPEC, Shot(east_m, north_m, height_m, SPEC.attitude(*attitude), 0.0, seed))
    roll, pitch, yaw = attitude
    reported = SPEC.attitude(roll, pitch, yaw if reported_yaw_rad is None else reported_yaw_rad)
    return Frame(decoded(data), Pose(ORIGIN, height_m + 0.1, reported), 0.0, CAMERA)


def shown(taken):
    found = patch(taken)
    assert found is not None
    return found


def level(gray):
    """Return a frame of level ground from 12 m: a pixel is 0.0315 m."""
    image = np.repeat(np.clip(gray, 0, 255).astype(np.uint8)[..., None], 3, axis=2)
    return Frame(image, Pose(ORIGIN, 12.0, DOWN), 0.0, CAMERA)


# --- limits of a match -----------------------------------------------------------------------
@pytest.mark.parametrize("height_m", [12.0, 24.0, 40.0])
@pytest.mark.parametrize("gain", [1.0, 0.75])
def test_match_moves_as_far_as_the_ground(height_m, gain):
    rng = np.random.default_rng(round(height_m))
    errors = []
    for k in range(4):
        east, north, yaw = *rng.uniform(-12.0, 15.0, 2), rng.uniform(0.0, math.tau)
        d_east, d_north = rng.uniform(-0.3, 0.3, 2) * height_m
        lean = rng.uniform(-0.087, 0.087, (2, 2))  # up to 5 degrees
        a = frame(east, north, height_m, (*lean[0], yaw), seed=2 * k)
        b = frame(east + d_east, north + d_north, height_m, (*lean[1], yaw + 0.4), seed=2 * k + 1)
        if gain != 1.0:
            b = replace(b, image=np.asarray(cv2.convertScaleAbs(b.image, alpha=gain), np.uint8))
        off_e, off_n = rng.uniform(-2.0, 2.0, 2)
        found = match(shown(a), shown(b), (d_east + off_e, d_north + off_n), 3.0)
        assert found is not None
        errors.append((found.moved_m[0] - d_east, found.moved_m[1] - d_north))
        assert math.hypot(*errors[-1]) < 4.0 * found.sigma_m
    assert np.abs(errors).max() < 0.25 * resolution_m(CAMERA, height_m)


def test_a_heading_that_is_three_degrees_off_and_blur_still_match():
    a = frame(0.0, 0.0, 12.0, (0.0, 0.0, 0.5))
    b = frame(3.0, 2.0, 12.0, (0.0, 0.0, 0.5), reported_yaw_rad=0.5 + math.radians(3.0), seed=2)
    b = replace(b, image=np.asarray(cv2.blur(b.image, (5, 5)), np.uint8))
    found = match(shown(a), shown(b), (2.5, 2.5), 2.0)
    assert found is not None
    # the ground turns about the place below the camera: 3 degrees of some 2 m
    assert math.dist(found.moved_m, (3.0, 2.0)) < 0.25


def test_photographs_cut_twice_match():
    if not PHOTOGRAPHS.is_dir():
        pytest.skip(f"no photographs in {PHOTOGRAPHS}")
    rng = np.random.default_rng(3)
    gsd_m = CAMERA.gsd_m(12.0)
    for name in ("DJI_0019.JPG", "DJI_0030.JPG"):
        whole = cv2.imread(str(PHOTOGRAPHS / name), cv2.IMREAD_REDUCED_GRAYSCALE_2)
        assert whole is not None
        for _ in range(4):
            x, y = rng.integers(0, 1000), rng.integers(0, 400)
            right, down = (int(n) for n in rng.integers(20, 200, 2))
            noise = rng.normal(0.0, 4.0, (480, 640))
            a = level(whole[y : y + 480, x : x + 640])
            b = level(0.8 * whole[y + down : y + down + 480, x + right : x + right + 640] + noise)
            true = right * gsd_m, -down * gsd_m
            found = match(shown(a), shown(b), (true[0] + 1.0, true[1] - 1.5), 3.0)
            assert found is not None
            assert math.dist(found.moved_m, true) < 0.05


# --- what cannot ----------------------------------------------------------------------------
def matched(a, b, expected_m=(0.0, 0.0)):
    return match(shown(level(a)), shown(level(b)), expected_m, 3.0)


def test_pattern_of_a_sensor_gives_no_match():
    """A lens that darkens its corners gives no match either."""
    v, u = np.mgrid[-1:1:480j, -1:1:640j]
    pattern = np.random.default_rng(1).normal(0.0, 4.0, (480, 640)) - 60.0 * (u * u + v * v)
    assert matched(120.0 + pattern, 120.0 + pattern) is None


COLUMNS, ROWS = np.arange(640)[None, :], np.arange(480)[:, None]
FURROWS = 120.0 + 40.0 * np.sin(COLUMNS / 8.0) + 0.0 * ROWS
GROUNDS = {
    "of one colour": np.full((480, 640), 120.0),
    "a straight edge": np.where(COLUMNS + 0.2 * ROWS < 350.0, 80.0, 190.0),
    "rows of a field": FURROWS,
    "squares": FURROWS + 40.0 * np.sin(ROWS / 8.0),
}


@pytest.mark.parametrize("kind", GROUNDS)
def test_ground_that_is_alike_everywhere_gives_no_match(kind):
    rng, ground = np.random.default_rng(2), GROUNDS[kind]
    assert matched(*(ground + rng.normal(0.0, 3.0, ground.shape) for _ in range(2))) is None


def test_water_gives_no_match():
    rng = np.random.default_rng(4)
    waves = [
        cv2.GaussianBlur(rng.normal(0.0, 1.0, (480, 640)), (0, 0), 6.0) * 400.0 for _ in range(2)
    ]
    assert matched(120.0 + waves[0], 120.0 + waves[1]) is None


def test_other_ground_gives_no_match():
    results = [
        match(
            shown(frame(k, -10.0, 12.0, seed=k)), shown(frame(k, 15.0, 12.0, seed=9)), (0.0, 0.0),
            3.0,
        )
        for k in range(6)
    ]  # fmt: skip
    assert results == [None] * 6


def test_too_little_overlap_gives_no_match():
    a, b = shown(frame(0.0, 0.0, 12.0)), shown(frame(0.0, 14.5, 12.0, seed=2))
    assert match(a, b, (0.0, 14.5), 2.0) is None
    assert match(a, b, (0.0, 40.0), 2.0) is None


def test_picture_without_ground_is_no_patch():
    grounded = replace(frame(0.0, 0.0, 12.0), pose=Pose(ORIGIN, 0.0, DOWN))
    assert patch(grounded) is None
    ahead = replace(grounded, pose=Pose(ORIGIN, 12.0, Quaternion.from_euler(0.0, -0.3, 0.0)))
    assert patch(ahead) is None


def test_patches_with_other_pixels_are_refused():
    a, b = frame(0.0, 0.0, 12.0), frame(0.0, 0.0, 24.0)
    with pytest.raises(ValueError, match=r"0\.2 and 0\.4"):
        match(shown(a), shown(b), (0.0, 0.0), 3.0)
    fine = patch(b, metres_per_pixel=0.2)
    assert fine is not None
    found = match(shown(a), fine, (0.5, 0.5), 2.0)
    assert isinstance(found, Match)
    assert math.hypot(*found.moved_m) < 0.1


@pytest.mark.parametrize("height", [-0.03, 0.0, 0.02])
@pytest.mark.parametrize("turned_rad", [0.0, -0.03])
def test_a_height_or_heading_that_wanders_is_seen(height, turned_rad):
    earlier = taken(0.0, 0.0, 0.0, 12.0)
    later = taken(1.5, 4.0, 2.8, 12.0 * (1.0 + height), -turned_rad)
    near = match(earlier, later, (1.5, 4.0), 1.0)
    assert near is not None
    found = compare(earlier, later, complex(*near.moved_m) / 0.2)
    assert found is not None
    zoom = complex(height, turned_rad)
    assert abs(found.zoom - zoom) < 0.004
    assert found.sigma < 0.006
    way_m = complex(1.5, 4.0) * (1.0 + zoom / 2.0)
    assert abs(found.moved_px * 0.2 - way_m) < 0.05


def test_much_larger_patch_is_found_once_it_is_scaled():
    earlier, later = taken(0.0, 0.0, 0.0, 12.0), taken(0.0, 4.0, 2.8, 13.8)
    alike = resized(later, 0.14 + 0j)
    near = match(earlier, alike, (0.0, 4.0), 1.0)
    assert near is not None
    found = compare(earlier, later, complex(*near.moved_m) / 0.2, 0.14 + 0j)
    assert found is not None
    assert found.zoom == pytest.approx(0.15, abs=0.004)


def test_other_ground_has_no_size():
    here = taken(0.0, 0.0, 0.0, 12.0)
    assert compare(here, taken(15.0, 9.0, 6.3, 12.0), 0j) is None
    assert compare(here, here, complex(0.0, 70.0)) is None
