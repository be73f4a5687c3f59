"""A mosaic of pictures: one with a wrong pose continues the others."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from missions.geo.grid import Grid
from missions.units import GridPoint, LatLon
from tests.unit.vision.scene import nadir_pose, photograph
from vision.camera import Camera
from vision.growing_mosaic import PASS, SEAM_M, GrowingMosaic
from vision.mosaic import Mosaic, Part, project_picture
from vision.raster import Overlay, Raster, framed

GRID = Grid.at(LatLon(48.0, 11.0), 4.0)
CAMERA = Camera(1.4, 320, 240)
RASTER = Raster(-20.0, 20.0, 0.1, 400, 400)
HEIGHT_M = 12.0


def ground(seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0.0, 60.0, (800, 800)).astype(np.float32)
    return np.clip(120.0 + 4.0 * cv2.GaussianBlur(noise, (0, 0), 4.0), 0, 255).astype(np.uint8)


def taken(east_m: float, texture: np.ndarray, north_m: float = 0.0) -> np.ndarray:
    pose, axes = nadir_pose(GRID, GridPoint(east_m, north_m), HEIGHT_M, 0.0)
    image = photograph(texture, 0.05, GRID, CAMERA, pose, axes)
    return framed(cv2.merge([image] * 3) if image.ndim == 2 else image)


def overlay(east_m: float, north_m: float = 0.0) -> Overlay:
    pose, _ = nadir_pose(GRID, GridPoint(east_m, north_m), HEIGHT_M, 0.0)
    return Overlay.at_pose(CAMERA, pose, 0.0, GRID, None)


def moved_m(error_m: float, second: np.ndarray) -> float:
    """Return the shift of a picture taken 2 m east, whose pose has an error."""
    mosaic = GrowingMosaic(RASTER.whole)
    for part in project_picture(overlay(0.0), RASTER, RASTER.whole, lambda: taken(0.0, ground(1))):
        mosaic.add(part)
    reported = overlay(2.0 + error_m)
    found = mosaic.aligned(reported, RASTER, RASTER.whole, lambda: taken(2.0, second))
    place = np.array([[[2.0, 0.0]]])
    gsd_m = CAMERA.gsd_m(HEIGHT_M)
    return float((found.pixels(place) - reported.pixels(place))[0, 0, 0]) * gsd_m


@pytest.mark.parametrize("error_m", [-1.0, 0.6, 0.9])
def test_picture_with_a_wrong_pose_is_moved_to_the_mosaic_but_for_a_small_seam(error_m):
    left_m = np.copysign(SEAM_M, error_m)
    assert moved_m(error_m, ground(1)) == pytest.approx(error_m - left_m, abs=0.1)


def test_picture_within_the_seam_stays():
    assert moved_m(0.05, ground(1)) == 0.0


def test_picture_that_is_too_far_off_or_shows_other_ground_stays():
    assert abs(moved_m(2.0, ground(1))) < 0.1
    assert moved_m(1.0, ground(2)) == 0.0
    assert moved_m(1.0, np.full((800, 800), 100, np.uint8)) == 0.0


def test_lane_with_another_error_moves_to_the_lane_beside_it():
    """Lanes overlap by 5 m; poses of the second lane err by 0.9 m."""
    mosaic, texture, raster = GrowingMosaic(RASTER.whole), ground(1), RASTER
    gsd_m, moved = CAMERA.gsd_m(HEIGHT_M), list[float]()
    for east_m, error_m in ((-7.5, 0.0), (7.5, 0.9)):
        for k in range(2 * PASS):
            north_m = 1.5 * (k - PASS)
            reported = overlay(east_m + error_m, north_m)
            picture = taken(east_m, texture, north_m)
            window = raster.around(*reported.bounds())
            found = mosaic.aligned(reported, raster, window, lambda: picture)  # noqa: B023
            for part in project_picture(found, raster, window, lambda: picture):  # noqa: B023
                mosaic.add(part)
            place = np.array([[[east_m, north_m]]])
            moved.append(float((found.pixels(place) - reported.pixels(place))[0, 0, 0]) * gsd_m)
    assert max(abs(by_m) for by_m in moved[: 2 * PASS]) == 0.0
    assert 0.5 < moved[-1] < 0.9


def test_mosaic_without_a_picture_is_none_and_a_part_has_its_weight():
    mosaic = Mosaic(RASTER.whole)
    assert mosaic.image() is None
    for level, weight in ((100, 3.0), (200, 1.0)):
        colours = np.full((*RASTER.whole.shape, 3), level, np.uint8)
        mosaic.add(Part(RASTER.whole, colours, np.full(RASTER.whole.shape, weight, np.float32)))
    image = mosaic.image()
    assert image is not None
    assert image[7, 9].tolist() == [125, 125, 125, 255]
