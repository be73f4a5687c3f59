"""From painted pictures to samples: features of places, and whether they are region.

Few painted pictures show few exposures and one height. So each is also rendered with another
exposure, white balance and contrast, and from higher or lower.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from uavmap.photos.tune.examples import Example
from vision.detectors.pixel_features import described_shape, features

VARIANTS: Final = 3
"""Variants of each painted picture."""
_MOST_SAMPLES: Final = 60_000
_MOST_A_PICTURE: Final = 12_000
_EXPOSURE_STOPS: Final = 0.7
_BALANCE_STOPS: Final = 0.12
_CONTRAST: Final = (0.85, 1.2)
_HEIGHT: Final = 1.28  # times higher or lower
_GAMMA: Final = 0.45  # of sRGB, about: what a doubled exposure does to the logarithm of a level
_CLEAR: Final = 0.8  # a place is a sample if so much of it is of one kind


@dataclass(frozen=True, slots=True)
class Described:
    """A picture as the learners see it.

    `values` is (features, places), `region` the part of each place that is region; the places lie
    in `rows` and `columns`.
    """

    name: str
    values: NDArray[np.float32]
    region: NDArray[np.float32]
    known: NDArray[np.bool_]
    rows: int
    columns: int


def described(example: Example) -> Described:
    """Return the features of all places of a painted picture."""
    values = features(example.picture)
    rows, columns = described_shape(*example.picture.shape[:2])
    known = _mean(example.known, rows, columns)
    region = _mean(example.region & example.known, rows, columns) / np.maximum(known, 1e-6)
    return Described(
        example.name,
        values.reshape(len(values), -1),
        np.minimum(region, 1.0).ravel().astype(np.float32),
        (known > 0.5).ravel(),
        rows,
        columns,
    )


def variants(example: Example, rng: np.random.Generator, count: int = VARIANTS) -> list[Example]:
    """Return the same ground under other exposures and from other heights."""
    return [_exposed(_moved(example, rng), rng) for _ in range(count)]


def clear(one: Described) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the places that are mostly region and those that are mostly surround."""
    return one.known & (one.region >= _CLEAR), one.known & (one.region <= 1.0 - _CLEAR)


def training_set(
    pictures: Sequence[Sequence[Described]], rng: np.random.Generator
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return features, (samples, features), and whether each is region: as many of each picture."""
    share = min(_MOST_A_PICTURE, _MOST_SAMPLES // max(1, len(pictures)))
    values, labels = [], []
    for versions in pictures:
        for one in versions:
            region, surround = clear(one)
            places = np.flatnonzero(region | surround)
            count = min(len(places), max(1, share // len(versions)))
            chosen = np.sort(rng.choice(places, count, replace=False))
            values.append(one.values[:, chosen].T)
            labels.append(one.region[chosen] >= _CLEAR)
    return np.vstack(values), np.concatenate(labels)


def _moved(example: Example, rng: np.random.Generator) -> Example:
    scale = _HEIGHT ** rng.uniform(-1.0, 1.0)
    rows, columns = example.picture.shape[:2]
    matrix = np.array(
        [[scale, 0.0, (1.0 - scale) * columns / 2], [0.0, scale, (1.0 - scale) * rows / 2]]
    )

    def warped(values: NDArray[np.uint8], how: int) -> NDArray[np.uint8]:
        moved = cv2.warpAffine(
            values, matrix, (columns, rows), flags=how, borderMode=cv2.BORDER_REFLECT
        )
        return np.asarray(moved, np.uint8)

    how = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
    region, known = (
        warped(mask.astype(np.uint8), cv2.INTER_NEAREST) > 0
        for mask in (example.region, example.known)
    )
    return Example(example.name, warped(example.picture, how), region, known)


def _exposed(example: Example, rng: np.random.Generator) -> Example:
    stops = rng.uniform(-_EXPOSURE_STOPS, _EXPOSURE_STOPS)
    balance = rng.uniform(-_BALANCE_STOPS, _BALANCE_STOPS, 3)
    levels = (np.arange(256) / 255.0) ** rng.uniform(*_CONTRAST)
    gains = 2.0 ** (_GAMMA * (stops + balance))
    table = np.clip(levels[:, None] * gains * 255.0, 0.0, 255.0).astype(np.uint8)
    exposed = np.asarray(cv2.LUT(example.picture, table[None]), np.uint8)
    return replace(example, picture=exposed)


def _mean(mask: NDArray[np.bool_], rows: int, columns: int) -> NDArray[np.float32]:
    values = mask.astype(np.float32)
    return np.asarray(cv2.resize(values, (columns, rows), interpolation=cv2.INTER_AREA))
