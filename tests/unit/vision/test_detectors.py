"""The threshold follows the paper; each detector does as its name promises.

`tests.conformance.test_detectors` has the promises of all detectors.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.errors import ImageError, MissionFileError
from missions.mission.sections import DetectorSection
from uavmap.load.detector_source import region_in_words
from vision.detectors import make_detector


def gray(values: np.ndarray) -> np.ndarray:
    return np.repeat(values.astype(np.uint8)[..., None], 3, axis=2)


def test_the_intensity_itself_is_dark() -> None:
    image = gray(np.array([[149, 150, 151]]))
    assert make_detector("threshold", dilations=0).mask(image).tolist() == [[255, 255, 0]]
    bright = make_detector("threshold", dilations=0, polarity="bright")
    assert bright.mask(image).tolist() == [[0, 0, 255]]


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), intensity=st.integers(0, 254), dilations=st.integers(0, 8))
def test_the_threshold_is_the_papers_steps(seed: int, intensity: int, dilations: int) -> None:
    image = np.random.default_rng(seed).integers(0, 256, (31, 43, 3), dtype=np.uint8)
    bright = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) > intensity
    surround = bright.astype(np.uint8) * 255
    for _ in range(dilations):
        surround = cv2.dilate(surround, np.ones((3, 3), np.uint8)).astype(np.uint8)
    detector = make_detector("threshold", intensity=intensity, dilations=dilations)
    assert np.array_equal(detector.mask(image), 255 - surround)
    assert np.array_equal(detector.probability(image), (255 - surround) / 255.0)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), intensity=st.integers(0, 254), dilations=st.integers(0, 3))
def test_bright_is_the_mirror_of_dark(seed: int, intensity: int, dilations: int) -> None:
    values = np.random.default_rng(seed).integers(0, 256, (12, 15))
    dark = make_detector("threshold", intensity=intensity, dilations=dilations)
    bright = make_detector(
        "threshold", intensity=254 - intensity, dilations=dilations, polarity="bright"
    )
    assert np.array_equal(dark.mask(gray(values)), bright.mask(gray(255 - values)))


@pytest.mark.parametrize("exposure", [0.7, 1.0, 1.4])
def test_paved_distinguishes_asphalt_from_grass_at_any_exposure(exposure: float) -> None:
    """Blue, green, red of asphalt, lawn, leaves; a shadow is too dark for any class."""
    colours = np.array([[(165, 155, 160), (85, 150, 130), (60, 130, 90), (40, 38, 39)]])
    image = (colours * exposure).astype(np.uint8)
    assert make_detector("paved", dilations=0).mask(image).tolist() == [[255, 0, 0, 0]]


def test_paved_dilates_the_surround() -> None:
    image = gray(np.full((9, 9), 160))
    image[4, 4] = (60, 150, 110)
    mask = make_detector("paved", dilations=2).mask(image)
    assert np.count_nonzero(mask == 0) == 25


@pytest.mark.parametrize(
    ("name", "params", "blamed"),
    [
        ("sonar", {}, "detector.name"),
        ("threshold", {"intensity": 150.5}, "detector.intensity"),
        ("threshold", {"dilations": -1}, "detector.dilations"),
        ("threshold", {"dilations": True}, "detector.dilations"),
        ("threshold", {"polarity": "blue"}, "detector.polarity"),
        ("paved", {"greenness": 2.5}, "detector.greenness"),
        ("paved", {"greenness": float("nan")}, "detector.greenness"),
        ("paved", {"greenness": "little"}, "detector.greenness"),
        ("paved", {"intensity": -1}, "detector.intensity"),
    ],
)
def test_bad_parameters_are_named(name: str, params: dict[str, object], blamed: str) -> None:
    with pytest.raises(MissionFileError, match=blamed):
        make_detector(name, **params)


# --- those that follow light, colours and bands ---------------------------------------------------
def test_adaptive_follows_the_light() -> None:
    values = np.tile(np.linspace(60, 220, 80), (60, 1))
    values[20:30, 10:20] -= 40
    values[20:30, 60:70] -= 40
    mask = make_detector("adaptive", window=0.5, offset=20, dilations=0).mask(gray(values))
    assert (mask[22:28, 12:18] == 255).all()
    assert (mask[22:28, 62:68] == 255).all()
    assert np.count_nonzero(mask) < 2.5 * 100


def test_color_chooses_the_nearest_sample() -> None:
    red, brick, green = (30, 40, 200), (50, 70, 160), (60, 150, 60)
    image = np.array([[red, brick, green]], np.uint8)
    wide = make_detector("color", samples=[[200, 40, 30]], distance=60.0)
    assert wide.mask(image).tolist() == [[255, 255, 0]]
    fine = make_detector(
        "color", samples=[[200, 40, 30]], not_samples=[[160, 70, 50]], distance=60.0
    )
    assert fine.mask(image).tolist() == [[255, 0, 0]]
    assert wide.probability(image)[0, 0] == pytest.approx(1.0, abs=1e-3)


def test_color_without_lightness_ignores_shadow() -> None:
    image = np.array([[(100, 100, 200), (50, 50, 100)]], np.uint8)
    near = [
        make_detector("color", samples=[[200, 100, 100]], lightness=weight).probability(image)[0, 1]
        for weight in (1.0, 0.0)
    ]
    assert near[0] < 0.2 < near[1]


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_indices_take_any_band_of_any_depth(depth: type) -> None:
    most = np.iinfo(depth).max
    water, leaf = (0.3, 0.4, 0.2, 0.05), (0.05, 0.3, 0.1, 0.9)  # blue, green, red, near infrared
    image = (np.array([[water, leaf]]) * most).astype(depth)
    plants = make_detector("index", kind="ndvi", value=0.3)
    ponds = make_detector("index", kind="ndwi", value=0.3)
    assert plants.mask(image).tolist() == [[0, 255]]
    assert ponds.mask(image).tolist() == [[255, 0]]
    with pytest.raises(ImageError, match=r"detector\.nir = 3: the picture has 3 bands"):
        plants.mask(image[:, :, :3])


def test_a_hot_spot_stands_out_of_its_picture() -> None:
    heat = np.random.default_rng(4).normal(20_000, 50, (40, 40, 1)).astype(np.uint16)
    heat[10:13, 20:24] += 2000
    mask = make_detector("index", kind="hot", value=8.0).mask(heat)
    assert np.count_nonzero(mask) == 12
    assert (mask[10:13, 20:24] == 255).all()


@pytest.mark.parametrize(
    ("name", "parameters", "words"),
    [
        ("threshold", {"polarity": "bright"}, "brighter than 150 of 255"),
        ("adaptive", {}, "darker than its surroundings by more than 12 of 255"),
        ("paved", {}, "bare ground: not green, and brighter than 90 of 255"),
        ("color", {"samples": [[10, 20, 30]] * 5}, "rgb(10, 20, 30) and 2 more"),
        ("index", {"kind": "ndwi", "value": 0.3}, "index ndwi above 0.3"),
    ],
)
def test_detector_describes_its_region(name: str, parameters: dict[str, Any], words: str) -> None:
    assert region_in_words(DetectorSection(name=name, **{name: parameters})).find(words) >= 0
