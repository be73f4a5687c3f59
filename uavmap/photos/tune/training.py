"""Logistic regression and boosted trees by scikit-learn (the extra `tune`), as parts of a model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from missions.errors import UavmapError
from uavmap.base.extras import install_command
from vision.detectors.learned_model import LEAVES, Logistic, Model, Scorer, Tree, Trees

_PENALTY: Final = 0.1  # C of the logistic regression: small, for few pictures are much alike
_ROUNDS: Final = 60
_RATE: Final = 0.15
_LEAST_SAMPLES: Final = 60
_AGREE: Final = 1e-3

Scale = tuple[NDArray[np.float64], NDArray[np.float64]]


def need_learner() -> None:
    """Raise `UavmapError` where scikit-learn is missing."""
    try:
        import sklearn  # noqa: F401, PLC0415 - an extra
    except ImportError:
        raise UavmapError(f"training needs scikit-learn: {install_command('tune')}") from None


def fit_logistic(values: NDArray[np.float32], labels: NDArray[np.bool_], scale: Scale) -> Logistic:
    """Fit a logistic regression that takes both kinds for equally frequent.

    Args:
        values: (samples, features).
        scale: Mean and standard deviation of each feature.
    """
    from sklearn.linear_model import LogisticRegression  # noqa: PLC0415
    from threadpoolctl import threadpool_limits  # noqa: PLC0415

    mean, spread = scale
    learner = LogisticRegression(C=_PENALTY, max_iter=300, class_weight="balanced")
    with threadpool_limits(1):
        learner.fit((values - mean) / spread, labels)
    return Logistic(
        mean=_short(mean),
        scale=_short(spread),
        weights=_short(learner.coef_[0]),
        bias=_short(learner.intercept_)[0],
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
        min_samples_leaf=_LEAST_SAMPLES,
        early_stopping=False,
        random_state=seed % 2**32,
    )
    # repeated, not weighted: with weights the learner takes its bins ten times as slowly
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
    """Return rows of the samples, those of the rarer kind repeated until there are as many."""
    kinds = [np.flatnonzero(labels), np.flatnonzero(~labels)]
    most = max(map(len, kinds))
    return np.sort(np.concatenate([np.resize(kind, most) for kind in kinds]))


def _check_same(parts: Trees, values: NDArray[np.float32], wanted: NDArray[np.float64]) -> None:
    """Check the trees' answers: scikit-learn does not promise how it keeps them."""
    names = tuple(f"{i}" for i in range(values.shape[1]))
    model = Model.model_construct(features=names, parts=(parts,), slope=1.0, offset=0.0)
    found = Scorer(model).probability(np.ascontiguousarray(values.T))
    off = np.abs(found - wanted) > _AGREE
    if off.mean() > 0.01:  # a value on a border may fall to the other side by its last bit
        raise UavmapError(
            "the trees of this release of scikit-learn are kept in another way; install another: "
            f"{install_command('tune')}"
        )


def _tree(nodes: NDArray[Any]) -> Tree:
    """Convert a tree of scikit-learn: leaves from left to right, what each node rules out."""
    leaves: list[float] = []
    feature: list[int] = []
    at_most: list[float] = []
    left: list[int] = []

    def walk(index: int) -> tuple[int, int]:
        """Number the leaves below a node; return the first and the one behind the last."""
        node = nodes[index]
        if node["is_leaf"]:
            leaves.append(_short([node["value"]])[0])
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

    Every feature, a float32 too, falls to the same side of both. Many have the very value of a
    threshold, so no digit may be lost.

    >>> _border(0.1) < 0.1, float(np.float32(_border(0.1))) == float(np.float32(0.1))
    (True, False)
    >>> _border(0.25)
    0.25
    """
    border = np.float32(threshold)
    if float(border) > threshold:
        border = np.nextafter(border, np.float32(-np.inf))
    return float(f"{border:.9g}")


def _short(values: NDArray[np.float64] | Sequence[float]) -> tuple[float, ...]:
    """Round to seven digits, which is what float32 has."""
    return tuple(float(f"{value:.7g}") for value in values)
