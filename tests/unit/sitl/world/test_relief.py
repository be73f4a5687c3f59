from __future__ import annotations

import math

import numpy as np
import pytest

from sitl.camera.pinhole import CameraSpec, Shot, ground_to_pixel, pixels_of, seen_ground
from sitl.camera.render import render
from sitl.scenario import Setup
from sitl.world.ground import HeightField, Relief
from sitl.world.world import Patch, World, WorldSpec
from tests.unit.sitl.conftest import ORIGIN, decoded

CAMERA = CameraSpec(hfov_deg=80.0, width_px=320, height_px=240)


def shot_at(relief, east, north, height, pitch_deg=0.0):
    return Shot(
        east, north, height, CAMERA.attitude(0.0, math.radians(pitch_deg), 0.4), 0.0, 1,
        ground_m=relief.height_m(east, north),
    )  # fmt: skip


@pytest.mark.parametrize("pitch_deg", [0.0, -12.0])
def test_the_ray_of_a_pixel_meets_the_ground_that_falls_into_that_pixel(pitch_deg):
    relief = Relief(0.2, 30.0, 30.0, 60.0, seed=2)
    shot = shot_at(relief, 12.0, -7.0, 14.0, pitch_deg)
    homography = ground_to_pixel(CAMERA, shot)
    east, north = seen_ground(CAMERA, shot, np.linalg.inv(homography), relief)
    rows, columns = np.meshgrid(np.arange(240), np.arange(320), indexing="ij")
    back = pixels_of(homography, shot, relief, east.ravel(), north.ravel())
    off = np.hypot(back[:, 0] - columns.ravel(), back[:, 1] - rows.ravel())
    assert float(off.max()) < 0.5


def test_the_region_is_where_its_height_puts_it():
    relief = Relief(0.25, 0.0)
    plane = World(WorldSpec(ORIGIN, 400.0, ())).plane
    ring = [plane.to_wgs84(e, n) for e, n in ((-3.0, 3.0), (3.0, 3.0), (3.0, 60.0), (-3.0, 60.0))]
    world = World(
        WorldSpec(
            ORIGIN, 400.0, (Patch(tuple(ring)),), texture=0.0, sensor_noise=0.0, illumination=0.0,
            relief=relief,
        )
    )  # fmt: skip
    shot = Shot(0.0, 0.0, 14.0, CAMERA.attitude(0.0, 0.0, 0.0), 0.0, 1)
    picture = decoded(render(world, CAMERA, shot))
    column = picture[:, 160].astype(float)
    edge = int(np.flatnonzero(column < 98).max())
    wanted = 119.5 - CAMERA.focal_px * 3.0 / (14.1 - 0.75)  # 3 m north the ground is 0.75 m higher
    assert edge == pytest.approx(wanted, abs=1.5)


def test_measured_heights_are_bilinear_and_go_on_beyond():
    field = HeightField(0.0, 0.0, 10.0, np.array([[0.0, 2.0], [4.0, 6.0]]))
    relief = Relief(field=field)
    assert relief.height_m(5.0, 5.0) == pytest.approx(3.0)
    assert relief.height_m(50.0, -50.0) == pytest.approx(2.0)


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_vehicle_stands_on_the_ground_where_it_is_and_reports_heights_above_its_home(autopilot):
    relief = Relief(0.1, 90.0)
    plane = World(WorldSpec(ORIGIN, 400.0, ())).plane
    setup = Setup(
        autopilot=autopilot, home=(ORIGIN.lat_deg, ORIGIN.lon_deg, 400.0), gps_sigma_m=0.0,
        places=(plane.to_wgs84(50.0, 0.0),), relief=relief,
    )  # fmt: skip
    (vehicle,) = setup.build()
    vehicle.step(8.0)
    assert vehicle.truth.landed
    assert vehicle.truth.height_m == pytest.approx(0.0)
    assert vehicle.up_m == pytest.approx(5.0, abs=1e-3)
