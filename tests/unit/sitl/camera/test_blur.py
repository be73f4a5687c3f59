from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.body.physics import Body, Command
from sitl.camera.pinhole import Shot, image_motion_px
from sitl.camera.render import render
from sitl.world.world import Patch, World, WorldSpec
from tests.unit.sitl.conftest import CAMERA, LENS_M, ORIGIN, decoded

GIMBAL = replace(CAMERA, fixed=False)


def shot(yaw_deg=0.0, moved_m=(0.0, 0.0, 0.0), turned_deg=None, camera=CAMERA, pitch_deg=0.0):
    here = camera.attitude(0.0, math.radians(pitch_deg), math.radians(yaw_deg))
    there = None if turned_deg is None else camera.attitude(*map(math.radians, turned_deg))
    return Shot(0.0, 0.0, 10.0 - LENS_M, here, 0.0, 0, moved_m, there)


@pytest.mark.parametrize(
    ("yaw_deg", "moved_m", "expected"),
    [
        (0.0, (0.0, 0.5, 0.0), (0.0, 10.0)),  # northwards: the ground moves down in the picture
        (0.0, (0.5, 0.0, 0.0), (-10.0, 0.0)),
        (90.0, (0.0, 0.5, 0.0), (10.0, 0.0)),  # north is left
        (180.0, (0.25, 0.5, 0.0), (5.0, -10.0)),
        (0.0, (0.0, 0.0, 0.5), (0.0, 0.0)),  # a climb moves the ground off the middle alone
    ],
)
def test_the_ground_moves_against_the_camera(yaw_deg, moved_m, expected):
    assert image_motion_px(CAMERA, shot(yaw_deg, moved_m)) == pytest.approx(expected, abs=1e-9)


def test_turning_moves_the_picture_unless_a_gimbal_holds_it():
    turning = shot(turned_deg=(0.0, 2.0, 0.0))  # nose up: the camera looks ahead, the ground sinks
    moved = image_motion_px(CAMERA, turning)
    assert moved == pytest.approx((0.0, 200.0 * math.tan(math.radians(2.0))), abs=1e-6)
    held = shot(turned_deg=(0.0, 2.0, 0.0), camera=GIMBAL)
    assert image_motion_px(GIMBAL, held) == pytest.approx((0.0, 0.0), abs=1e-9)


def test_turning_can_make_up_for_flying():
    """The flight makes up for the turn of the axis: the camera sees the same place."""
    metres = 10.0 * math.tan(math.radians(2.0))
    both = shot(moved_m=(0.0, metres, 0.0), turned_deg=(0.0, -2.0, 0.0))
    assert image_motion_px(CAMERA, both) == pytest.approx((0.0, 0.0), abs=1e-6)


@pytest.fixture(scope="module")
def world():
    plane = World(WorldSpec(ORIGIN, 600.0, ())).plane
    corners = tuple(plane.to_wgs84(e, n) for e, n in ((0, 0), (40, 0), (40, 40), (0, 40)))
    spec = WorldSpec(
        ORIGIN, 600.0, (Patch(corners),), texture=0.0, sensor_noise=0.0, illumination=0.0, seed=1
    )
    return World(spec)


def gray(jpeg):
    return decoded(jpeg).astype(float)


def ramp_px(levels):
    """Return the number of levels between a tenth and nine tenths of their step."""
    share = (levels - levels.min()) / np.ptp(levels)
    return np.count_nonzero((share > 0.1) & (share < 0.9))


def across(picture):
    """Return the ramp across the border that runs north: in a row above the middle."""
    return ramp_px(picture[60, 160:240])


def along(picture):
    """Return the ramp across the border that runs east: in a column right of the middle."""
    return ramp_px(picture[110:190, 320])


