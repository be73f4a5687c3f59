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
from functools import partial
from typing import Annotated, Any, ClassVar, Final, Literal, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from missions.classes import Classes, ClassNumber
from missions.errors import MissionFileError
from vision.detectors.familiarity import NAMES, Familiar, Familiarity
from vision.detectors.interface import UNFAMILIAR, Judgement, check_number, marked, sigmoid
from vision.detectors.pixel_features import FEATURES, STRIDE, features, working_picture

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


class _Ready(NamedTuple):
    """A tree for many places at once.

    A condition is a feature, its largest value, and the leaves that a larger one rules out.
    `worth` is that of each set of leaves that are ruled out.
    """

    conditions: tuple[tuple[int, np.float32, np.uint8], ...]
    worth: NDArray[np.float32]

    @classmethod
    def from_tree(cls, tree: Tree) -> _Ready:
        """Make it: what is left over has the worth of its first leaf."""
        worth = np.zeros(256, np.float32)
        for ruled_out in range(255):
            first = int(math.log2(~ruled_out & (ruled_out + 1)))
            if first < len(tree.leaves):
                worth[ruled_out] = tree.leaves[first]
        at_most, left = np.array(tree.at_most, np.float32), np.array(tree.left, np.uint8)
        return cls(tuple(zip(tree.feature, at_most, left, strict=True)), worth)

    def ruled_out(self, values: Array) -> NDArray[np.uint8]:
        """Return the leaves that the conditions rule out, (1, n), as bits."""
        found = np.zeros((1, values.shape[1]), np.uint8)
        larger = np.empty(values.shape[1], np.bool_)
        bits = larger.view(np.uint8)
        for feature, at_most, left in self.conditions:
            np.greater(values[feature], at_most, out=larger)
            np.bitwise_or(found, np.multiply(bits, left, out=bits), out=found)
        return found


@dataclass(frozen=True, slots=True)
class Scorer:
    """The parts of a model with its trees made ready, and its calibration."""

    parts: tuple[Logistic | Trees, ...]
    slope: float = 1.0
    offset: float = 0.0
    _ready: tuple[tuple[_Ready, ...], ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        made = tuple(
            tuple(map(_Ready.from_tree, part.trees)) if isinstance(part, Trees) else ()
            for part in self.parts
        )
        object.__setattr__(self, "_ready", made)

    def logit(self, values: Array) -> Array:
        """Return the mean of the parts before calibration, (n,), of features (count, n)."""
        total = np.zeros(values.shape[1], np.float32)
        for part, trees in zip(self.parts, self._ready, strict=True):
            if isinstance(part, Logistic):
                weights = np.array(part.weights) / np.array(part.scale)
                bias = part.bias - float(weights @ np.array(part.mean))
                logit = weights.astype(np.float32) @ values + np.float32(bias)
            else:
                logit = np.full(values.shape[1], part.base, np.float32)
                for tree in trees:
                    logit += cv2.LUT(tree.ruled_out(values), tree.worth)[0]
            total += sigmoid(logit)
        share = np.clip(total / len(self.parts), 1e-6, 1.0 - 1e-6)
        return np.asarray(np.log(share / (1.0 - share)), np.float32)

    def probability(self, values: Array) -> Array:
        """Return the probabilities, shape (n,), of features (count, n)."""
        return sigmoid(self.logit(values) * np.float32(self.slope) + np.float32(self.offset))


_UNLIKE: Final = 64
"""Approximate number of unfamiliar places of a picture that are kept."""
_EVERY: Final = 2
"""Step between judged places: all but some features are means over more."""


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
        share, values, sums, picture_px = self._described(image)
        region = share >= self._least
        flat = values.reshape(len(values), -1)[: len(NAMES)]
        familiarity = self._familiar.familiarity(flat, region.ravel())
        unlike = self._familiar.standardised(flat[:, familiarity < UNFAMILIAR])
        unlike = unlike[:: max(1, len(unlike) // _UNLIKE)]
        columns, rows = (round(side / STRIDE) for side in picture_px)
        spread = partial(_interpolated, picture_px=picture_px, size=(columns, rows))
        share, familiarity = spread(share), spread(familiarity.reshape(region.shape))
        marks = np.where(familiarity >= UNFAMILIAR, share, np.float32(0.0))
        if sums is None:
            return Judgement(marks, familiarity, unlike)
        of_class = self._numbers[np.stack([spread(one) for one in sums]).argmax(axis=0)]
        classes = np.where(share >= np.float32(self._least), of_class, np.uint8(0))
        marks *= spread(self._explored(sums))
        return Judgement(marks, familiarity, unlike, classes)

    def probability(self, image: NDArray[Any]) -> NDArray[np.float32]:
        """See `Detector.probability`. Raises `ImageError` for a picture without three channels."""
        share, _, sums, picture_px = self._described(image)
        if sums is not None:
            share = share * self._explored(sums)
        return _interpolated(share, picture_px, (image.shape[1], image.shape[0]))

    def mask(self, image: NDArray[Any]) -> NDArray[np.uint8]:
        """See `Detector.mask`."""
        return marked(self.probability(image), self._least)

    def _described(self, image: NDArray[Any]) -> tuple[Array, Array, Array | None, tuple[int, int]]:
        """Return probabilities of the judged places, features `NAMES` first, sums of classes.

        The last are the columns and rows of the working picture.
        """
        model = self._model
        picture = working_picture(image, model.working_width_px)
        names = (*NAMES, *(name for name in model.features if name not in NAMES))
        values = features(picture, names, _EVERY)
        of_model = values[[names.index(name) for name in model.features]]
        of_model = of_model.reshape(len(of_model), -1)
        share = self._scorer.probability(of_model).reshape(values.shape[1:])
        sums = None
        if self.classes is not None and model.classes is not None:
            sums = model.classes.sums(of_model).reshape(-1, *values.shape[1:])
        return share, values, sums, (picture.shape[1], picture.shape[0])

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


def _interpolated(values: Array, picture_px: tuple[int, int], size: tuple[int, int]) -> Array:
    """Interpolate values of the judged places over a picture.

    Args:
        picture_px: Columns and rows of the working picture.
        size: Columns and rows of the result.
    """
    matrix = np.zeros((2, 3))
    for axis, (pixels, wanted) in enumerate(zip(picture_px, size, strict=True)):
        a_pixel = pixels / wanted
        matrix[axis, axis] = a_pixel / (STRIDE * _EVERY)
        # from the middle of the first pixel of the result to that of the first place
        matrix[axis, 2] = (a_pixel - STRIDE) / 2.0 / (STRIDE * _EVERY)
    how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    found = cv2.warpAffine(values, matrix, size, flags=how, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found, np.float32)
