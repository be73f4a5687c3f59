"""A model that `uavmap tune` has trained: its file, its answer and its familiarity.

Its file is JSON, so reading one runs nothing that it holds. A model has one or two parts, a
logistic regression and boosted trees; its answer is the calibrated mean of theirs. A linear rule
over the same features gives the class of a pixel of the region. A tree has at most eight leaves,
the bits of a byte. Its conditions rule leaves out. A table of 256 values gives the worth of the
remaining set, for all pixels at once (QuickScorer, Lucchese and others, 2015). Beside its
probability a pixel has a familiarity (`vision.detectors.familiarity`).
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Final, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from missions.classes import Classes, ClassNumber
from missions.errors import MissionFileError
from vision.detectors.familiarity import NAMES, Familiar, Familiarity
from vision.detectors.interface import UNFAMILIAR, Judgement, check_number, marked, sigmoid
from vision.detectors.pixel_features import FEATURES, features, working_picture

Array = NDArray[np.float32]

FORMAT: Final = "uavmap detector"
VERSION: Final = 4
LEAVES: Final = 8
LARGEST_BYTES: Final = 8_000_000

_Number = Annotated[float, Field(allow_inf_nan=False)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Logistic(_Part):
    """A logistic regression on standardised features."""

    kind: Literal["logistic"] = "logistic"
    mean: tuple[_Number, ...]
    scale: tuple[Annotated[_Number, Field(gt=0)], ...]
    weights: tuple[_Number, ...]
    bias: _Number


class Tree(_Part):
    """A tree: nodes that ask whether a feature is at most a value, and the worth of its leaves.

    A node answered no rules out the leaves `left[i]`, bits of a byte.
    """

    feature: tuple[Annotated[int, Field(ge=0)], ...]
    at_most: tuple[_Number, ...]
    left: tuple[Annotated[int, Field(ge=1, le=255)], ...]
    leaves: Annotated[tuple[_Number, ...], Field(min_length=1, max_length=LEAVES)]

    @model_validator(mode="after")
    def _even(self) -> Tree:
        if not len(self.feature) == len(self.at_most) == len(self.left) == len(self.leaves) - 1:
            raise ValueError("a tree has one node less than leaves")
        return self


class Trees(_Part):
    """Boosted trees; their sum is the logit."""

    kind: Literal["trees"] = "trees"
    base: _Number
    trees: Annotated[tuple[Tree, ...], Field(max_length=1000)]


class ClassRule(_Part):
    """A rule for the classes of a region: a pixel is of the class with the largest sum.

    `numbers` are the classes'; each has a row of `weights`, of standardised features, and a `bias`.
    """

    numbers: Annotated[tuple[ClassNumber, ...], Field(min_length=1)]
    mean: tuple[_Number, ...]
    scale: tuple[Annotated[_Number, Field(gt=0)], ...]
    weights: tuple[tuple[_Number, ...], ...]
    bias: tuple[_Number, ...]

    def sums(self, values: Array) -> Array:
        """Return the sum of each class, (classes, n), of features (count, n)."""
        weights = np.array(self.weights) / np.array(self.scale)
        bias = np.array(self.bias) - weights @ np.array(self.mean)
        found = weights.astype(np.float32) @ values + bias.astype(np.float32)[:, None]
        return np.asarray(found, np.float32)


class Model(_Part):
    """A learned detector; `threshold` is the least probability of a marked pixel."""

    format: Literal["uavmap detector"] = "uavmap detector"
    version: Literal[4] = 4
    features: Annotated[tuple[str, ...], Field(min_length=1)]
    working_width_px: Annotated[int, Field(ge=32, le=8000)] = 1000
    parts: Annotated[tuple[Logistic | Trees, ...], Field(min_length=1, max_length=4)]
    slope: Annotated[_Number, Field(gt=0)] = 1.0
    offset: _Number = 0.0
    """Offset of the calibration: probability = 1 / (1 + exp(-(slope logit + offset)))."""
    threshold: Annotated[_Number, Field(gt=0, lt=1)] = 0.5
    familiarity: Familiarity
    wrong_at_most: Annotated[_Number, Field(ge=0, le=1)]
    """Upper bound of the share of familiar cells that are judged wrong in another picture."""

    classes: ClassRule | None = None
    """Rule of a model that distinguishes classes of the region."""

    @model_validator(mode="after")
    def _fits(self) -> Model:
        if unknown := [name for name in self.features if name not in FEATURES]:
            raise ValueError(f"unknown feature {unknown[0]!r}")
        count = len(self.features)
        for part in self.parts:
            if isinstance(part, Logistic):
                if not len(part.mean) == len(part.scale) == len(part.weights) == count:
                    raise ValueError(f"a logistic part needs {count} means, scales and weights")
            elif any(f >= count for tree in part.trees for f in tree.feature):
                raise ValueError("a tree asks for a feature that the model does not have")
        if (rule := self.classes) is not None:
            rows = (rule.mean, rule.scale, *rule.weights)
            if {len(row) for row in rows} != {count} or (
                not len(rule.numbers) == len(rule.weights) == len(rule.bias)
            ):
                raise ValueError(f"each class needs {count} weights, and a bias")
        return self


def model_bytes(model: Model) -> bytes:
    """Return the file of a model; equal models give equal bytes."""
    return (json.dumps(model.model_dump(mode="json"), separators=(",", ":")) + "\n").encode()


def read_model(data: bytes, source: str) -> Model:
    """Return the model of a file. Raises `MissionFileError`, naming `source`, if it holds none.

    >>> read_model(b"{}", "model.json")
    Traceback (most recent call last):
    missions.errors.MissionFileError: model.json: not a detector's model that `uavmap tune`...
    """
    if len(data) > LARGEST_BYTES:
        raise MissionFileError(f"{source}: {len(data)} bytes; a model has at most {LARGEST_BYTES}")
    try:
        tables: Any = json.loads(data)
        if not isinstance(tables, Mapping) or tables.get("format") != FORMAT:
            raise MissionFileError(
                f"{source}: not a detector's model that `uavmap tune` has written"
            )
        if tables.get("version") != VERSION:
            raise MissionFileError(
                f"{source}: a model of version {tables.get('version')!r}; this uavmap reads "
                f"{VERSION}: train it again with `uavmap tune`"
            )
        return Model.model_validate(tables)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise MissionFileError(
            f"{source}: damaged: {where or 'model'}: {first['msg']}; train it again with "
            "`uavmap tune`"
        ) from None
    except (ValueError, RecursionError):
        raise MissionFileError(f"{source}: damaged, or no model of `uavmap tune`") from None


@dataclass(frozen=True, slots=True)
class Scorer:
    """The parts of a model with the tables of its trees, and its calibration."""

    parts: tuple[Logistic | Trees, ...]
    slope: float = 1.0
    offset: float = 0.0
    _tables: tuple[tuple[NDArray[np.float32], ...], ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        made = tuple(
            tuple(_table(tree) for tree in part.trees) if isinstance(part, Trees) else ()
            for part in self.parts
        )
        object.__setattr__(self, "_tables", made)

    def logit(self, values: Array) -> Array:
        """Return the mean of the parts before calibration, (n,), of features (count, n)."""
        total = np.zeros(values.shape[1], np.float32)
        for part, tables in zip(self.parts, self._tables, strict=True):
            if isinstance(part, Logistic):
                weights = np.array(part.weights) / np.array(part.scale)
                bias = part.bias - float(weights @ np.array(part.mean))
                logit = weights.astype(np.float32) @ values + np.float32(bias)
            else:
                logit = np.full(values.shape[1], part.base, np.float32)
                for tree, table in zip(part.trees, tables, strict=True):
                    logit += cv2.LUT(_left_over(tree, values), table)[0]
            total += sigmoid(logit)
        share = np.clip(total / len(self.parts), 1e-6, 1.0 - 1e-6)
        return np.asarray(np.log(share / (1.0 - share)), np.float32)

    def probability(self, values: Array) -> Array:
        """Return the probabilities, shape (n,), of features (count, n)."""
        return sigmoid(self.logit(values) * np.float32(self.slope) + np.float32(self.offset))


def _left_over(tree: Tree, values: Array) -> NDArray[np.uint8]:
    """Return the leaves that a tree's conditions do not rule out, (1, n), as bits."""
    left_over = np.full((1, values.shape[1]), 255, np.uint8)
    for feature, at_most, left in zip(tree.feature, tree.at_most, tree.left, strict=True):
        limit = np.array([np.float32(at_most)], np.float64)
        stay = np.asarray(cv2.compare(values[None, feature], limit, cv2.CMP_LE), np.uint8)
        # yes: all stay; no: the leaves on the left are ruled out
        left_over &= np.bitwise_or(stay, np.uint8(255 - left), out=stay)
    return left_over


