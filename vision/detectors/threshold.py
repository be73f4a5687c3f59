"""Detectors that mark pixels by a threshold and then make the ROI smaller."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.detectors.interface import certain, check_number, check_polarity, check_whole

_KERNEL = np.ones((3, 3), np.uint8)


class MaskDetector(ABC):
    """Says yes or no for each pixel; `dilations` of the surround remove speckles of ROI."""

    __slots__ = ()
    calibrated: ClassVar[bool] = False

    dilations: int

    @property
    def shrinks_px(self) -> int:
        """Pixels by which `mask` is smaller than the ROI at each of its edges."""
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


@dataclass(frozen=True, slots=True)
class ThresholdDetector(MaskDetector):
    """The paper's: a pixel is bright when its gray value is above `intensity`.

    `"dark"` is the paper: the ROI is what stays dark after `dilations` of the bright pixels by 3 x
    3, which fill the dark gaps of a bright surround. `"bright"` is its mirror: the ROI is bright,
    and the dark surround is dilated. Either way a dilation makes the ROI smaller by a pixel at each
    edge, and speckles of ROI in the surround vanish.

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
        check_whole("intensity", self.intensity, 254)
        check_whole("dilations", self.dilations, 255)
        check_polarity(self.polarity)

    def _roi(self, image: NDArray[Any]) -> NDArray[Any]:
        gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        dark_roi = self.polarity == "dark"
        kind = cv2.THRESH_BINARY_INV if dark_roi else cv2.THRESH_BINARY
        return cv2.threshold(gray, self.intensity, 255, kind)[1]


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
    """

    name: ClassVar[str] = "adaptive"

    window: float = 0.25
    offset: int = 12
    polarity: Literal["dark", "bright"] = "dark"
    dilations: int = 1

    def __post_init__(self) -> None:
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


@dataclass(frozen=True, slots=True)
class PavedDetector(MaskDetector):
    """The ROI is bare ground among plants: lit and not green.

    Greenness is the excess green index (Woebbecke and others, 1995), (2 G - R - B) / (R + G + B),
    -1 to 2. As a ratio it keeps its value under another exposure, unlike brightness. Green or dark
    pixels are the surround, and are dilated as in `ThresholdDetector`.

    Attributes:
        greenness: The ROI's greenness is below this, -1 to 2.
        intensity: The ROI's gray value is above this, 0 to 254: shadows and water have hardly any
            colour.
        dilations: Passes of the 3 x 3 kernel on the surround, 0 to 255.
    """

    name: ClassVar[str] = "paved"

    greenness: float = 0.04
    intensity: int = 90
    dilations: int = 1

    def __post_init__(self) -> None:
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
