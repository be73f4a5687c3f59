from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from missions.errors import MissionFileError
from tests.support.models import all_familiar
from vision.detectors import Detector, detector_names, make_detector
from vision.detectors.learned_model import Logistic, Model, Tree, Trees, model_bytes
from vision.detectors.onnx import OnnxSettings

TREE = Tree(feature=(0, 1), at_most=(0.0, 0.1), left=(0b001, 0b010), leaves=(-1.0, 0.5, 1.0))
MODEL = Model(
    features=("light", "red_green"),
    working_width_px=64,
    parts=(
        Logistic(mean=(0.0, 0.0), scale=(1.0, 1.0), weights=(2.0, -1.0), bias=0.1),
        Trees(base=0.2, trees=(TREE, TREE)),
    ),
    **all_familiar(),
)
PARAMETERS: Mapping[str, Mapping[str, Any]] = {
    "color": {"samples": [[120, 120, 120], [30, 200, 40]], "distance": 60.0},
    "learned": {"model": model_bytes(MODEL)},
    "threshold": {"dilations": 0},
    "onnx": {
        "run": lambda batch: batch[:, :1] - 0.5,
        "settings": OnnxSettings(tile_px=32, output="logit"),
    },
}
NAMES = detector_names()


def made(name):
    return make_detector(name, **PARAMETERS.get(name, {}))


def picture(rows, columns, seed=7):
    return np.random.default_rng(seed).integers(0, 256, (rows, columns, 3), dtype=np.uint8)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("shape", [(48, 64), (97, 131), (33, 20)])
def test_a_detector_keeps_the_protocol(name, shape):
    image = picture(*shape)
    before = image.copy()
    detector = made(name)
    assert isinstance(detector, Detector)
    assert detector.name == name
    mask, probability = detector.mask(image), detector.probability(image)
    assert (mask.shape, mask.dtype) == (shape, np.uint8)
    assert (probability.shape, probability.dtype) == (shape, np.float32)
    assert set(np.unique(mask)) <= {0, 255}
    assert np.isfinite(probability).all()
    assert probability.min() >= 0.0
    assert probability.max() <= 1.0
    assert np.array_equal(image, before)
    again = made(name)
    assert np.array_equal(mask, again.mask(image))
    assert np.array_equal(probability, again.probability(image))


@pytest.mark.parametrize("name", NAMES)
def test_mask_has_the_most_probable_pixels(name):
    image = picture(60, 80)
    detector = made(name)
    marked = detector.mask(image) > 0
    probability = detector.probability(image)
    assert marked.any()
    assert not marked.all()
    assert probability[marked].min() >= probability[~marked].max()


@pytest.mark.parametrize("name", NAMES)
def test_a_picture_that_is_a_view_of_another_is_the_same(name):
    image = picture(48, 128)
    part = image[:, 32:96]
    assert not part.flags["C_CONTIGUOUS"]
    assert np.array_equal(made(name).mask(part), made(name).mask(part.copy()))


@pytest.mark.parametrize("name", NAMES)
def test_an_unknown_parameter_is_named(name):
    with pytest.raises(MissionFileError, match=r"^detector\.nonsense is not a parameter"):
        make_detector(name, **PARAMETERS.get(name, {}), nonsense=1)