def _table(tree: Tree) -> NDArray[np.float32]:
    """Return the worth of each set of leaves: that of its first leaf."""
    table = np.zeros(256, np.float32)
    for bits in range(1, 256):
        first = int(math.log2(bits & -bits))
        if first < len(tree.leaves):
            table[bits] = tree.leaves[first]
    return table


_UNLIKE: Final = 64
"""Approximate number of unfamiliar places of a picture that are kept."""
_EVERY: Final = 2
"""Step between compared places: familiarity changes slowly."""
_NEAREST: Final = cv2.INTER_NEAREST


@dataclass(frozen=True, slots=True)
class LearnedDetector:
    """Detector of a trained model, which uses colour, texture and surroundings.

    Attributes:
        model: The file of a model, or the model.
        threshold: Minimum probability of a marked pixel, 0 to 1; 0 for the model's own.
        classes: Classes that the model distinguishes; the probability is that of the explored ones.
    """

    name: ClassVar[str] = "learned"
    calibrated: ClassVar[bool] = True

    model: bytes | Model
    threshold: float = 0.0
    classes: Classes | None = None
    _model: Model = field(init=False, repr=False)
    _scorer: Scorer = field(init=False, repr=False)
    _familiar: Familiar = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_number("threshold", self.threshold, 0.0, 1.0)
        model = self.model
        if not isinstance(model, Model):
            model = read_model(model, "detector.model")
        scorer = Scorer(model.parts, model.slope, model.offset)
        numbers_known = () if model.classes is None else tuple(sorted(model.classes.numbers))
        if self.classes is not None and tuple(self.classes.names) != numbers_known:
            numbers = ", ".join(map(str, numbers_known)) or "none"
            raise MissionFileError(
                f"detector.classes has the numbers {', '.join(map(str, self.classes.names))}; the "
                f"model distinguishes: {numbers}"
            )
        object.__setattr__(self, "_model", model)
        object.__setattr__(self, "_scorer", scorer)
        object.__setattr__(self, "_familiar", Familiar.from_model(model.familiarity))

    def judged(self, image: NDArray[Any]) -> Judgement:
        """See `Judgement`. Raises `ImageError` for a picture without three channels."""
        size = (image.shape[1], image.shape[0])
        share, values, sums = self._described(image)
        some = values[: len(NAMES), ::_EVERY, ::_EVERY]
        region = share[::_EVERY, ::_EVERY] >= self._least
        some = np.ascontiguousarray(some).reshape(len(NAMES), -1)
        familiarity = self._familiar.familiarity(some, region.ravel())
        unlike = self._familiar.standardised(some[:, familiarity < UNFAMILIAR])
        familiarity = familiarity.reshape(region.shape)
        share, familiarity = (
            np.asarray(cv2.resize(one, size, interpolation=cv2.INTER_LINEAR), np.float32)
            for one in (share, familiarity)
        )
        marks = np.where(familiarity >= UNFAMILIAR, share, np.float32(0.0))
        unlike = unlike[:: max(1, len(unlike) // _UNLIKE)]
        if sums is None:
            return Judgement(marks, familiarity, unlike)
        of_class = cv2.resize(self._numbers[sums.argmax(axis=0)], size, interpolation=_NEAREST)
        classes = np.where(share >= np.float32(self._least), of_class, np.uint8(0))
        explored = cv2.resize(self._explored(sums), size, interpolation=cv2.INTER_LINEAR)
        marks = np.asarray(marks * explored, np.float32)
        return Judgement(marks, familiarity, unlike, classes)

    def probability(self, image: NDArray[Any]) -> NDArray[np.float32]:
        """See `Detector.probability`. Raises `ImageError` for a picture without three channels."""
        share, _, sums = self._described(image)
        size = (image.shape[1], image.shape[0])
        if sums is not None:
            share = share * self._explored(sums)
        return np.asarray(cv2.resize(share, size, interpolation=cv2.INTER_LINEAR), np.float32)

    def mask(self, image: NDArray[Any]) -> NDArray[np.uint8]:
        """See `Detector.mask`."""
        return marked(self.probability(image), self._least)

    def _described(self, image: NDArray[Any]) -> tuple[Array, Array, Array | None]:
        """Return probabilities of the described places, features `NAMES` first, sums of classes."""
        model = self._model
        picture = working_picture(image, model.working_width_px)
        names = (*NAMES, *(name for name in model.features if name not in NAMES))
        values = features(picture, names)
        of_model = values[[names.index(name) for name in model.features]]
        share = self._scorer.probability(of_model.reshape(len(of_model), -1))
        sums = None
        if self.classes is not None and model.classes is not None:
            sums = model.classes.sums(of_model.reshape(len(of_model), -1))
            sums = sums.reshape(-1, *values.shape[1:])
        return share.reshape(values.shape[1:]), values, sums

    @property
    def _numbers(self) -> NDArray[np.uint8]:
        """The numbers of the model's classes, in the order of their sums."""
        rule = self._model.classes
        return np.array(() if rule is None else rule.numbers, np.uint8)

    def _explored(self, sums: Array) -> Array:
        """Return the probability that a place of the region is of a class that is explored."""
        wanted = np.isin(self._numbers, () if self.classes is None else self.classes.explored)
        if wanted.all():
            return np.ones(sums.shape[1:], np.float32)
        powers = np.exp(sums - sums.max(axis=0))
        return np.asarray(powers[wanted].sum(axis=0) / powers.sum(axis=0), np.float32)

    @property
    def _least(self) -> float:
        return self.threshold or self._model.threshold
