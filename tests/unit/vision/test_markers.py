"""Places of markers, on rendered pictures and in flight, and their stated errors."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.geo.geodesy import LocalPlane
from missions.units import LatLon, Quaternion
from sitl.camera.pinhole import CameraSpec, Shot
from sitl.camera.render import render
from sitl.scenario import Setup
from sitl.testing import Fleet
from sitl.world.tags import TagPose
from sitl.world.world import World, WorldSpec
from tests.unit.vision.scene import decoded
from vision.camera import Camera
from vision.markers import Carrier, SightingErrors, find_tags, sight

TAG_M, BELOW_M = 0.4, 6.0
SPEC = CameraSpec(hfov_deg=78.0, width_px=320, height_px=240)
CAMERA = Camera(math.radians(78.0), 320, 240)
WORLD = World(WorldSpec(LatLon(37.2, -80.4), 600.0, (), tag_m=TAG_M, seed=3))
ERRORS = SightingErrors(corner_px=0.02)
STATED_TILT = math.radians(1.0)


def seen(place, attitude, body, number=2, world=WORLD, seed=0):
    """Return the picture of a marker at (east, north, up) of the camera."""
    east, north, up = place
    tag = TagPose(number, east, north, 30.1 + up, body)
    return decoded(render(world, SPEC, Shot(0.0, 0.0, 30.0, attitude, 0.0, seed, tags=(tag,))))


LEVEL, FLAT = SPEC.attitude(0.0, 0.0, 0.0), Quaternion.from_euler(0.0, 0.0, 0.0)


def test_corners_are_exact_to_hundredths_of_a_pixel():
    found = find_tags(seen((1.0, 0.5, -BELOW_M), LEVEL, FLAT))
    assert [tag.tag_id for tag in found] == [2]
    focal = CAMERA.focal_px
    half = TAG_M / 2.0
    metres = np.array([[1 - half, 0.5 + half], [1 + half, 0.5 + half],
                       [1 + half, 0.5 - half], [1 - half, 0.5 - half]])  # fmt: skip
    exact = np.array([159.5, 119.5]) + focal / BELOW_M * metres * [1.0, -1.0]
    assert np.abs(found[0].corners_px - exact).max() < 0.1
    sigmas = np.sqrt(np.diag(found[0].covariance_px2))
    assert (sigmas > 0.005).all()
    assert (sigmas < 0.1).all()


def test_picture_without_a_marker_gives_none():
    bare = render(WORLD, SPEC, Shot(0.0, 0.0, 30.0, LEVEL, 0.0, 0))
    assert find_tags(decoded(bare)) == ()
    other = seen((0.0, 0.0, -BELOW_M), LEVEL, FLAT)
    assert find_tags(other, "DICT_6X6_50") == ()
    assert find_tags(np.full((60, 80), 128, np.uint8)) == ()


def test_number_that_is_there_twice_is_of_no_vehicle():
    one, other = (TagPose(2, east, 0.0, 24.1, FLAT) for east in (-1.0, 1.0))
    shot = Shot(0.0, 0.0, 30.0, LEVEL, 0.0, 0, tags=(one, other))
    assert find_tags(decoded(render(WORLD, SPEC, shot))) == ()
    shot = replace(shot, tags=(one, replace(other, number=5)))
    assert [tag.tag_id for tag in find_tags(decoded(render(WORLD, SPEC, shot)))] == [2, 5]


def drawn(rng):
    """Return a geometry, its reported values, and its picture."""
    reach = 0.4 * BELOW_M
    place = np.array([*rng.uniform(-reach, reach, 2), -BELOW_M * rng.uniform(0.8, 1.2)])
    tilt, lean = rng.normal(0.0, math.radians(3.0), (2, 2))
    yaws = rng.uniform(0.0, math.tau, 2)
    body = Quaternion.from_euler(*lean, yaws[1])
    taken = seen(place, SPEC.attitude(*tilt, yaws[0]), body, seed=int(rng.integers(1000)))
    off = rng.normal(0.0, [ERRORS.tilt_rad, ERRORS.tilt_rad, ERRORS.heading_rad])
    reported = SPEC.attitude(*(tilt + off[:2]), yaws[0] + off[2])
    return taken, place, reported, Carrier(*(lean + rng.normal(0.0, STATED_TILT, 2)), STATED_TILT)


def place_of(sighting):
    return np.array([sighting.east_m, sighting.north_m, sighting.up_m])


def test_errors_are_as_large_as_stated():
    """NEES over random geometries is 3 where the covariance is honest (chi square, 3 degrees)."""
    rng = np.random.default_rng(2)
    squares = []
    for _ in range(40):
        taken, place, reported, carrier = drawn(rng)
        (found,) = find_tags(taken)
        sighting = sight(found, CAMERA, reported, TAG_M, carrier, ERRORS)
        assert sighting is not None
        off = place_of(sighting) - place
        squares.append(off @ np.linalg.solve(sighting.covariance_m2, off))
    # of the mean of 40 draws 99.9 % lie in here
    assert 1.9 < np.mean(squares) < 4.5


def test_marker_that_contradicts_its_attitude_is_no_sighting():
    (found,) = find_tags(seen((0.0, 0.0, -BELOW_M), LEVEL, FLAT))
    level = Carrier(tilt_rad=STATED_TILT)
    assert sight(found, CAMERA, LEVEL, TAG_M, level, ERRORS) is not None
    # a camera with a reported lean
    leaning = SPEC.attitude(math.radians(20.0), 0.0, 0.0)
    assert sight(found, CAMERA, leaning, TAG_M, level, ERRORS) is None
    # a camera that looks at the sky
    up = Quaternion.from_euler(0.0, math.pi / 2.0, 0.0)
    assert sight(found, CAMERA, up, TAG_M) is None


def _give(vehicle, place, height_m):
    vehicle.send(
        mav.MAVLink_set_position_target_global_int_message(
            0, vehicle.system_id, 1, 6, 3576, round(place.lat_deg * 1e7),
            round(place.lon_deg * 1e7), height_m, *([0.0] * 8),
        )
    )  # fmt: skip


def test_one_vehicle_sees_another_that_flies_below():
    """Over MAVLink only the announcements of the camera and its JPEG are known."""
    camera = replace(SPEC, exposure_s=0.002)
    fleet = Fleet(Setup(vehicles=2, gps_sigma_m=0.0, tag_m=TAG_M, camera=camera, seed=2))
    high, low = fleet
    fleet.run(6.0)
    for vehicle, height_m in ((low, 4.0), (high, 10.0)):
        vehicle.until(lambda vehicle=vehicle: vehicle.command(mav.MAV_CMD_DO_SET_MODE, 1, 4) == 0)
        assert vehicle.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1) == 0
        assert vehicle.command(mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height_m) == 0
        vehicle.until(lambda v=vehicle, h=height_m: v.truth.height_m > h - 0.2)
    plane = LocalPlane(high.truth.position)
    _give(low, plane.to_wgs84(-2.0, 8.0), 4.0)  # it passes below, at some metres a second
    low.until(lambda: plane.to_plane(low.truth.position)[1] > 0.5)
    assert math.hypot(*low.truth.velocity_m_s) > 1.0
    high.send(
        mav.MAVLink_command_long_message(
            1, 100, mav.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, 0, 1, 1, 0, 0, 0
        )
    )
    reported = high.expect("CAMERA_IMAGE_CAPTURED", timeout_s=2.0)
    east, north = LocalPlane(high.truth.position).to_plane(low.truth.position)
    up = low.truth.height_m + 0.3 - (high.truth.height_m + 0.1)  # marker over feet, lens over feet
    (found,) = find_tags(decoded(high.image(reported.file_url)))
    sighting = sight(
        found, CAMERA, Quaternion(*reported.q), TAG_M,
        Carrier(low.truth.roll_rad, low.truth.pitch_rad, math.radians(0.2)),
        SightingErrors(0.02, math.radians(0.05), math.radians(0.05)),
    )  # fmt: skip
    assert found.tag_id == 2
    assert place_of(sighting) == pytest.approx([east, north, up], abs=0.05)
    fleet.close()
