"""The paper's detector: grayscale, threshold, dilate ("roi-exploration", field experiment)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import cv2
from numpy.typing import NDArray

from vision.detectors.limits import check_polarity, check_whole
from vision.detectors.mask_detector import MaskDetector


@dataclass(frozen=True, slots=True)
class ThresholdDetector(MaskDetector):
    """A pixel is bright when its gray value is above `intensity`.

    `"dark"` is the paper: the ROI is what stays dark after the bright pixels were dilated
    `dilations` times by 3 x 3, which fills the dark gaps of a bright surround. `"bright"` is its
    mirror: the ROI is bright, and what is dilated is again the surround, here the dark. So with
    either polarity a dilation makes the ROI smaller, by a pixel at each of its edges, and speckles
    of ROI in the surround vanish.

    Attributes:
        intensity: Gray value, 0 to 254.
        dilations: Passes of the 3 x 3 kernel, 0 to 255.
        polarity: Which side of `intensity` is the ROI.

    >>> import numpy as np
    >>> picture = np.full((9, 9, 3), 200, np.uint8)
    >>> picture[:, :5] = 90
    >>> int(ThresholdDetector(150, 2).mask(picture)[4].sum()) // 255
    3
    """

    name: ClassVar[str] = "threshold"

    intensity: int = 150
    dilations: int = 7
    polarity: Literal["dark", "bright"] = "dark"

    def __post_init__(self) -> None:
        """Refuse parameters out of range with `MissionFileError`, naming the key."""
        check_whole("intensity", self.intensity, 254)
        check_whole("dilations", self.dilations, 255)
        check_polarity(self.polarity)

    def _roi(self, image: NDArray[Any]) -> NDArray[Any]:
        gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        dark_roi = self.polarity == "dark"
        kind = cv2.THRESH_BINARY_INV if dark_roi else cv2.THRESH_BINARY
        return cv2.threshold(gray, self.intensity, 255, kind)[1]
