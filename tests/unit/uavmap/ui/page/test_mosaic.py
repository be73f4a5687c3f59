"""The ground that grows beneath the cells of a live page."""

from dataclasses import replace

import cv2
import numpy as np

from missions.geo.grid import Grid
from missions.units import GridPoint, LatLon, Quaternion
from tests.unit.vision.scene import nadir_pose
from uavmap.ui.page.mosaic import PAPER, Mosaic
from vision.camera import Camera

PLACE = {"west": -50.0, "north": 40.0, "width_m": 100.0, "height_m": 80.0}
GRID = Grid.at(LatLon(48.0, 11.0), 4.0)
CAMERA = Camera(1.4, 320, 240)


def seen(east_m, north_m, height_m=20.0):
    pose, _ = nadir_pose(GRID, GridPoint(east_m, north_m), height_m, 0.3)
    return CAMERA.homography(pose, GRID, 0.0)


def at(mosaic, east_m, north_m):
    image = cv2.imdecode(np.frombuffer(mosaic.jpeg(), np.uint8), cv2.IMREAD_COLOR)
    column = (east_m - PLACE["west"]) / PLACE["width_m"] * image.shape[1]
    row = (PLACE["north"] - north_m) / PLACE["height_m"] * image.shape[0]
    return [int(level) for level in image[int(row), int(column)]]


def plain(level):
    return np.full((240, 320, 3), level, np.uint8)


def test_picture_lies_where_its_pose_says_and_the_rest_is_paper():
    mosaic = Mosaic(PLACE)
    mosaic.add(plain(60), seen(10.0, 5.0))
    assert max(abs(level - 60) for level in at(mosaic, 10.0, 5.0)) < 8
    assert max(abs(a - b) for a, b in zip(at(mosaic, -40.0, -30.0), PAPER, strict=True)) < 8


def test_finer_and_steeper_view_of_a_place_shows_in_any_order():
    for order in (1, -1):
        mosaic = Mosaic(PLACE)
        views = [(plain(60), seen(10.0, 5.0)), (plain(200), seen(0.0, 5.0, 60.0))]
        for picture, matrix in views[::order]:
            mosaic.add(picture, matrix)
        assert max(abs(level - 60) for level in at(mosaic, 10.0, 5.0)) < 8
        assert max(abs(level - 200) for level in at(mosaic, -20.0, 5.0)) < 8


def test_picture_that_shows_the_sky_or_other_ground_changes_nothing():
    mosaic = Mosaic(PLACE)
    before = mosaic.jpeg()
    mosaic.add(plain(60), seen(500.0, 0.0))
    pose, _ = nadir_pose(GRID, GridPoint(0.0, 0.0), 20.0, 0.0)
    level = replace(pose, attitude=Quaternion.from_euler(0.0, 0.0, 0.0))
    mosaic.add(plain(60), CAMERA.homography(level, GRID, 0.0))
    assert mosaic.jpeg() == before


def test_base_lies_beneath():
    base = cv2.imencode(".jpg", np.full((80, 100, 3), 120, np.uint8))[1].tobytes()
    assert max(abs(level - 120) for level in at(Mosaic(PLACE, base), 0.0, 0.0)) < 8
