"""A model that `uavmap tune` has learned: the features of a pixel, the model's file, its answer.

**Features.** A picture is brought to a working width, so that a feature means the same ground at
any resolution, and described on a grid of every `STRIDE`-th pixel. Colours are differences of
logarithms: a longer exposure adds a constant to each channel's logarithm, which the differences
lose; brightness is relative to the picture's median. Box filters and area means cost the same at
each scale.

**Model.** Its file is JSON, so reading one runs nothing that it holds. A model has one or two
parts, a logistic regression and boosted trees; its answer is the calibrated mean of theirs. A tree
has at most eight leaves: the leaves that its conditions leave over are eight bits of a byte, and a
table of 256 values gives their worth (QuickScorer, Lucchese and others, 2015), for all pixels at
once.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Final, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from missions.errors import ImageError, MissionFileError
from vision.detectors.interface import check_number, marked, sigmoid

Array = NDArray[np.float32]

STRIDE: Final = 4
"""Pixels of the working width between two described places."""
NEAR, AROUND, FAR = 5, 15, 45
"""Sides of the boxes over which features are averaged, in described places."""

_LOG: Final = np.log(np.arange(256, dtype=np.float32) + 6.0).astype(np.float32)
_LEAST: Final = 1e-4

GROUPS: Final[Mapping[str, tuple[str, ...]]] = {
    "color": (
        "light", "red_green", "blue_green", "green_excess", "saturation",
        "light_near", "red_green_near", "blue_green_near", "green_excess_near",
    ),
    "texture": (
        "detail", "detail_near", "detail_around", "rough_near", "rough_around",
        "line_near", "line_around",
    ),
    "context": (
        "light_around", "red_green_around", "blue_green_around", "green_excess_around",
        "light_beside", "red_green_beside", "blue_green_beside", "light_far_beside",
        "red_green_rest", "blue_green_rest", "green_excess_rest",
    ),
}  # fmt: skip
"""The features by group. `_near`, `_around`: the mean over a box; `_beside`: against the mean of
the surroundings; `_rest`: against the median of the picture.
"""

FEATURES: Final = tuple(name for names in GROUPS.values() for name in names)


def working_picture(image: NDArray[Any], width_px: int) -> NDArray[np.uint8]:
    """Return a picture at the working width, 8 bits; `ImageError` unless it has three channels."""
    if image.ndim != 3 or image.shape[2] != 3:
        raise ImageError(f"a learned detector needs 3 channels, the picture has {image.shape[2:]}")
    if image.dtype == np.uint16:
        image = (image >> 8).astype(np.uint8)
    rows, columns = image.shape[:2]
    if columns == width_px:
        return image.astype(np.uint8, copy=False)
    size = (width_px, max(STRIDE, round(rows * width_px / columns)))
    how = cv2.INTER_AREA if columns > width_px else cv2.INTER_LINEAR
    return cv2.resize(image, size, interpolation=how).astype(np.uint8, copy=False)


def described_shape(rows: int, columns: int) -> tuple[int, int]:
    """Return rows and columns of the described places of a working picture."""
    return max(1, rows // STRIDE), max(1, columns // STRIDE)


def features(picture: NDArray[np.uint8], names: Sequence[str] = FEATURES) -> Array:
    """Return the features of a working picture: (len(names), rows // STRIDE, columns // STRIDE).

    Args:
        picture: (rows, columns, 3), uint8, blue-green-red, at the working width.
        names: Some of `FEATURES`.
    """
    rows, columns = described_shape(*picture.shape[:2])
    size = (columns, rows)
    wanted = set(names)
    found = _colors(picture, size)
    if wanted & set(GROUPS["texture"]):
        found |= _texture(picture, size, found["light"])
    return np.stack([found[name] for name in names])


def _colors(picture: NDArray[np.uint8], size: tuple[int, int]) -> dict[str, Array]:
    logs = _shrunk(cv2.LUT(picture, _LOG), size)
    blue, green, red = (np.ascontiguousarray(logs[:, :, i]) for i in range(3))
    plain = cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    total = plain.sum(axis=2) + 3.0
    light = np.asarray(0.1 * blue + 0.6 * green + 0.3 * red, np.float32)
    light -= np.float32(np.median(light))
    base: dict[str, Array] = {
        "light": light,
        "red_green": red - green,
        "blue_green": blue - green,
        "green_excess": np.asarray(3.0 * plain[:, :, 1] / total - 1.0, np.float32),
    }
    found = dict(base)
    found["saturation"] = np.asarray(1.0 - 3.0 * plain.min(axis=2) / total, np.float32)
    for key, value in base.items():
        found[f"{key}_near"] = _box(value, NEAR)
        found[f"{key}_around"] = _box(value, AROUND)
        if key == "light":
            found["light_beside"] = found["light_near"] - found["light_around"]
            found["light_far_beside"] = found["light_near"] - _box(value, FAR)
        else:
            found[f"{key}_beside"] = found[f"{key}_near"] - _box(value, FAR)
            found[f"{key}_rest"] = found[f"{key}_near"] - np.float32(np.median(value))
    return found


def _texture(picture: NDArray[np.uint8], size: tuple[int, int], light: Array) -> dict[str, Array]:
    gray = cv2.LUT(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), _LOG)
    detail = _shrunk(np.abs(cv2.Laplacian(gray, cv2.CV_32F)), size)
    found = {"detail": _log(detail)}
    for key, side in (("near", NEAR), ("around", AROUND)):
        found[f"detail_{key}"] = _log(_box(detail, side))
        spread = _box(light * light, side) - _box(light, side) ** 2
        found[f"rough_{key}"] = _log(np.asarray(np.maximum(spread, 0.0), np.float32))
    across = np.asarray(cv2.Sobel(light, cv2.CV_32F, 1, 0), np.float32)
    along = np.asarray(cv2.Sobel(light, cv2.CV_32F, 0, 1), np.float32)
    for key, side in (("near", NEAR), ("around", AROUND)):
        xx, yy, xy = (_box(v, side) for v in (across * across, along * along, across * along))
        # 0: edges in all directions, as of leaves; 1: all in one, as of a road
        ratio = np.sqrt((xx - yy) ** 2 + 4.0 * xy * xy) / (xx + yy + np.float32(_LEAST))
        found[f"line_{key}"] = np.asarray(ratio, np.float32)
    return found


def _shrunk(values: NDArray[Any], size: tuple[int, int]) -> Array:
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA), np.float32)


def _box(values: Array, side: int) -> Array:
    return np.asarray(cv2.blur(values, (side, side), borderType=cv2.BORDER_REFLECT), np.float32)


def _log(values: Array) -> Array:
    return np.asarray(np.log(values + np.float32(_LEAST)), np.float32)


# --- the model -----------------------------------------------------------------------------------
FORMAT: Final = "uavmap detector"
VERSION: Final = 1
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


class Model(_Part):
    """A learned detector; `threshold` is the least probability of a marked pixel."""

    format: Literal["uavmap detector"] = "uavmap detector"
    version: Literal[1] = 1
    features: Annotated[tuple[str, ...], Field(min_length=1)]
    working_width_px: Annotated[int, Field(ge=32, le=8000)] = 1000
    parts: Annotated[tuple[Logistic | Trees, ...], Field(min_length=1, max_length=4)]
    slope: Annotated[_Number, Field(gt=0)] = 1.0
    offset: _Number = 0.0
    """Of the calibration: probability = 1 / (1 + exp(-(slope logit + offset)))."""
    threshold: Annotated[_Number, Field(gt=0, lt=1)] = 0.5

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
                raise ValueError("a tree asks for a feature that there is not")
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
    """A model with the tables of its trees."""

    model: Model
    _tables: tuple[tuple[NDArray[np.float32], ...], ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        made = tuple(
            tuple(_table(tree) for tree in part.trees) if isinstance(part, Trees) else ()
            for part in self.model.parts
        )
        object.__setattr__(self, "_tables", made)

    def logit(self, values: Array) -> Array:
        """Return the mean of the parts before calibration, (n,), of features (count, n)."""
        total = np.zeros(values.shape[1], np.float32)
        for part, tables in zip(self.model.parts, self._tables, strict=True):
            if isinstance(part, Logistic):
                weights = np.array(part.weights) / np.array(part.scale)
                bias = part.bias - float(weights @ np.array(part.mean))
                logit = weights.astype(np.float32) @ values + np.float32(bias)
            else:
                logit = np.full(values.shape[1], part.base, np.float32)
                for tree, table in zip(part.trees, tables, strict=True):
                    logit += table[_left_over(tree, values)]
            total += sigmoid(logit)
        share = np.clip(total / len(self.model.parts), 1e-6, 1.0 - 1e-6)
        return np.asarray(np.log(share / (1.0 - share)), np.float32)

    def probability(self, values: Array) -> Array:
        """Return of features (count, n) the probabilities, shape (n,)."""
        model = self.model
        return sigmoid(self.logit(values) * np.float32(model.slope) + np.float32(model.offset))


def _left_over(tree: Tree, values: Array) -> NDArray[np.uint8]:
    """Return the leaves that the answers to a tree's questions leave over, as bits."""
    left_over = np.full(values.shape[1], 255, np.uint8)
    for feature, at_most, left in zip(tree.feature, tree.at_most, tree.left, strict=True):
        no = values[feature] > np.float32(at_most)
        # yes: all stay; no: the leaves on the left are ruled out
        left_over &= ~(no.view(np.uint8) * np.uint8(left))
    return left_over


def _table(tree: Tree) -> NDArray[np.float32]:
    """Return the worth of each set of leaves: that of the first left over."""
    table = np.zeros(256, np.float32)
    for bits in range(1, 256):
        first = int(math.log2(bits & -bits))
        if first < len(tree.leaves):
            table[bits] = tree.leaves[first]
    return table


@dataclass(frozen=True, slots=True)
class LearnedDetector:
    """The ROI is what a model takes for it by colour, texture and surroundings.

    Attributes:
        model: The file of a model, or the model.
        threshold: Least probability of a marked pixel, 0 to 1; 0 takes the model's own.
    """

    name: ClassVar[str] = "learned"
    calibrated: ClassVar[bool] = True

    model: bytes | Model
    threshold: float = 0.0
    _scorer: Scorer = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_number("threshold", self.threshold, 0.0, 1.0)
        model = self.model
        if not isinstance(model, Model):
            model = read_model(model, "detector.model")
        object.__setattr__(self, "_scorer", Scorer(model))

    def probability(self, image: NDArray[Any]) -> NDArray[np.float32]:
        """See `Detector.probability`. Raises `ImageError` for a picture without three channels."""
        model = self._scorer.model
        values = features(working_picture(image, model.working_width_px), model.features)
        count, rows, columns = values.shape
        share = self._scorer.probability(values.reshape(count, -1)).reshape(rows, columns)
        size = (image.shape[1], image.shape[0])
        return np.asarray(cv2.resize(share, size, interpolation=cv2.INTER_LINEAR), np.float32)

    def mask(self, image: NDArray[Any]) -> NDArray[np.uint8]:
        """See `Detector.mask`."""
        return marked(self.probability(image), self.threshold or self._scorer.model.threshold)
