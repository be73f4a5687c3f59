"""The choice of model, features and thresholds, by cross-validation over pictures.

A model that has seen none of its pixels, in no variant, judges each picture. Only these judgements
choose, calibrate and report: by precision, recall and IoU against the painted examples.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.errors import ImageError
from uavmap.photos.tune.training import (
    PictureFeatures,
    Scale,
    clear,
    fit_logistic,
    fit_trees,
    training_set,
)
from vision.detectors.interface import UNFAMILIAR, sigmoid
from vision.detectors.learned_model import Logistic, Scorer, Trees
from vision.detectors.pixel_features import FEATURES, GROUPS


@dataclass(frozen=True, slots=True)
class Counts:
    """Counts of pixels or cells: marked and region, marked only, region only."""

    both: float = 0.0
    marked_only: float = 0.0
    region_only: float = 0.0

    @classmethod
    def compare(
        cls, marked: NDArray[np.bool_], region: NDArray[np.bool_], known: NDArray[np.bool_]
    ) -> Counts:
        """Count the places whose kind is known."""
        return cls(
            float(np.count_nonzero(marked & region & known)),
            float(np.count_nonzero(marked & ~region & known)),
            float(np.count_nonzero(~marked & region & known)),
        )

    def __add__(self, other: Counts) -> Counts:
        return Counts(
            self.both + other.both,
            self.marked_only + other.marked_only,
            self.region_only + other.region_only,
        )

    @property
    def precision(self) -> float:
        """Share of the marked places that is region; 1 if none is marked."""
        return _ratio(self.both, self.both + self.marked_only)

    @property
    def recall(self) -> float:
        """Share of the region that is marked; 1 if there is none."""
        return _ratio(self.both, self.both + self.region_only)

    @property
    def iou(self) -> float:
        """Intersection over union; 1 where both are empty.

        >>> Counts(1.0, 1.0, 0.0).iou
        0.5
        """
        return _ratio(self.both, self.both + self.marked_only + self.region_only)


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole else 1.0


def total(counts: Sequence[Counts]) -> Counts:
    """Return the sum over pictures."""
    return sum(counts, Counts())


def cell_counts(
    share: NDArray[np.float32],
    region: NDArray[np.float32],
    known: NDArray[np.bool_],
    cell: float,
    least: float,
) -> Counts:
    """Count cells whose mean share is at least `least`; a cell is region from one half on.

    Args:
        share: The marked part of each place, or its probability, (rows, columns).
        region: The part of each place that is region.
        cell: Side of a cell, in places.
        least: Share that makes a cell positive.
    """
    seen = by_cell(known.astype(np.float32), cell)
    weight = np.maximum(seen, 1e-6)
    there = by_cell(region * known, cell) / weight >= 0.5
    found = by_cell(share * known, cell) / weight >= least
    return Counts.compare(found, there, seen >= 0.5)


def by_cell(values: NDArray[np.float32], cell: float) -> NDArray[np.float32]:
    """Return the means of values, by rows and columns of places, over cells of side `cell`."""
    rows, columns = (max(1, round(side / cell)) for side in values.shape)
    cells = cv2.resize(values, (columns, rows), interpolation=cv2.INTER_AREA)
    return np.asarray(cells, np.float32)


Array = NDArray[np.float32]

SETS: Final[Mapping[str, tuple[str, ...]]] = {
    "color and texture": GROUPS["color"] + GROUPS["texture"],
    "color": GROUPS["color"],
    "color, texture and context": FEATURES,
}
"""Sets of features; the first is the default."""
KINDS: Final = ("both", "logistic", "trees")
"""`both`: the mean of the other two; it is the default."""
_BETTER: Final = 0.02  # of IoU: minimum gain of a candidate over the default
_ERRORS: Final = 2.0  # minimum gain, in standard errors over the pictures: few can mislead
_PLATEAU: Final = 0.012  # thresholds this close to the best are as good; the lowest is used
_FOLDS: Final = 5
_LIMITS: Final = (0.1, 0.8)
_SLOPES: Final = (0.3, 1.5)
_MIN_KIND_SHARE: Final = 0.01  # a picture with less of a kind is no evidence for the calibration


Picture = tuple[PictureFeatures, ...]
"""A painted picture, described, followed by its variants."""


@dataclass(frozen=True, slots=True)
class Choice:
    """The choice of cross-validation.

    `shares` are the probabilities of each picture's places by the model that has not seen it.
    `tried` has the IoU of places for each candidate.
    """

    kind: str
    features: str
    slope: float
    offset: float
    threshold: float
    share: float
    shares: tuple[Array, ...]
    tried: Mapping[str, float]


def dealt(pictures: Sequence[Picture]) -> list[tuple[list[int], list[int]]]:
    """Split into up to five parts: pictures to learn from, and to judge; each is judged once.

    No part holds all pictures with region, or all with surround. Pictures with region come before
    those without, those with surround after those without, and two neighbours are never judged
    together.
    """

    def kinds(number: int) -> tuple[bool, bool, bool]:
        region, surround = (bool(places.any()) for places in clear(pictures[number][0]))
        return not (region or surround), surround, not region

    order = sorted(range(len(pictures)), key=kinds)
    parts = min(len(order), _FOLDS)
    judged = [sorted(order[part::parts]) for part in range(parts)]
    return [([i for i in range(len(order)) if i not in out], out) for out in judged]


def fitted(
    pictures: Sequence[Picture], names: Sequence[str], scale: Scale, kinds: str, seed: int
) -> tuple[Logistic | Trees, ...]:
    """Return the parts of a model. Raises `ImageError` if too little of one kind is painted."""
    rows = [FEATURES.index(name) for name in names]
    rng = np.random.default_rng([seed, len(rows)])
    values, labels = training_set(pictures, rng)
    if labels.all() or not labels.any():
        kind = "surround" if labels.any() else "region"
        raise ImageError(f"too little {kind} is painted to learn from; paint more of it")
    values = values[:, rows]
    part = (scale[0][rows], scale[1][rows])
    parts: list[Logistic | Trees] = []
    if kinds in ("both", "logistic"):
        parts.append(fit_logistic(values, labels, part))
    if kinds in ("both", "trees"):
        parts.append(fit_trees(values, labels, seed))
    return tuple(parts)


def choose(
    pictures: Sequence[Picture],
    scale: Scale,
    familiarity: Sequence[tuple[Array, Array]],
    cell: float,
    seed: int,
    show: Callable[[str], None],
    kinds: Sequence[str] = KINDS,
    sets: Sequence[str] = tuple(SETS),
) -> Choice:
    """Choose kind, features, calibration and thresholds.

    Places that a detector would call unsure count as no region, as on a map.

    Args:
        pictures: At least two; each part to learn from has both kinds.
        familiarity: Two for each picture's places: if taken for region, and for surround.
        scale: Mean and standard deviation of all features.
        cell: Side of a cell, in places.
        seed: Seed of the samples and the trees.
    """
    best: Choice | None = None
    tried: dict[str, float] = {}
    for features in sets:
        logits = _judged(pictures, features, scale, seed, kinds)
        for kind in kinds:
            found = _calibrated(pictures, logits[kind], kind, features, cell)
            iou = total(_mapped(pictures, familiarity, found)).iou
            tried[f"{kind}, {features}"] = round(iou, 4)
            show(f"{kind} on {features}: IoU {iou:.3f}")
            if best is None or _clearly_better(pictures, familiarity, found, best):
                best = found
    assert best is not None
    return replace(best, tried=tried)


def _judged(
    pictures: Sequence[Picture], features: str, scale: Scale, seed: int, kinds: Sequence[str]
) -> dict[str, list[list[Array]]]:
    """Return by kind the logits of each version of each picture, by a model that is new to it."""
    names = SETS[features]
    rows = [FEATURES.index(name) for name in names]
    found: dict[str, list[list[Array]]] = {kind: [[] for _ in pictures] for kind in KINDS}
    for learned_from, judged in dealt(pictures):
        kind = kinds[0] if len(kinds) == 1 else "both"
        parts = fitted([pictures[i] for i in learned_from], names, scale, kind, seed)
        halves = {"both": parts, "logistic": parts[:1], "trees": parts[1:]}
        by_kind = {kind: parts} if len(kinds) == 1 else halves
        for kind, some in by_kind.items():
            scorer = Scorer(some)
            for i in judged:
                found[kind][i] = [
                    scorer.logit(np.ascontiguousarray(one.values[rows])) for one in pictures[i]
                ]
    return found


def _calibrated(
    pictures: Sequence[Picture], logits: list[list[Array]], kind: str, features: str, cell: float
) -> Choice:
    """Return a candidate with its calibration, and the thresholds that suit the pictures best."""
    slope, offset = calibration(pictures, logits)
    by_picture = [
        [(one, sigmoid(slope * logit + offset)) for one, logit in zip(picture, some, strict=True)]
        for picture, some in zip(pictures, logits, strict=True)
    ]
    useful = [versions for versions in by_picture if _shows_both(versions)] or by_picture

    def usual(counts: Callable[[PictureFeatures, Array, float], Counts]) -> float:
        """Return the median of the pictures' best values: one may be unlike the others."""
        return float(np.median([_suiting(versions, counts) for versions in useful]))

    places = usual(_counts)
    cells = usual(lambda one, share, least: _cells(one, share, cell, least))
    plain = tuple(sigmoid(slope * some[0] + offset) for some in logits)
    return Choice(
        kind, features, slope, offset, round(places, 2), round(cells, 2), plain, {}
    )  # fmt: skip


