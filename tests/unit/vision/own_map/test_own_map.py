from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import pytest

from missions.navigation import ReportedErrors
from missions.units import LatLon, Pose
from sitl.camera.pinhole import CameraSpec, Shot
from sitl.camera.render import render
from sitl.world.world import World, WorldSpec
from tests.unit.vision.scene import decoded
from vision.camera import Camera
from vision.own_map.ground_patch import patch
from vision.own_map.map_position import OwnMap
from vision.projection import Frame

ORIGIN = LatLon(48.0, 11.0)
SPEC = CameraSpec(hfov_deg=80.0, width_px=320, height_px=240)
CAMERA = Camera(math.radians(80.0), 320, 240)
WORLD = World(WorldSpec(ORIGIN, 0.0, (), seed=3))
ERRORS = ReportedErrors(satellites_m=0.3, pointing_m=0.03)


@lru_cache(maxsize=512)
def taken(east_m, north_m, seed, height_m=12.1, heading_rad=0.0):
    """Return a picture from 12 m, level and towards north, with any reported height and heading."""
    shot = Shot(east_m, north_m, 12.0, SPEC.attitude(0.0, 0.0, 0.0), 0.0, round(10 * seed))
    reported = Pose(ORIGIN, height_m, SPEC.attitude(0.0, 0.0, heading_rad))
    found = patch(
        Frame(decoded(render(WORLD, SPEC, shot)), reported, 0.0, CAMERA), metres_per_pixel=0.2
    )
    assert found is not None
    return found


def there_and_back(k):
    """Fly thirty steps of 2 m to the north, and back over the same ground."""
    return 0.4 * (k >= 30), 2.0 * min(k, 60 - k)


def test_map_stays_small():
    """A long flight over the same ground keeps a bounded map and its precision."""
    own = OwnMap(ERRORS, most_keyframes=25)
    rng = np.random.default_rng(1)
    for k in range(90):
        north = 2.0 * abs((k + 15) % 30 - 15)
        off = (rng.normal(0.0, 0.2), rng.normal(0.0, 0.2))
        reported = off[0], north + off[1]
        estimate = own.add_picture(3.0 * k, taken(0.0, north, 0.0), reported, True)
    assert own.keyframes == 25
    assert len(own.track.numbers) <= 26
    assert math.dist(estimate.error_m, off) < 3.0 * estimate.sigma_m
    assert estimate.sigma_m < 0.2


def test_a_position_that_leaps_is_noticed_at_once():
    own = OwnMap(ERRORS)
    for k in range(42):
        off = 0.0 if k < 40 else 25.0
        own.add_picture(k / 5, taken(0.0, 1.2 * k, 0.0), (off, 1.2 * k), True)
        assert own.track.disagreement().wrong(1.0) == (k == 41)


@pytest.mark.parametrize("leap_m", [(2.0, 0.0), (-14.0, 14.0), (0.0, -200.0)])
@pytest.mark.parametrize("slides_s", [0.1, 1.0])
def test_a_leap_is_not_taken_for_movement(leap_m, slides_s):
    """A filter smooths the leap, and the vehicle brakes meanwhile without a report of that."""
    own = OwnMap(ERRORS)
    north, speed = 0.0, 6.0
    for k in range(60):
        after_s = (k - 30) / 5
        share = 1.0 - math.exp(-after_s / slides_s) if after_s >= 0.0 else 0.0
        speed = max(-3.0, speed - 1.2) if after_s > 0.2 else speed
        north += speed / 5
        reported = share * leap_m[0], north + share * leap_m[1]
        if k == 33:  # as a monitor of the reported positions would state
            own.track.distrust(k / 5 - 2.0)
        estimate = own.add_picture(k / 5, taken(0.0, north, 0.0), reported, k < 33)
        if k >= 33:
            off = math.dist(estimate.error_m, (share * leap_m[0], share * leap_m[1]))
            assert off < 1.0, (k, off)


@pytest.mark.parametrize("off_m", [(3.0, -2.0), (-6.0, 4.0)])
def test_position_is_found_anew_after_a_time_without_pictures(off_m):
    own = OwnMap(ERRORS)
    for k in range(40):
        east, north = 8.0 * (k // 10), 4.0 * (k % 10 if k // 10 % 2 == 0 else 9 - k % 10)
        own.add_picture(float(k), taken(east, north, 0.0), (east, north), True)
    for k in range(40, 90):  # without pictures it flies away, and back
        share = (k - 40) / 50
        reported = 24.0 + share * off_m[0], 6.0 * min(k - 40, 90 - k) + share * off_m[1]
        lost = own.add_picture(float(k), None, reported, False)
    assert lost.sigma_m > 2.0
    found = own.add_picture(91.0, taken(16.0, 20.0, 0.0), (16.0 + off_m[0], 20.0 + off_m[1]), False)
    assert math.dist(found.error_m, off_m) < 0.4
    assert found.sigma_m < 0.5


def test_position_is_found_in_the_map_made_before():
    own = OwnMap(ERRORS)
    for k in range(60):
        east, north = there_and_back(k)
        lost = k >= 30
        off = 0.1 * (k - 30) if lost else 0.0
        estimate = own.add_picture(k / 2, taken(east, north, k / 2), (east + off, north), not lost)
    assert math.dist(estimate.error_m, (off, 0.0)) < 0.4
    assert estimate.sigma_m < 0.4


def test_wrong_satellites_are_noticed():
    own = OwnMap(ERRORS)
    found_s = None
    for k in range(60):
        east, north = there_and_back(k)
        off = 0.1 * max(0, k - 20)
        own.add_picture(k / 2, taken(east, north, k / 2), (east + off, north), True)
        stated = own.track.disagreement()
        if found_s is None and stated.wrong(1.0):
            found_s = stated.since_s
            assert off < 3.0
            own.track.distrust(found_s)
    assert found_s is not None
    assert abs(found_s - 10.0) < 6.0
    assert math.dist(own.track.estimate().error_m, (off, 0.0)) < 0.6
