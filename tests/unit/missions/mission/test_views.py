"""Rows that lanes show in the wind, compared with the camera that judges the pictures."""

from __future__ import annotations

import math

import numpy as np
import pytest

from missions.flight.setting_of import setting_of
from missions.flight.state import Setting
from missions.mission.schema import Mission
from missions.mission.views import (
    DRAG_1_S,
    G_M_S2,
    beside_rows_m,
    reaches_m,
    rim_share,
    rows_across,
    wind_toward,
)
from missions.units import GridPoint, Pose, Quaternion
from tests.support.small_missions import mission, square
from vision.camera import Camera
from vision.detectors import make_detector
from vision.projection import Frame, judge_frame

PLAIN = make_detector("threshold", dilations=0)


def windy(
    wind_m_s: float, from_deg: float, *, east_ahead: bool, mounting: str = "fixed"
) -> Setting:
    long_m = (90.0, 40.0) if east_ahead else (40.0, 90.0)
    made = mission(
        square(-10, 16, *long_m), square(-60, -60, 200, 220), strategy="swath", mounting=mounting
    )
    optics = {"hfov_deg": 80.0, "width_px": 640, "height_px": 480}
    camera = made.camera.model_copy(update=optics)
    wind = made.wind.model_copy(update={"speed_m_s": wind_m_s, "from_deg": from_deg})
    setting = setting_of(made.model_copy(update={"camera": camera, "wind": wind}))
    assert setting.east_ahead == east_ahead
    return setting


def times(one: Quaternion, other: Quaternion) -> Quaternion:
    """Return the product of two rotations: first the other, then the one."""
    (a, b, c, d), (e, f, g, h) = one, other
    return Quaternion(
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    )


def leaning(setting: Setting, over: GridPoint, wind_m_s: tuple[float, float]) -> Pose:
    """Return the pose of a fixed camera on a lane: the vehicle leans against the wind."""
    grid, yaw_rad = setting.grid, math.radians(setting.yaw_deg)
    turn = grid.convergence_rad
    east = wind_m_s[0] * math.cos(turn) + wind_m_s[1] * math.sin(turn)
    north = wind_m_s[1] * math.cos(turn) - wind_m_s[0] * math.sin(turn)
    if setting.east_ahead:  # to lean along its lane costs no row
        east = 0.0
    else:
        north = 0.0
    lean_rad = math.atan(DRAG_1_S * math.hypot(east, north) / G_M_S2)
    level = Quaternion.from_euler(0.0, -math.pi / 2.0, yaw_rad)
    # the optical axis swings downwind: about the horizontal axis across the wind
    half, speed = lean_rad / 2.0, max(math.hypot(east, north), 1e-9)
    swing = Quaternion(
        math.cos(half), -math.sin(half) * east / speed, math.sin(half) * north / speed, 0.0
    )
    return Pose(grid.position(over), setting.mission.altitude_m(0), times(swing, level))


def rows_shown(setting: Setting, pose: Pose) -> set[int]:
    """Return the rows, counted across the lanes, of which a frame judges the cells below it."""
    made: Mission = setting.mission
    optics = made.camera.optics
    camera = Camera(optics.hfov_rad, optics.width_px, optics.height_px)
    image = np.full((camera.height_px, camera.width_px, 3), 200, np.uint8)
    frame = Frame(image, pose, 0.0, camera)
    found = judge_frame(
        frame, setting.grid, PLAIN, share=0.5, view="all", margin_m=made.camera.pose_error_m
    )
    at = setting.grid.cell_at(pose.position, 0.0)
    if setting.east_ahead:
        return {v.cell.north for v in found if v.cell.east == at.east}
    return {v.cell.east for v in found if v.cell.north == at.north}


@pytest.mark.parametrize("east_ahead", [False, True])
@pytest.mark.parametrize("from_deg", [0.0, 70.0, 90.0, 180.0, 250.0, 270.0])
@pytest.mark.parametrize("wind_m_s", [0.0, 3.6, 5.0])
def test_the_rows_of_a_lane_are_in_the_picture_whatever_the_wind(wind_m_s, from_deg, *, east_ahead):
    setting = windy(wind_m_s, from_deg, east_ahead=east_ahead)
    grid, made, rows = setting.grid, setting.mission, setting.lane_rows
    assert rows >= 3
    beside_m = beside_rows_m(made, grid, made.altitude_m(0), east_ahead=east_ahead)
    middle_m = (10 + (rows - 1) / 2) * grid.cell_m + beside_m
    over = GridPoint(40.0, middle_m) if east_ahead else GridPoint(middle_m, 40.0)
    for wind in ((0.0, 0.0), wind_toward(made, grid)):
        assert rows_shown(setting, leaning(setting, over, wind)) >= set(range(10, 10 + rows))


def test_the_side_to_which_the_camera_does_not_look_comes_nearer():
    west = windy(5.0, 270.0, east_ahead=False)  # it blows to the east, the vehicle leans west
    low_m, high_m = reaches_m(west.mission, west.grid, 12.0, east_ahead=False)
    assert low_m < high_m
    assert beside_rows_m(west.mission, west.grid, 12.0, east_ahead=False) < 0.0
    level = windy(5.0, 270.0, east_ahead=False, mounting="gimbal")
    assert beside_rows_m(level.mission, level.grid, 12.0, east_ahead=False) == 0.0
    assert rows_across(level.mission, level.grid, east_ahead=False) >= west.lane_rows


@pytest.mark.parametrize(
    ("pose_error_m", "cell_m", "expected"),
    [(0.0, 4.0, 0.3), (0.5, 4.0, 0.175), (0.5, 10.0, 0.25), (5.0, 4.0, 0.15)],
)
def test_rim_share_allows_for_the_error_of_the_pose_and_keeps_half(pose_error_m, cell_m, expected):
    made = mission(square(0, 0, 40, 30), square(-30, -30, 120, 100))
    camera = made.camera.model_copy(update={"pose_error_m": pose_error_m})
    grid = made.grid.model_copy(update={"cell_m": cell_m})
    assert made.detector.share == 0.3
    changed = made.model_copy(update={"camera": camera, "grid": grid})
    assert rim_share(changed) == pytest.approx(expected)
