"""By how much larger one patch shows the ground than another: rendered from known heights."""

from __future__ import annotations

import math

import pytest

from missions.units import LatLon, Pose
from sitl.camera.pinhole import CameraSpec, Shot
from sitl.camera.render import render
from sitl.world.world import World, WorldSpec
from tests.unit.vision.scene import decoded
from vision.camera import Camera
from vision.look import Frame
from vision.own_map.ground_match import Patch, match, patch
from vision.own_map.patch_zoom import compare, resized

SPEC = CameraSpec(hfov_deg=80.0, width_px=320, height_px=240)
CAMERA = Camera(math.radians(80.0), 320, 240)
WORLD = World(WorldSpec(LatLon(48.0, 11.0), 0.0, (), seed=3))


def taken(east_m: float, north_m: float, height: float = 0.0, heading_rad: float = 0.0) -> Patch:
    """From 12 m, told higher by a share, and turned clockwise."""
    shot = Shot(east_m, north_m, 12.0, SPEC.attitude(0.0, 0.0, 0.0), 0.0, round(7 * north_m))
    data = render(WORLD, SPEC, shot)
    told = Pose(LatLon(48.0, 11.0), 12.0 * (1.0 + height), SPEC.attitude(0.0, 0.0, heading_rad))
    found = patch(Frame(decoded(data), told, 0.0, CAMERA), metres_per_pixel=0.2)
    assert found is not None
    return found


@pytest.mark.parametrize("height", [-0.03, 0.0, 0.02])
@pytest.mark.parametrize("turned_rad", [0.0, -0.03])
def test_a_height_or_heading_that_wanders_is_seen(height: float, turned_rad: float) -> None:
    earlier, later = taken(0.0, 0.0), taken(1.5, 4.0, height, -turned_rad)
    near = match(earlier, later, (1.5, 4.0), 1.0)
    assert near is not None
    found = compare(earlier, later, complex(*near.moved_m) / 0.2)
    assert found is not None
    zoom = complex(height, turned_rad)
    assert abs(found.zoom - zoom) < 0.004
    assert found.sigma < 0.006
    way_m = complex(1.5, 4.0) * (1.0 + zoom / 2.0)
    assert abs(found.moved_px * 0.2 - way_m) < 0.05


def test_what_is_much_larger_is_found_once_it_is_made_alike() -> None:
    earlier, later = taken(0.0, 0.0), taken(0.0, 4.0, 0.15)
    alike = resized(later, 0.14 + 0j)
    near = match(earlier, alike, (0.0, 4.0), 1.0)
    assert near is not None
    found = compare(earlier, later, complex(*near.moved_m) / 0.2, 0.14 + 0j)
    assert found is not None
    assert found.zoom == pytest.approx(0.15, abs=0.004)


def test_other_ground_has_no_size() -> None:
    assert compare(taken(0.0, 0.0), taken(15.0, 9.0), 0j) is None
    assert compare(taken(0.0, 0.0), taken(0.0, 0.0), complex(0.0, 70.0)) is None
