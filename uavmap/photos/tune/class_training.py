"""Training of a rule for the classes of a region, tested by picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from missions.classes import Classes
from missions.errors import ImageError
from uavmap.photos.tune.examples import CLASSES_TOML, Example
from uavmap.photos.tune.selection import SETS, Choice, Counts, Picture, dealt, total
from uavmap.photos.tune.training import Scale, seven_digits
from vision.detectors.learned_model import ClassRule
from vision.detectors.pixel_features import FEATURES

_PENALTY: Final = 0.1  # C of the logistic regression, as for the region
_MOST: Final = 6000  # maximum places of a class in one version of a picture


def check_classes(examples: Sequence[Example], classes: Classes) -> None:
    """Raise `ImageError` for a class that fewer than two pictures show."""
    for number, name in classes.names.items():
        count = sum(bool((example.painted == number).any()) for example in examples)
        if count < 2:
            raise ImageError(
                f"{count} of {len(examples)} painted pictures shows {name} ({number}); paint at "
                f"least two that do, or take it out of {CLASSES_TOML}"
            )


def fit_classes(
    pictures: Sequence[Picture],
    numbers: Sequence[int],
    names: Sequence[str],
    scale: Scale,
    seed: int,
) -> ClassRule:
    """Fit a logistic regression with equal frequencies of all classes.

    Args:
        pictures: Pictures, each with places of some of the classes.
        numbers: Numbers of the classes; one without a place gets a weight of 0, and a low bias.
        names: Names of the features.
        scale: Mean and standard deviation of all features.
    """
    from sklearn.linear_model import LogisticRegression  # noqa: PLC0415 - an extra
    from threadpoolctl import threadpool_limits  # noqa: PLC0415

    rows = [FEATURES.index(name) for name in names]
    mean, spread = scale[0][rows], scale[1][rows]
    rng = np.random.default_rng([seed, 5])
    values, labels = [], []
    for one in (version for picture in pictures for version in picture):
        for number in numbers:
            places = np.flatnonzero(one.numbers == number)
            chosen = np.sort(rng.choice(places, min(len(places), _MOST), replace=False))
            values.append(one.values[rows][:, chosen].T)
            labels.append(np.full(len(chosen), number))
    shown = np.concatenate(labels)
    weights, bias = np.zeros((len(numbers), len(rows))), np.full(len(numbers), -30.0)
    there = [list(numbers).index(number) for number in np.unique(shown)]
    bias[there] = 0.0
    if len(there) > 1:
        learner = LogisticRegression(C=_PENALTY, max_iter=300, class_weight="balanced")
        with threadpool_limits(1):  # sums in one order: the same seed gives the same bytes
            learner.fit((np.concatenate(values) - mean) / spread, shown)
        # for two classes the learner has the second one's weights only
        two = len(there) == 2
        weights[there[-1:] if two else there] = learner.coef_
        bias[there[-1:] if two else there] = learner.intercept_
    return ClassRule(
        numbers=tuple(numbers),
        mean=seven_digits(mean),
        scale=seven_digits(spread),
        weights=tuple(map(seven_digits, weights)),
        bias=seven_digits(bias),
    )


def class_counts(
    pictures: Sequence[Picture], choice: Choice, numbers: Sequence[int], scale: Scale, seed: int
) -> Mapping[int, Counts]:
    """Count the places of each class over all pictures, by rules that have not seen them."""
    names = SETS[choice.features]
    rows = [FEATURES.index(name) for name in names]
    found: dict[int, list[Counts]] = {number: [] for number in numbers}
    for learned_from, judged in dealt(pictures):
        rule = fit_classes([pictures[i] for i in learned_from], numbers, names, scale, seed)
        for i in judged:
            plain, region = pictures[i][0], choice.shares[i] >= choice.threshold
            best = np.array(numbers)[rule.sums(plain.values[rows]).argmax(axis=0)]
            for number in numbers:
                marked, there = region & (best == number), plain.numbers == number
                known = plain.known & (there | (plain.numbers > 0) | (plain.region <= 0.2))
                found[number].append(Counts.compare(marked, there, known))
    return {number: total(counts) for number, counts in found.items()}
