"""Bare ground among plants: asphalt, concrete, gravel, rock, by how little green it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.errors import MissionFileError
from vision.detectors.interface import certain
from vision.detectors.limits import check_whole

_KERNEL = np.ones((3, 3), np.uint8)


@dataclass(frozen=True, slots=True)
class PavedDetector:
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
    calibrated: ClassVar[bool] = False

    greenness: float = 0.04
    intensity: int = 90
    dilations: int = 1

    def __post_init__(self) -> None:
        """Refuse parameters out of range with `MissionFileError`, naming the key."""
        check_whole("intensity", self.intensity, 254)
        check_whole("dilations", self.dilations, 255)
        number = isinstance(self.greenness, (int, float)) and not isinstance(self.greenness, bool)
        if not number or not -1.0 <= self.greenness <= 2.0:
            raise MissionFileError(
                f"detector.greenness is {self.greenness!r}: expected a number from -1 to 2"
            )

    @property
    def shrinks_px(self) -> int:
        """By how many pixels `mask` is smaller than the ROI at each of its edges."""
        return self.dilations

    def probability(self, image: NDArray[np.uint8]) -> NDArray[np.float32]:
        """See `Detector.probability`: 1 in the mask, else 0."""
        return certain(self.mask(image))

    def mask(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """See `Detector.mask`."""
        # 3 G - (R + G + B) < greenness (R + G + B), as one sum over the bands; only its sign is
        # asked, so that it may saturate: a level of an 8-bit result is a 64th of a level here
        rest = 64.0 * (1.0 + self.greenness)
        grey = cv2.transform(image, np.array([[rest, rest - 192.0, rest]]))
        _, lit = cv2.threshold(
            cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), self.intensity, 255, cv2.THRESH_BINARY
        )
        _, roi = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY)
        roi = cv2.bitwise_and(roi, lit)
        if self.dilations:
            roi = cv2.erode(roi, _KERNEL, iterations=self.dilations)
        return np.asarray(roi, dtype=np.uint8)
