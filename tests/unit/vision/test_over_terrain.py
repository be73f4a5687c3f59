"""Pictures of ground that is not flat: cells are where their own heights put them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from missions.geo.grid import Grid
from missions.geo.terrain import Terrain
from missions.units import LatLon, Pose, Quaternion
from tests.support.hills import SIDE_M, STEP_M, slope
from vision.camera import Camera, project
from vision.detectors import make_detector
from vision.projection import Frame, Projection, look

PLACE = LatLon(48.0, 11.3)
GRID = Grid.at(PLACE, 4.0)
CAMERA = Camera(math.radians(80.0), 320, 240)


def terrain(percent, toward_deg=0.0):
    return Terrain(-SIDE_M, -SIDE_M, STEP_M, slope(percent, toward_deg))


def pose(roll_deg=0.0, pitch_deg=0.0, yaw_deg=20.0, height_m=14.0):
    body = [math.radians(angle) for angle in (roll_deg, pitch_deg - 90.0, yaw_deg)]
    return Pose(PLACE, height_m, Quaternion.from_euler(*body))


def test_over_level_ground_it_is_the_homography():
    at = pose(4.0, 6.0)
    flat = Projection(CAMERA, at, 0.0, GRID, terrain(0.0))
    points = np.array([[0.0, 0.0], [3.0, -5.0], [-8.0, 2.0]])
    matrix = CAMERA.homography(at, GRID, 0.0)
    for told, wanted in zip(flat.project(points), project(matrix, points), strict=True):
        assert told == pytest.approx(wanted)
    picture = np.full((240, 320, 3), 60, np.uint8)
    picture[:, 170:] = 200
    frame = Frame(picture, at, 0.0, CAMERA)
    detector = make_detector("threshold", intensity=150, dilations=0, polarity="dark")
    for view in ("cross", "all"):
        known = look(frame, GRID, detector, share=0.3, view=view, margin_m=0.3)
        found = look(
            frame, GRID, detector, share=0.3, view=view, margin_m=0.3, terrain=terrain(0.0)
        )
        shares = {v.cell: v.share for v in found}
        if view == "cross":
            assert [v.cell for v in known] == list(shares)
        common = [v for v in known if v.cell in shares]
        assert len(common) >= 0.9 * len(known)
        assert [shares[v.cell] for v in common] == pytest.approx(
            [v.share for v in common], abs=0.04
        )


def test_a_point_uphill_is_farther_out_in_the_picture():
    at = pose(yaw_deg=0.0)  # the upper edge is north
    uphill = Projection(CAMERA, at, 0.0, GRID, terrain(20.0, 0.0))
    pixels, depth = uphill.project(np.array([[0.0, 5.0], [0.0, -5.0]]))
    focal = CAMERA.focal_px
    assert depth == pytest.approx([13.0, 15.0])
    assert pixels[:, 1] == pytest.approx(
        [119.5 - focal * 5.0 / 13.0, 119.5 + focal * 5.0 / 15.0], abs=0.6
    )


def test_fewer_cells_are_shown_whole_uphill_than_downhill():
    seen = Projection(CAMERA, pose(yaw_deg=0.0), 0.0, GRID, terrain(30.0, 0.0))
    rows = seen.cells("all", 0.2)[:, 1]
    assert rows.max() < -rows.min()
