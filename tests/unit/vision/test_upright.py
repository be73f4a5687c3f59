"""Pictures stored upside down are found by their content."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from missions.geo.grid import Grid
from missions.units import GridPoint, LatLon
from tests.unit.vision.scene import nadir_pose, photograph, upside_down
from vision.camera import Camera
from vision.projection import Frame

GRID = Grid.at(LatLon(46.84, -91.99), 4.0)
CAMERA = Camera(math.radians(80.0), 160, 90)
PITCH_M = 0.25


def ground(seed: int) -> np.ndarray:
    """Return a ground of blotches of a few metres over 240 m."""
    rng = np.random.default_rng(seed)
    smooth = cv2.GaussianBlur(rng.normal(0.0, 1.0, (960, 960)), (0, 0), 12.0)
    return np.clip(128 + 60 * smooth / smooth.std(), 0, 255).astype(np.uint8)


def survey(texture: np.ndarray, turned: set[int], position_error_m: float = 0.0) -> list[Frame]:
    """Return the frames of three legs of four pictures, there and back, 14 m apart, at 40 m."""
    rng = np.random.default_rng(5)
    frames = []
    for leg in range(3):
        for step in range(4):
            north = 14.0 * (step if leg % 2 == 0 else 3 - step)
            yaw_deg = 10.0 if leg % 2 == 0 else -170.0
            true_place = GridPoint(25.0 * leg - 25.0, north - 20.0)
            pose, axes = nadir_pose(GRID, true_place, 40.0, yaw_deg, (1.0, -1.5))
            image = photograph(texture, PITCH_M, GRID, CAMERA, pose, axes)
            if len(frames) in turned:
                image = np.ascontiguousarray(image[::-1, ::-1])
            off = rng.normal(0.0, position_error_m, 2)
            reported = GridPoint(true_place.east_m + off[0], true_place.north_m + off[1])
            reported_pose, _ = nadir_pose(GRID, reported, 40.0, yaw_deg, (1.0, -1.5))
            frames.append(Frame(image, reported_pose, float(len(frames)), CAMERA))
    return frames


@pytest.mark.parametrize(
    "turned", [set(), {4, 5, 6, 7}, {2}, {0, 1, 5, 8, 9, 10, 11}, set(range(12))]
)
def test_the_turned_pictures_are_found_though_positions_are_off(turned: set[int]) -> None:
    found = upside_down(survey(ground(3), turned, position_error_m=1.0), GRID)
    assert {k for k, way in enumerate(found) if way} == turned


def test_a_featureless_ground_turns_nothing() -> None:
    assert upside_down(survey(np.full((960, 960), 90, np.uint8), {1}), GRID) == (False,) * 12


def test_pictures_without_overlap_are_taken_as_they_are() -> None:
    frames = survey(ground(3), {0})
    assert upside_down(frames[:1], GRID) == (False,)


def test_an_oblique_picture_is_left_out() -> None:
    frames = survey(ground(3), {4, 5, 6, 7})
    pose, _ = nadir_pose(GRID, GridPoint(0.0, 0.0), 40.0, 0.0, (0.0, 75.0))
    oblique = Frame(frames[0].image, pose, 12.0, CAMERA)
    found = upside_down([*frames, oblique], GRID)
    assert {k for k, way in enumerate(found) if way} == {4, 5, 6, 7}
