"""Where a vehicle is by its own pictures, which the simulator has rendered."""

from __future__ import annotations

import math

import cv2
import numpy as np

from missions.navigation import ToldErrors
from missions.units import LatLon, Pose
from sitl.camera.pinhole import CameraSpec, Shot
from sitl.camera.render import render
from sitl.world.world import World, WorldSpec
from vision.camera import Camera
from vision.ground_match import Patch, patch
from vision.look import Frame
from vision.own_map import OwnMap

ORIGIN = LatLon(48.0, 11.0)
SPEC = CameraSpec(hfov_deg=80.0, width_px=320, height_px=240)
CAMERA = Camera(math.radians(80.0), 320, 240)
WORLD = World(WorldSpec(ORIGIN, 0.0, (), seed=3))
ERRORS = ToldErrors(satellites_m=0.3, pointing_m=0.03)


def taken(east_m: float, north_m: float, t_s: float) -> Patch:
    attitude = SPEC.attitude(0.0, 0.0, 0.0)
    data = render(WORLD, SPEC, Shot(east_m, north_m, 12.0, attitude, t_s, round(10 * t_s)))
    image = np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR), np.uint8)
    found = patch(Frame(image, Pose(ORIGIN, 12.1, attitude), t_s, CAMERA))
    assert found is not None
    return found


def there_and_back(k: int) -> tuple[float, float]:
    """Thirty steps of 2 m to the north, and back over the same ground."""
    return 0.4 * (k >= 30), 2.0 * min(k, 60 - k)


def test_it_finds_back_to_the_map_made_before() -> None:
    own = OwnMap(ERRORS)
    for k in range(60):
        east, north = there_and_back(k)
        lost = k >= 30
        off = 0.1 * (k - 30) if lost else 0.0
        estimate = own.take(k / 2, taken(east, north, k / 2), (east + off, north), not lost)
    assert math.dist(estimate.error_m, (off, 0.0)) < 0.4
    assert estimate.sigma_m < 0.4


def test_it_finds_satellites_that_lie() -> None:
    own = OwnMap(ERRORS)
    found_s = None
    for k in range(60):
        east, north = there_and_back(k)
        off = 0.1 * max(0, k - 20)
        own.take(k / 2, taken(east, north, k / 2), (east + off, north), True)
        if found_s is None and own.disagreement().least_m > 1.0:
            found_s = own.disagreement().since_s
            assert off < 3.0
            own.track.distrust(found_s)
    assert found_s is not None
    assert abs(found_s - 10.0) < 6.0
    assert math.dist(own.track.estimate().error_m, (off, 0.0)) < 0.6
