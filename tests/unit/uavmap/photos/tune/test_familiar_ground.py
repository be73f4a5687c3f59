"""Mixtures that describe painted ground: several kinds of surround, and the ground between."""

from __future__ import annotations

import numpy as np

from uavmap.photos.tune.familiar_ground import familiar_ground
from uavmap.photos.tune.training import PictureFeatures
from vision.detectors.familiarity import NAMES, Familiar
from vision.detectors.interface import UNFAMILIAR
from vision.detectors.pixel_features import FEATURES

KINDS = 7
SIDE = len(FEATURES)
SCALE = (np.zeros(SIDE), np.ones(SIDE))


def middles() -> np.ndarray:
    """Return the features of seven kinds of surround, far from each other, and of the region."""
    return np.random.default_rng(4).uniform(-3.0, 3.0, (KINDS + 1, SIDE))


def painted(number: int) -> tuple[PictureFeatures, ...]:
    """Return the picture of a number, with a strip of each kind of ground."""
    rng = np.random.default_rng(number)
    columns = 300
    values = np.repeat(middles(), columns, axis=0)
    values = (values + rng.normal(0.0, 0.15, values.shape)).T.astype(np.float32)
    region = np.repeat(np.arange(KINDS + 1) == KINDS, columns).astype(np.float32)
    places = len(region)
    return (
        PictureFeatures(
            f"{number}", values, region, np.ones(places, np.bool_), np.zeros(places, np.uint8),
            KINDS + 1, columns,
        ),
    )  # fmt: skip


def test_kinds_of_surround_are_familiar_and_ground_between_them_is_not() -> None:
    ground = familiar_ground([painted(number) for number in range(5)], SCALE, seed=0)
    rows = [FEATURES.index(name) for name in NAMES]
    kinds = middles()[:KINDS, rows].T.astype(np.float32)
    between = np.asarray((kinds[:, :-1] + kinds[:, 1:]) / 2, np.float32)
    familiar = Familiar.from_model(ground.familiarity)
    surround = np.zeros(KINDS, np.bool_)
    assert familiar.familiarity(kinds, surround).min() > UNFAMILIAR
    assert familiar.familiarity(between, surround[1:]).max() < UNFAMILIAR
