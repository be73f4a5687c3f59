"""From painted pictures to the parts of a model: samples, logistic regression, boosted trees.

Samples are features of places, and their kinds. Few painted pictures show few exposures and one
height. So each is also rendered with another exposure, white balance and contrast, and from higher
or lower. scikit-learn (the extra `tune`) learns from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.errors import UavmapError
from uavmap.base.extras import install_command
from uavmap.photos.tune.examples import Example
from uavmap.photos.tune.polygons import SURROUND, UNKNOWN
from vision.detectors.learned_model import LEAVES, Logistic, Scorer, Tree, Trees
from vision.detectors.pixel_features import described_shape, features

VARIANTS: Final = 3
"""Variants of each painted picture."""
_MAX_SAMPLES: Final = 60_000
_MAX_A_PICTURE: Final = 12_000
_EXPOSURE_STOPS: Final = 0.7
_BALANCE_STOPS: Final = 0.12
_CONTRAST: Final = (0.85, 1.2)
_HEIGHT: Final = 1.28  # times higher or lower
_GAMMA: Final = 0.45  # of sRGB, about: effect of an exposure on the logarithm of a level
_CLEAR: Final = 0.8  # minimum share of one kind in a place that is a sample


@dataclass(frozen=True, slots=True)
class PictureFeatures:
    """Features of a picture for the learners.

    `values` is (features, places), `region` the part of each place that is region. `numbers` is the
    class of places that are mostly of one, else 0. The places are in `rows` and `columns`.
    """

    name: str
    values: NDArray[np.float32]
    region: NDArray[np.float32]
    known: NDArray[np.bool_]
    numbers: NDArray[np.uint8]
    rows: int
    columns: int


def described(example: Example) -> PictureFeatures:
    """Return the features of all places of a painted picture."""
    values = features(example.picture)
    rows, columns = described_shape(*example.picture.shape[:2])
    known = _mean(example.known, rows, columns)
    region = _mean(example.region, rows, columns) / np.maximum(known, 1e-6)
    numbers = np.zeros((rows, columns), np.uint8)
    for number in np.setdiff1d(example.painted, (SURROUND, UNKNOWN)):
        numbers[_mean(example.painted == number, rows, columns) >= _CLEAR] = number
    return PictureFeatures(
        example.name,
        values.reshape(len(values), -1),
        np.minimum(region, 1.0).ravel().astype(np.float32),
        (known > 0.5).ravel(),
        numbers.ravel(),
        rows,
        columns,
    )


def variants(example: Example, rng: np.random.Generator, count: int = VARIANTS) -> list[Example]:
    """Return the same ground under other exposures and from other heights."""
    return [_exposed(_moved(example, rng), rng) for _ in range(count)]


def clear(one: PictureFeatures) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the places that are mostly region and those that are mostly surround."""
    return one.known & (one.region >= _CLEAR), one.known & (one.region <= 1.0 - _CLEAR)


