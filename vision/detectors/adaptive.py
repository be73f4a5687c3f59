"""Darker or brighter than what lies around it: a threshold that follows light and exposure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.detectors.limits import check_number, check_polarity, check_whole
from vision.detectors.mask_detector import MaskDetector


@dataclass(frozen=True, slots=True)
class AdaptiveDetector(MaskDetector):
    """A pixel is ROI when its gray value differs from the mean around it.

    Shadows of clouds and a changed exposure move the mean with the pixel. A region must be smaller
    than the window, or it is its own surround.

    Attributes:
        window: Side of the square of the mean, as a part of the picture's width, 0.01 to 2.
        offset: Gray levels by which the pixel is beyond the mean, 0 to 254.
        polarity: On which side: `"dark"` or `"bright"`.
        dilations: Passes of the 3 x 3 kernel on the surround, 0 to 255.

    >>> picture = np.full((20, 20, 3), 180, np.uint8)
    >>> picture[8:12, 8:12] = 90
    >>> int(AdaptiveDetector(window=1.0, dilations=0).mask(picture).sum()) // 255
    16
    """

    name: ClassVar[str] = "adaptive"

    window: float = 0.25
    offset: int = 12
    polarity: Literal["dark", "bright"] = "dark"
    dilations: int = 1

    def __post_init__(self) -> None:
        """Refuse parameters out of range with `MissionFileError`, naming the key."""
        check_number("window", self.window, 0.01, 2.0)
        check_whole("offset", self.offset, 254)
        check_whole("dilations", self.dilations, 255)
        check_polarity(self.polarity)

    def _roi(self, image: NDArray[Any]) -> NDArray[Any]:
        gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        side = max(3, round(self.window * gray.shape[1]) | 1)
        mean = cv2.blur(gray, (side, side), borderType=cv2.BORDER_REPLICATE)
        difference = gray.astype(np.int16) - mean
        if self.polarity == "dark":
            difference = -difference
        return np.where(difference > self.offset, np.uint8(255), np.uint8(0))