def calibration(
    pictures: Sequence[Picture], logits: Sequence[Sequence[Array]]
) -> tuple[float, float]:
    """Return slope and offset that make logits of unseen places frequencies (Platt, 1999).

    They are medians over the pictures: of three, one may show ground that the two others lack, and
    its errors would shift the rest. Pictures without both kinds do not count. The slope is kept
    within limits.
    """
    samples = []
    for picture, some in zip(pictures, logits, strict=True):
        x = np.concatenate([v[one.known] for one, v in zip(picture, some, strict=True)])
        y = np.concatenate([one.region[one.known] for one in picture])
        if _both_kinds(y):
            samples.append((x.astype(np.float64), y.astype(np.float64)))
    if not samples:
        return 1.0, 0.0
    slope = float(np.median([_platt(x, y)[0] for x, y in samples]))
    slope = round(float(np.clip(slope, *_SLOPES)), 5)
    offsets = [_platt(slope * x, y, tilts=False)[1] for x, y in samples]
    return slope, round(float(np.median(offsets)), 5)


def _shows_both(versions: Sequence[tuple[PictureFeatures, Array]]) -> bool:
    """Return True if a picture shows both kinds."""
    return _both_kinds(np.concatenate([one.region[one.known] for one, _ in versions]))


def _both_kinds(region: NDArray[np.float32]) -> bool:
    return bool(region.size) and _MIN_KIND_SHARE < float(region.mean()) < 1.0 - _MIN_KIND_SHARE


