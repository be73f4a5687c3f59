"""What detectors share that mark pixels by a threshold and then make the ROI smaller."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.detectors.interface import certain

_KERNEL = np.ones((3, 3), np.uint8)


class MaskDetector(ABC):
    """Says yes or no for each pixel; `dilations` of the surround remove speckles of ROI."""

    __slots__ = ()
    calibrated: ClassVar[bool] = False

    dilations: int

    @property
    def shrinks_px(self) -> int:
        """By how many pixels `mask` is smaller than the ROI at each of its edges."""
        return self.dilations

    def probability(self, image: NDArray[Any]) -> NDArray[np.float32]:
        """See `Detector.probability`: 1 in the mask, else 0."""
        return certain(self.mask(image))

    def mask(self, image: NDArray[Any]) -> NDArray[np.uint8]:
        """See `Detector.mask`."""
        roi = self._roi(image)
        if self.dilations:
            # eroding the ROI is dilating its surround; past the picture's edge neither grows
            roi = cv2.erode(roi, _KERNEL, iterations=self.dilations)
        return np.asarray(roi, dtype=np.uint8)

    @abstractmethod
    def _roi(self, image: NDArray[Any]) -> NDArray[Any]:
        """Mark the ROI by 255, else 0, before dilations."""