@pytest.mark.parametrize("length_px", [6.0, 10.0, 16.0])
def test_a_border_is_as_wide_as_the_picture_moved(world, length_px):
    """An even motion makes a ramp of its length, of which eight tenths are between the marks."""
    east = gray(render(world, CAMERA, shot(moved_m=(length_px / 20.0, 0.0, 0.0))))
    assert across(east) == pytest.approx(0.8 * length_px, abs=1.0)
    assert along(east) <= 2
    north = gray(render(world, CAMERA, shot(moved_m=(0.0, length_px / 20.0, 0.0))))
    assert along(north) == pytest.approx(0.8 * length_px, abs=1.0)
    assert across(north) <= 2
    slanting = shot(moved_m=(0.6 * length_px / 20.0, 0.8 * length_px / 20.0, 0.0))
    both = gray(render(world, CAMERA, slanting))
    assert across(both) == pytest.approx(0.8 * 0.6 * length_px, abs=1.5)
    assert along(both) == pytest.approx(0.8 * 0.8 * length_px, abs=1.5)


def test_the_border_stays_where_it_is_at_the_middle_of_the_exposure(world):
    still = gray(render(world, CAMERA, shot()))
    moved = gray(render(world, CAMERA, shot(moved_m=(0.6, 0.0, 0.0))))
    halfway = (still.min() + still.max()) / 2.0
    middle = [np.count_nonzero(p[60, 160:240] > halfway) for p in (still, moved)]
    assert abs(middle[1] - middle[0]) <= 1
    assert moved.mean() == pytest.approx(still.mean(), abs=0.5)


def test_motion_of_less_than_half_a_pixel_blurs_nothing(world):
    still = render(world, CAMERA, shot())
    assert render(world, CAMERA, shot(moved_m=(0.024, 0.0, 0.0))) == still
    assert render(world, CAMERA, shot(moved_m=(0.026, 0.0, 0.0))) != still


def test_body_predicts_how_it_will_be_turned():
    body = Body(0.0, 0.0, 1.0, math.radians(30.0))
    body.motors_on = True
    for _ in range(60):
        body.step(Command(3.0, 1.0, 1.0, 0.4), (0.0, 0.0), 0.005)
    body.step(Command(-3.0, 2.0, 0.0, 0.4), (0.0, 0.0), 0.001)
    reported = body.turned(0.001)
    before = (*body.roll_pitch, body.yaw)
    body.step(Command(-3.0, 2.0, 0.0, 0.4), (0.0, 0.0), 0.001)
    after = (*body.roll_pitch, body.yaw)
    assert reported == pytest.approx(after, abs=3e-5)
    assert abs(after[1] - before[1]) > 1e-3


def test_an_exposure_that_no_shutter_has_is_refused():
    with pytest.raises(ValueError, match="exposure_s"):
        replace(CAMERA, exposure_s=1.5)


def test_a_vehicle_in_flight_blurs_by_its_speed(make_client, square):
    """It flies over the border of a dark square at some 8 m/s, with an exposure of 1/10 s."""
    calm = {"texture": 0.0, "sensor_noise": 0.0, "illumination": 0.0, "patches": (square,)}
    slow = replace(GIMBAL, exposure_s=0.1)
    client = make_client(world=calm, camera=slow)
    client.take_off(12.0)
    client.reposition(10.0, -40.0, 12.0)
    client.run(20.0)
    client.reposition(10.0, 60.0, 12.0)
    while client.where[1] < 0.0:
        client.run(0.05)
    assert client.result(mav.MAV_CMD_IMAGE_START_CAPTURE, 0, 1.0, 1, 1, component=100) == 0
    client.run(0.05)
    speed_m_s = math.hypot(*client.vehicle.truth.velocity_m_s[:2])
    assert speed_m_s > 6.0
    announced = client.seen("CAMERA_IMAGE_CAPTURED")[-1]
    picture = gray(client.vehicle.image(announced.file_url))
    # the nose points along the way: the border runs across the picture
    level = picture[:, 180:220].mean(axis=1)
    assert ramp_px(level) == pytest.approx(0.8 * 0.1 * speed_m_s * 200.0 / 12.1, rel=0.1)
