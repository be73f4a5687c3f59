"""A detector that `uavmap tune` has learned from painted examples."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.detectors.interface import marked
from vision.detectors.learned_model import Model, Scorer, read_model
from vision.detectors.limits import check_number
from vision.detectors.pixel_features import features, working_picture


@dataclass(frozen=True, slots=True)
class LearnedDetector:
    """The ROI is what a model takes for it by colour, texture and surroundings.

    Attributes:
        model: The file of a model, or the model.
        threshold: A pixel is marked from this probability on, 0 to 1; 0 takes the model's own.
    """

    name: ClassVar[str] = "learned"
    calibrated: ClassVar[bool] = True

    model: bytes | Model
    threshold: float = 0.0
    _scorer: Scorer = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Refuse what is no model, and a threshold out of range, with `MissionFileError`."""
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
