"""Real lenses: pictures with distortion, straightened, are those of a pinhole."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from vision.camera import Lens, Model, distorted, straightening

WIDTH, HEIGHT = 160, 120
LENSES = {
    "brown": Lens(
        WIDTH, HEIGHT, 130.0, 131.0, 82.0, 57.0, "brown", (-0.25, 0.06, 1e-3, -5e-4, 0.0)
    ),
    "pincushion": Lens(WIDTH, HEIGHT, 130.0, 130.0, 79.5, 59.5, "brown", (0.12, 0.0, 0.0, 0.0)),
    "fisheye": Lens(WIDTH, HEIGHT, 70.0, 70.0, 79.5, 59.5, "fisheye", (0.02, -0.01, 0.0, 0.0)),
}


def chequers(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A smooth pattern over the plane at distance 1."""
    return 128 + 60 * np.sin(9 * x) * np.cos(8 * y) + 40 * np.cos(5 * x + 4 * y)


def taken(lens: Lens) -> np.ndarray:
    """What the lens shows of the pattern: each pixel's ray is found by iteration."""
    u, v = np.meshgrid(np.arange(WIDTH, dtype=float), np.arange(HEIGHT, dtype=float))
    pixels = np.stack([u, v], axis=-1).reshape(-1, 1, 2)
    matrix = np.array([[lens.fx_px, 0, lens.cx_px], [0, lens.fy_px, lens.cy_px], [0, 0, 1]])
    coefficients = np.array(lens.distortion)
    if lens.model == "fisheye":
        rays = cv2.fisheye.undistortPoints(pixels, matrix, coefficients)
    else:
        end = (cv2.TERM_CRITERIA_COUNT, 100, 0.0)
        rays = cv2.undistortPoints(
            pixels, matrix, coefficients, None, np.eye(3), np.eye(3), criteria=end
        )
    x, y = rays.reshape(-1, 2).T
    gray = chequers(x, y).reshape(HEIGHT, WIDTH)
    return np.repeat(np.clip(gray, 0, 255).astype(np.uint8)[..., None], 3, axis=2)


@pytest.mark.parametrize("name", LENSES)
def test_a_straightened_picture_is_that_of_its_pinhole(name: str) -> None:
    lens = LENSES[name]
    plan = straightening(lens)
    image = plan.applied(taken(lens))
    u, v = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    focal = plan.camera.focal_px
    expected = chequers((u - (WIDTH - 1) / 2) / focal, (v - (HEIGHT - 1) / 2) / focal)
    off = np.abs(image[:, :, 0].astype(float) - np.clip(expected, 0, 255))
    assert off.max() < 8.0  # nothing past the rim, nothing moved
    assert off.mean() < 1.0


@pytest.mark.parametrize("name", LENSES)
def test_a_scaled_lens_shows_the_same(name: str) -> None:
    lens = LENSES[name]
    double = lens.scaled(2 * WIDTH, 2 * HEIGHT)
    rays = np.array([[0.1, -0.2], [0.3, 0.25]])
    assert (distorted(lens, rays) + 0.5) * 2 - 0.5 == pytest.approx(distorted(double, rays))
    assert straightening(double).camera.hfov_rad == pytest.approx(
        straightening(lens).camera.hfov_rad, abs=1e-3
    )


def test_a_pinhole_needs_no_straightening() -> None:
    lens = Lens.pinhole(math.radians(70.0), WIDTH, HEIGHT)
    assert lens.is_pinhole
    assert not LENSES["brown"].is_pinhole
    image = taken(
        Lens(WIDTH, HEIGHT, lens.fx_px, lens.fx_px, lens.cx_px, lens.cy_px, "brown", (0.0,) * 4)
    )
    assert np.abs(straightening(lens).applied(image).astype(int) - image).max() <= 1


@pytest.mark.parametrize(
    ("change", "blamed"),
    [
        ({"fx_px": 0.0}, "above 0"),
        ({"cx_px": 500.0}, "principal point"),
        ({"distortion": (0.1,)}, "coefficients"),
        ({"fy_px": math.nan}, "finite"),
        ({"model": "fisheye"}, "coefficients"),
    ],
)
def test_what_is_no_lens_is_refused(change: dict[str, object], blamed: str) -> None:
    model: Model = "brown"
    values = {"fx_px": 100.0, "fy_px": 100.0, "cx_px": 80.0, "cy_px": 60.0, "model": model}
    with pytest.raises(ValueError, match=blamed):
        Lens(WIDTH, HEIGHT, **{**values, **change})  # type: ignore[arg-type]
