"""A segmentation model in the exchange format ONNX: its input and output.

`uavmap.load.detector_source` passes the function that runs the model (onnxruntime), so this package
needs neither files nor a runtime.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Final, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from missions.classes import Classes
from missions.errors import ImageError, MissionFileError
from vision.detectors.interface import Judgement, check_number, marked, sigmoid

Array = NDArray[np.float32]
Run = Callable[[Array], NDArray[Any]]
"""Function from a batch of tiles (1, channels, rows, columns) to the model's answer."""
_OVERLAP: Final = 8  # tiles share one part of this number with the next

_Three = tuple[float, float, float]


class OnnxSettings(BaseModel):
    """The settings of a model: the TOML file beside it."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    tile_px: Annotated[int, Field(ge=16, le=4096)]
    """Rows and columns of the model's input."""
    scale: Annotated[float, Field(gt=0, le=16)] = 1.0
    """Pixels of the model for one pixel of the picture."""
    order: Literal["rgb", "bgr"] = "rgb"
    mean: _Three = (0.0, 0.0, 0.0)
    """Mean of each channel, 0 to 1, which is subtracted, in the order of `order`."""
    std: Annotated[_Three, Field()] = (1.0, 1.0, 1.0)
    output: Literal["probability", "logit"] = "logit"
    """Kind of answer; a logit of one channel gets a sigmoid, logits of several a softmax."""
    channel: Annotated[int, Field(ge=0, le=1000)] = 0
    """Channel of the answer that is the ROI."""
    calibrated: bool = False
    """True if its probability is calibrated; see `Detector.calibrated`."""
    classes: Classes | None = None
    """Classes that the model distinguishes; their numbers are channels of the answer."""


@dataclass(frozen=True, slots=True)
class OnnxDetector:
    """Detector of a segmentation model, which runs tile by tile.

    Pixels are marked from the probability `threshold` on, 0 to 1. With `classes`, whose numbers are
    channels, that is the probability of all explored ones. A pixel is of the most probable class.
    """

    name: ClassVar[str] = "onnx"

    run: Run
    settings: OnnxSettings
    threshold: float = 0.5
    classes: Classes | None = None

    def __post_init__(self) -> None:
        check_number("threshold", self.threshold, 0.0, 1.0)
        if min(self.settings.std) <= 0.0:
            raise MissionFileError(f"std = {list(self.settings.std)}: expected numbers above 0")

    @property
    def calibrated(self) -> bool:
        """See `Detector.calibrated`."""
        return self.settings.calibrated

    def judged(self, image: NDArray[Any]) -> Judgement:
        """See `Judgement`."""
        if self.classes is None:
            share = self.probability(image)
            return Judgement(share if self.calibrated else marked(share, self.threshold))
        shares = self._shares(image)
        numbers = np.array(self._channels, np.uint8)
        some = shares.sum(axis=2) >= np.float32(self.threshold)
        classes = np.where(some, numbers[shares.argmax(axis=2)], np.uint8(0))
        share = self._explored(shares)
        marks = share if self.calibrated else marked(share, self.threshold)
        return Judgement(marks, classes=classes)

    def probability(self, image: NDArray[Any]) -> NDArray[np.float32]:
        """See `Detector.probability`. Raises `ImageError` for an answer of another shape."""
        return self._explored(self._shares(image))

    @property
    def _channels(self) -> tuple[int, ...]:
        """Channels of the answer that are read."""
        return (self.settings.channel,) if self.classes is None else tuple(self.classes.names)

    def _explored(self, shares: Array) -> Array:
        """Return the probability of the explored classes, of those of the channels."""
        if self.classes is not None:
            shares = shares[:, :, np.isin(self._channels, self.classes.explored)]
        return np.asarray(np.clip(shares.sum(axis=2), 0.0, 1.0), np.float32)

    def _shares(self, image: NDArray[Any]) -> Array:
        """Return the probabilities of the channels, (rows, columns, channels)."""
        rows, columns = image.shape[:2]
        picture = self._prepared(image)
        tall, wide = picture.shape[:2]
        total = np.zeros((tall, wide, len(self._channels)), np.float32)
        weight = np.zeros((tall, wide), np.float32)
        tile = self.settings.tile_px
        ramp = np.minimum(np.arange(tile) + 1, tile - np.arange(tile)).astype(np.float32)
        window = np.minimum(np.outer(ramp, ramp), np.float32(tile))  # seams fade into each other
        for top in _starts(tall, tile):
            for left in _starts(wide, tile):
                part = picture[top : top + tile, left : left + tile]
                share = self._share(np.ascontiguousarray(part.transpose(2, 0, 1)[None]))
                total[top : top + tile, left : left + tile] += share * window[:, :, None]
                weight[top : top + tile, left : left + tile] += window
        whole = (total / weight[:, :, None])[: self._tall(rows), : self._tall(columns)]
        found = cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_LINEAR)
        return np.asarray(found, np.float32).reshape(rows, columns, -1)

    def mask(self, image: NDArray[Any]) -> NDArray[np.uint8]:
        """See `Detector.mask`."""
        return marked(self.probability(image), self.threshold)

    def _tall(self, side_px: int) -> int:
        return max(1, round(side_px * self.settings.scale))

    def _prepared(self, image: NDArray[Any]) -> Array:
        """Scale and normalise a picture, and mirror it at the edges to at least a tile."""
        settings = self.settings
        size = (self._tall(image.shape[1]), self._tall(image.shape[0]))
        picture = image
        if size != (image.shape[1], image.shape[0]):
            how = cv2.INTER_AREA if settings.scale < 1.0 else cv2.INTER_LINEAR
            picture = cv2.resize(image, size, interpolation=how)
        if settings.order == "rgb":
            picture = picture[:, :, ::-1]
        most = 65535.0 if image.dtype == np.uint16 else 255.0
        values = picture.astype(np.float32) / np.float32(most)
        mean, std = (np.array(three, np.float32) for three in (settings.mean, settings.std))
        values = np.asarray((values - mean) / std, np.float32)
        below, right = (max(0, settings.tile_px - side) for side in values.shape[:2])
        if below or right:
            return np.pad(values, ((0, below), (0, right), (0, 0)), mode="symmetric")
        return values

    def _share(self, batch: Array) -> Array:
        """Return the probabilities of the channels in a tile, (rows, columns, channels)."""
        tile = self.settings.tile_px
        answer = np.asarray(self.run(batch), np.float32)
        if answer.ndim == 3:
            answer = answer[:, None]
        channels = list(self._channels)
        last = max(channels)
        if answer.ndim != 4 or answer.shape[2:] != (tile, tile) or last >= answer.shape[1]:
            raise ImageError(
                f"the model's answer has the shape {answer.shape}, for a tile of {tile} px and "
                f"channel {last}; is the TOML file beside it right?"
            )
        if self.settings.output == "probability":
            shares = answer[0, channels]
        elif answer.shape[1] == 1:
            shares = sigmoid(answer[0])
        else:
            powers = np.exp(answer[0] - answer[0].max(axis=0))
            shares = powers[channels] / powers.sum(axis=0)
        return np.asarray(shares.transpose(1, 2, 0), np.float32)


def _starts(side_px: int, tile_px: int) -> list[int]:
    """Return the starts of overlapping tiles, the last at the end.

    >>> _starts(100, 40), _starts(40, 40)
    ([0, 35, 60], [0])
    """
    step = tile_px - tile_px // _OVERLAP
    return [*range(0, max(side_px - tile_px, 0), step), max(side_px - tile_px, 0)]