def training_set(
    pictures: Sequence[Sequence[PictureFeatures]], rng: np.random.Generator
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return features, (samples, features), and their kinds; each picture gives equally many."""
    share = min(_MAX_A_PICTURE, _MAX_SAMPLES // max(1, len(pictures)))
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
    painted = warped(example.painted, cv2.INTER_NEAREST)
    return Example(example.name, warped(example.picture, how), painted)


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


# --- the learners --------------------------------------------------------------------------------
_PENALTY: Final = 0.1  # C of the logistic regression: small, because pictures are much alike
_ROUNDS: Final = 60
_RATE: Final = 0.15
_MIN_SAMPLES: Final = 60
_AGREE: Final = 1e-3

Scale = tuple[NDArray[np.float64], NDArray[np.float64]]


def need_learner() -> None:
    """Raise `UavmapError` if scikit-learn is missing."""
    try:
        import sklearn  # noqa: F401, PLC0415 - an extra
    except ImportError:
        raise UavmapError(f"training needs scikit-learn: {install_command('tune')}") from None


def fit_logistic(values: NDArray[np.float32], labels: NDArray[np.bool_], scale: Scale) -> Logistic:
    """Fit a logistic regression with equal frequencies of both kinds.

    Args:
        values: Features, (samples, features).
        scale: Mean and standard deviation of each feature.
    """
    from sklearn.linear_model import LogisticRegression  # noqa: PLC0415
    from threadpoolctl import threadpool_limits  # noqa: PLC0415

    mean, spread = scale
    learner = LogisticRegression(C=_PENALTY, max_iter=300, class_weight="balanced")
    with threadpool_limits(1):
        learner.fit((values - mean) / spread, labels)
    return Logistic(
        mean=seven_digits(mean),
        scale=seven_digits(spread),
        weights=seven_digits(learner.coef_[0]),
        bias=seven_digits(learner.intercept_)[0],
    )


def fit_trees(values: NDArray[np.float32], labels: NDArray[np.bool_], seed: int) -> Trees:
    """Fit boosted trees of at most eight leaves; both kinds count as equally frequent."""
    from sklearn.ensemble import HistGradientBoostingClassifier  # noqa: PLC0415
    from threadpoolctl import threadpool_limits  # noqa: PLC0415

    learner = HistGradientBoostingClassifier(
        max_leaf_nodes=LEAVES,
        max_iter=_ROUNDS,
        learning_rate=_RATE,
        l2_regularization=1.0,
        min_samples_leaf=_MIN_SAMPLES,
        early_stopping=False,
        random_state=seed % 2**32,
    )
    # repeated, not weighted: with weights the learner computes its bins ten times as slowly
    rows = _balanced(labels)
    values, labels = values[rows], labels[rows]
    with threadpool_limits(1):  # sums in one order: the same seed gives the same bytes
        learner.fit(values, labels)
        some = values[:: max(1, len(values) // 500)]
        wanted = learner.predict_proba(some)[:, 1]
    base = float(np.ravel(learner._baseline_prediction)[0])
    parts = Trees(base=base, trees=tuple(_tree(p[0].nodes) for p in learner._predictors))
    _check_same(parts, some, wanted)
    return parts


def _balanced(labels: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return rows of the samples; those of the rarer kind repeat until there are equally many."""
    kinds = [np.flatnonzero(labels), np.flatnonzero(~labels)]
    most = max(map(len, kinds))
    return np.sort(np.concatenate([np.resize(kind, most) for kind in kinds]))


def _check_same(parts: Trees, values: NDArray[np.float32], wanted: NDArray[np.float64]) -> None:
    """Check the trees' answers: scikit-learn does not document their storage."""
    found = Scorer((parts,)).probability(np.ascontiguousarray(values.T))
    off = np.abs(found - wanted) > _AGREE
    if off.mean() > 0.01:  # the last bit may move a value on a border to the other side
        raise UavmapError(
            "this release of scikit-learn stores trees in another way; install another: "
            f"{install_command('tune')}"
        )


def _tree(nodes: NDArray[Any]) -> Tree:
    """Convert a tree of scikit-learn: its leaves from left to right, and their sets."""
    leaves: list[float] = []
    feature: list[int] = []
    at_most: list[float] = []
    left: list[int] = []

    def walk(index: int) -> tuple[int, int]:
        """Number the leaves below a node; return the first, and the one after the last."""
        node = nodes[index]
        if node["is_leaf"]:
            leaves.append(seven_digits([node["value"]])[0])
            return len(leaves) - 1, len(leaves)
        first, middle = walk(int(node["left"]))
        feature.append(int(node["feature_idx"]))
        at_most.append(_border(float(node["num_threshold"])))
        left.append(sum(1 << leaf for leaf in range(first, middle)))
        return first, walk(int(node["right"]))[1]

    walk(0)
    return Tree(
        feature=tuple(feature), at_most=tuple(at_most), left=tuple(left), leaves=tuple(leaves)
    )


def _border(threshold: float) -> float:
    """Return the largest float32 that is not above a threshold.

    Every feature is a float32, so it is on the same side of both. Many equal a threshold, so no
    digit may be lost.

    >>> _border(0.1) < 0.1, float(np.float32(_border(0.1))) == float(np.float32(0.1))
    (True, False)
    >>> _border(0.25)
    0.25
    """
    border = np.float32(threshold)
    if float(border) > threshold:
        border = np.nextafter(border, np.float32(-np.inf))
    return float(f"{border:.9g}")


def seven_digits(values: NDArray[np.floating] | Sequence[float]) -> tuple[float, ...]:
    """Round to seven digits, the precision of float32."""
    return tuple(float(f"{value:.7g}") for value in values)
