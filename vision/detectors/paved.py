"""Bare ground among plants: asphalt, concrete, gravel, rock, by how little green it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.detectors.limits import check_number, check_whole
from vision.detectors.mask_detector import MaskDetector


@dataclass(frozen=True, slots=True)
class PavedDetector(MaskDetector):
    """The ROI is lit and not green.

    Greenness is the excess green index (Woebbecke and others, 1995), (2 G - R - B) / (R + G + B),
    -1 to 2. It is a ratio, so that it keeps its value where a camera exposes one picture longer
    than the next, which a threshold on brightness does not. Green or dark pixels are the surround,
    and are dilated as in `ThresholdDetector`.

    Attributes:
        greenness: The ROI's greenness is below this, -1 to 2.
        intensity: The ROI's gray value is above this, 0 to 254: shadows and water have no colour
            to speak of.
        dilations: Passes of the 3 x 3 kernel on the surround, 0 to 255.

    >>> gray, grass = (160, 160, 160), (60, 150, 110)
    >>> PavedDetector(dilations=0).mask(np.array([[gray, grass]], np.uint8)).tolist()
    [[255, 0]]
    """

    name: ClassVar[str] = "paved"

    greenness: float = 0.04
    intensity: int = 90
    dilations: int = 1

    def __post_init__(self) -> None:
        """Refuse parameters out of range with `MissionFileError`, naming the key."""
        check_whole("intensity", self.intensity, 254)
        check_whole("dilations", self.dilations, 255)
        check_number("greenness", self.greenness, -1.0, 2.0)

    def _roi(self, image: NDArray[Any]) -> NDArray[Any]:
        # 3 G - (R + G + B) < greenness (R + G + B), as one sum over the bands; only its sign is
        # asked, so that it may saturate: a level of an 8-bit result is a 64th of a level here
        rest = 64.0 * (1.0 + self.greenness)
        grey = cv2.transform(image, np.array([[rest, rest - 192.0, rest]]))
        _, lit = cv2.threshold(
            cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), self.intensity, 255, cv2.THRESH_BINARY
        )
        _, roi = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY)
        return cv2.bitwise_and(roi, lit)