def _platt(
    x: NDArray[np.float64], y: NDArray[np.float64], *, tilts: bool = True
) -> tuple[float, float]:
    """Fit a logistic regression of `y` on `x`; of slope 1 unless it `tilts`."""
    slope, offset, w = 1.0, 0.0, 1.0 / len(x)
    for _ in range(30):  # Newton's steps, with a weak pull towards slope 1
        p = 1.0 / (1.0 + np.exp(-np.clip(slope * x + offset, -30.0, 30.0)))
        q = w * np.maximum(p * (1.0 - p), 1e-6)
        pull = 0.01 if tilts else 1e6
        gradient = np.array([w * ((p - y) @ x) + pull * (slope - 1.0), w * (p - y).sum()])
        cross = q @ x
        hessian = np.array([[q @ (x * x) + pull, cross], [cross, q.sum() + 1e-6]])
        step = np.linalg.solve(hessian, gradient)
        step /= max(1.0, float(np.abs(step).max()))
        slope, offset = slope - step[0], offset - step[1]
        if np.abs(step).max() < 1e-6:
            break
    return slope, offset


def _suiting(
    versions: Sequence[tuple[PictureFeatures, Array]],
    counts: Callable[[PictureFeatures, Array, float], Counts],
) -> float:
    """Return the lowest threshold that suits a picture about as well as the best one.

    A model knows ground and light of painted pictures. In other pictures it is less sure of the
    region, and rarely marks more.
    """
    at = np.round(np.arange(_LIMITS[0], _LIMITS[1] + 1e-9, 0.02), 2)
    scores = np.array(
        [total([counts(one, share, float(least)) for one, share in versions]).iou for least in at]
    )
    return round(float(at[scores >= scores.max() - _PLATEAU][0]), 2)


def _mapped(
    pictures: Sequence[Picture], familiarity: Sequence[tuple[Array, Array]], choice: Choice
) -> list[Counts]:
    """Return the counts of each picture's places; unfamiliar region counts as none."""
    least = choice.threshold
    return [
        _counts(picture[0], np.where(taken >= UNFAMILIAR, share, np.float32(0.0)), least)
        for picture, share, (taken, _) in zip(pictures, choice.shares, familiarity, strict=True)
    ]


def _clearly_better(
    pictures: Sequence[Picture],
    familiarity: Sequence[tuple[Array, Array]],
    one: Choice,
    other: Choice,
) -> bool:
    """Return True if the gain over the pictures exceeds what their differences explain."""
    pairs = zip(
        _mapped(pictures, familiarity, one), _mapped(pictures, familiarity, other), strict=True
    )
    gains = np.array([a.iou - b.iou for a, b in pairs])
    error = float(gains.std(ddof=1)) / math.sqrt(len(gains))
    return float(gains.mean()) > max(_BETTER, _ERRORS * error)


def _counts(one: PictureFeatures, share: Array, least: float) -> Counts:
    return Counts.compare(share >= least, one.region >= 0.5, one.known)


def _cells(one: PictureFeatures, share: Array, cell: float, least: float) -> Counts:
    shape = (one.rows, one.columns)
    return cell_counts(
        share.reshape(shape), one.region.reshape(shape), one.known.reshape(shape), cell, least
    )


def picture_counts(
    one: PictureFeatures, share: Array, cell: float, threshold: float, least: float
) -> tuple[Counts, Counts]:
    """Count places and cells of a picture."""
    return _counts(one, share, threshold), _cells(one, share, cell, least)
