"""The threshold does what the paper says; each detector does what its name says.

What all of them promise: `tests.conformance.test_detectors`.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.errors import MissionFileError
from vision.detectors import make_detector


def gray(values: np.ndarray) -> np.ndarray:
    return np.repeat(values.astype(np.uint8)[..., None], 3, axis=2)


def test_the_intensity_itself_is_dark() -> None:
    image = gray(np.array([[149, 150, 151]]))
    assert make_detector("threshold", dilations=0).mask(image).tolist() == [[255, 255, 0]]
    bright = make_detector("threshold", dilations=0, polarity="bright")
    assert bright.mask(image).tolist() == [[0, 0, 255]]


@pytest.mark.parametrize("dilations", [0, 1, 7])
def test_a_bright_pixel_grows_to_a_square(dilations: int) -> None:
    values = np.full((41, 41), 60)
    values[20, 20] = 220
    mask = make_detector("threshold", dilations=dilations).mask(gray(values))
    side = 2 * dilations + 1
    assert np.count_nonzero(mask == 0) == side * side
    assert (mask[20 - dilations : 21 + dilations, 20 - dilations : 21 + dilations] == 0).all()


def test_the_edge_of_the_picture_is_no_surround() -> None:
    mask = make_detector("threshold").mask(gray(np.full((20, 20), 60)))
    assert (mask == 255).all()


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
def test_paved_tells_asphalt_from_grass_at_any_exposure(exposure: float) -> None:
    """Blue, green, red of asphalt, lawn, leaves; a shadow is too dark to be called anything."""
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
        ("threshold", {"intensty": 150}, "detector.intensty"),
        ("threshold", {"intensity": 255}, "detector.intensity"),
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
