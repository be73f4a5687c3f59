"""Pictures that are no evidence, and real ones that are."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from missions.units import LatLon
from sitl.camera.exif import black
from sitl.camera.pinhole import CameraSpec, Shot
from sitl.camera.render import render
from sitl.world.world import Patch, World, WorldSpec
from tests.unit.vision.scene import decoded
from vision.plausible import BRIGHT, DARK, Image, implausible

ORIGIN = LatLon(48.0, 11.0)
CAMERA = CameraSpec(hfov_deg=80.0, width_px=640, height_px=480)
PLANE = World(WorldSpec(ORIGIN, 0.0, ())).plane
FILM = Patch(tuple(PLANE.to_wgs84(e, n) for e, n in ((-99, -99), (99, -99), (99, 99), (-99, 99))))
SHAPE = (120, 160, 3)


def jpeg(image: Image, quality: int = 90) -> Image:
    """Return a picture as a camera gives it: compressed and read again."""
    done, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    assert done
    return decoded(data.tobytes())


def uniform(level: int) -> Image:
    return np.full(SHAPE, level, np.uint8)


def noisy(mean: float, sigma: float, seed: int = 1) -> Image:
    noise = np.random.default_rng(seed).normal(mean, sigma, SHAPE)
    return np.clip(np.round(noise), 0, 255).astype(np.uint8)


def shot(seed: int = 1, *, height_m: float = 12.0, east_m: float = 0.0) -> Shot:
    return Shot(east_m, 0.0, height_m, CAMERA.attitude(0.0, 0.0, 0.3), 5.0, seed)


# --- no evidence -----------------------------------------------------------------------------
@pytest.mark.parametrize("level", [0, 3, 60, 128, 200, 255])
@pytest.mark.parametrize("quality", [100, 90, 40])
def test_a_uniform_picture_is_none(level: int, quality: int) -> None:
    reason = implausible(jpeg(uniform(level), quality))
    assert reason is not None
    words = "dark" if level < DARK else "over-exposed" if level > BRIGHT else "uniform"
    assert words in reason


@pytest.mark.parametrize(
    ("level", "sigma", "reason"), [(3.0, 2.0, "lens cap"), (255.0, 1.0, "over-exposed")]
)
def test_the_noise_of_a_sensor_makes_no_picture(level: float, sigma: float, reason: str) -> None:
    assert reason in (implausible(jpeg(noisy(level, sigma))) or "")


def test_a_dead_sensor_may_have_defects() -> None:
    """A few hot pixels do not make a picture of it, also not in the dark."""
    for level in (0, 128):
        image = uniform(level)
        rng = np.random.default_rng(3)
        image[rng.integers(0, 120, 60), rng.integers(0, 160, 60)] = 255
        assert implausible(image) is not None


def test_the_black_pictures_of_the_simulator_are_refused() -> None:
    data = black(render(World(WorldSpec(ORIGIN, 0.0, ())), CAMERA, shot()))
    assert "dark" in (implausible(decoded(data)) or "")


def test_a_picture_that_repeats_is_none_but_one_pixel_makes_another() -> None:
    image = noisy(120.0, 9.0)
    assert implausible(image) is None
    assert "stalled" in (implausible(image.copy(), image) or "")
    for row in (0, 60, 119):
        other = image.copy()
        other[row, 7, 1] ^= 1
        assert implausible(other, image) is None
    assert implausible(image, image[:60]) is None


# --- evidence --------------------------------------------------------------------------------
@pytest.mark.parametrize("height_m", [4.0, 12.0, 60.0])
@pytest.mark.parametrize("patches", [(), (FILM,)], ids=["ground", "film"])
@pytest.mark.parametrize("texture", [14.0, 0.0])
def test_the_simulator_s_pictures_are_evidence(
    height_m: float, patches: tuple[Patch, ...], texture: float
) -> None:
    """A film without texture may fill the picture: the sensor's noise is left."""
    world = World(WorldSpec(ORIGIN, 0.0, patches, texture=texture))
    last = None
    for seed in range(3):  # nothing moves, and still no two pictures are the same
        image = decoded(render(world, CAMERA, shot(seed, height_m=height_m)))
        assert implausible(image, last) is None
        last = image


def test_a_dark_film_that_fills_the_picture_is_evidence() -> None:
    world = World(WorldSpec(ORIGIN, 0.0, (FILM,), roi_intensity=25.0))
    assert implausible(decoded(render(world, CAMERA, shot()))) is None


@pytest.mark.parametrize("quality", [95, 75])
@pytest.mark.parametrize("left", [0.25, 0.05])
def test_fog_is_for_the_detector(left: float, quality: int) -> None:
    """Fog leaves a part of the scene's contrast, under white."""
    scene = decoded(render(World(WorldSpec(ORIGIN, 0.0, ())), CAMERA, shot()))
    rng = np.random.default_rng(2)
    fog = 215.0 * (1 - left) + left * scene + rng.normal(0.0, 1.2, scene.shape)
    assert implausible(jpeg(np.clip(np.round(fog), 0, 255).astype(np.uint8), quality)) is None


def test_half_a_picture_in_the_dark_is_a_picture() -> None:
    image = noisy(120.0, 4.0)
    image[:, :150] = 0
    assert implausible(image) is None


# --- worlds without noise --------------------------------------------------------------------
def test_world_without_noise_is_flown_when_the_mission_allows_it() -> None:
    plain = WorldSpec(ORIGIN, 0.0, (FILM,), texture=0.0, sensor_noise=0.0)
    image = decoded(render(World(plain), CAMERA, shot()))
    assert "uniform" in (implausible(image) or "")
    assert implausible(image, noiseless=True) is None
    assert implausible(image, image, noiseless=True) is None
    night = decoded(render(World(replace(plain, roi_intensity=0.0)), CAMERA, shot()))
    assert implausible(night, noiseless=True) is not None
