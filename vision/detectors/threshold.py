"""Detectors that judge each pixel by its own values: gray levels, colours, indices over bands."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.errors import ImageError, MissionFileError
from vision.detectors.interface import (
    certain,
    check_number,
    check_polarity,
    check_whole,
    marked,
    sigmoid,
)

_KERNEL = np.ones((3, 3), np.uint8)


class MaskDetector(ABC):
    """Detector that decides each pixel; `dilations` of the surround remove speckles of ROI."""

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
        """Return ROI as 255, else 0, before dilations."""


@dataclass(frozen=True, slots=True)
class ThresholdDetector(MaskDetector):
    """The paper's detector: a pixel is bright if its gray value is above `intensity`.

    `"dark"` is the paper's: `dilations` of the bright pixels by 3 x 3 fill the dark gaps of a
    bright surround. The pixels that stay dark are ROI. `"bright"` is its mirror: the
    ROI is bright, and the dark surround is dilated. Either way a dilation makes the ROI smaller by
    a pixel at each edge, and speckles of ROI in the surround vanish.

    Attributes:
        intensity: Gray value, 0 to 254.
        dilations: Passes of the 3 x 3 kernel, 0 to 255.
        polarity: Side of `intensity` that is ROI.

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

    @property
    def words(self) -> str:
        """Description of its region."""
        side = "darker" if self.polarity == "dark" else "brighter"
        return f"{side} than {self.intensity} of 255"

    def _roi(self, image: NDArray[Any]) -> NDArray[Any]:
        gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        dark_roi = self.polarity == "dark"
        kind = cv2.THRESH_BINARY_INV if dark_roi else cv2.THRESH_BINARY
        return cv2.threshold(gray, self.intensity, 255, kind)[1]


@dataclass(frozen=True, slots=True)
class AdaptiveDetector(MaskDetector):
    """Detector of ROI by the difference of its gray value from the mean around it.

    Shadows of clouds and a changed exposure move the mean with the pixel. A region must be smaller
    than the window, or it is its own surround.

    Attributes:
        window: Side of the square of the mean, as a part of the picture's width, 0.01 to 2.
        offset: Minimum difference of ROI from the mean, 0 to 254 gray levels.
        polarity: Side of the mean that is ROI: `"dark"` or `"bright"`.
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

    @property
    def words(self) -> str:
        """Description of its region."""
        side = "darker" if self.polarity == "dark" else "brighter"
        return f"{side} than its surroundings by more than {self.offset} of 255"

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
    """Detector of bare ground among plants, which is lit and not green.

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

    @property
    def words(self) -> str:
        """Description of its region."""
        return f"bare ground: not green, and brighter than {self.intensity} of 255"

    def _roi(self, image: NDArray[Any]) -> NDArray[Any]:
        # 3 G - (R + G + B) < greenness (R + G + B), as one sum over the bands. Only its sign
        # counts, so it may saturate: a level of an 8-bit result is a 64th of a level here.
        rest = 64.0 * (1.0 + self.greenness)
        grey = cv2.transform(image, np.array([[rest, rest - 192.0, rest]]))
        _, lit = cv2.threshold(
            cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), self.intensity, 255, cv2.THRESH_BINARY
        )
        _, roi = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY)
        return cv2.bitwise_and(roi, lit)


# --- indices over bands --------------------------------------------------------------------------
Kind = Literal["exg", "ndvi", "ndwi", "hot"]
_MAD: Final = 1.4826  # of a normal distribution, standard deviations in a median deviation
_MAX_BAND: Final = 31


@dataclass(frozen=True, slots=True)
class IndexDetector:
    """Detector of ROI on one side of a value of an index.

    Each `kind` has an index:

    * `exg`: excess green: (2 green - red - blue) / (red + green + blue), from -1 to 2;
    * `ndvi`: plants: (nir - red) / (nir + red), from -1 to 1;
    * `ndwi`: water: (green - nir) / (green + nir), from -1 to 1;
    * `hot`: hot spot: the mean of the bands, above the picture's median, in robust standard
      deviations.

    A picture may have any number of bands, 8 or 16 bits; ratios need no scale.

    Attributes:
        kind: Index.
        value: Border, -100 to 100.
        side: Side of the border that is ROI: `"above"` or `"below"`.
        softness: Distance beyond the border at which the probability is 0.73, 0.001 to 100.
        blue, green, red, nir: Number of that band in the picture, from 0. A colour picture has
            blue 0, green 1, red 2.

    >>> wheat, soil = (40, 160, 60), (60, 90, 120)
    >>> IndexDetector(kind="exg", value=0.2).mask(np.array([[wheat, soil]], np.uint8)).tolist()
    [[255, 0]]
    """

    name: ClassVar[str] = "index"
    calibrated: ClassVar[bool] = False

    kind: Kind = "exg"
    value: float = 0.1
    side: Literal["above", "below"] = "above"
    softness: float = 0.05
    blue: int = 0
    green: int = 1
    red: int = 2
    nir: int = 3

    def __post_init__(self) -> None:
        if self.kind not in get_args(Kind):
            raise MissionFileError(
                f"detector.kind is {self.kind!r}: expected one of {', '.join(get_args(Kind))}"
            )
        if self.side not in ("above", "below"):
            raise MissionFileError(f"detector.side is {self.side!r}: expected 'above' or 'below'")
        check_number("value", self.value, -100.0, 100.0)
        check_number("softness", self.softness, 0.001, 100.0)
        for key in ("blue", "green", "red", "nir"):
            check_whole(key, getattr(self, key), _MAX_BAND)

    @property
    def words(self) -> str:
        """Description of its region."""
        return f"index {self.kind} {self.side} {self.value:g}"

    def probability(self, image: NDArray[Any]) -> NDArray[np.float32]:
        """See `Detector.probability`. Raises `ImageError` if the picture lacks a band."""
        away = (self._index(image) - np.float32(self.value)) / np.float32(self.softness)
        if self.side == "below":
            away = -away
        return sigmoid(away)

    def mask(self, image: NDArray[Any]) -> NDArray[np.uint8]:
        """See `Detector.mask`."""
        return marked(self.probability(image))

    def _index(self, image: NDArray[Any]) -> NDArray[np.float32]:
        if self.kind == "hot":
            level = np.asarray(image.mean(axis=2, dtype=np.float32), np.float32)
            median = np.float32(np.median(level))
            spread = np.float32(_MAD * np.median(np.abs(level - median)))
            return _ratio(level - median, spread)
        if self.kind == "exg":
            green = self._band(image, "green")
            total = self._band(image, "red") + green + self._band(image, "blue")
            return _ratio(3.0 * green - total, total)
        more, less = ("nir", "red") if self.kind == "ndvi" else ("green", "nir")
        one, other = self._band(image, more), self._band(image, less)
        return _ratio(one - other, one + other)

    def _band(self, image: NDArray[Any], key: str) -> NDArray[np.float32]:
        number: int = getattr(self, key)
        if number >= image.shape[2]:
            raise ImageError(
                f"detector.{key} = {number}: the picture has {image.shape[2]} bands, counted from 0"
            )
        return np.asarray(image[:, :, number], np.float32)


def _ratio(above: NDArray[np.float32], below: Any) -> NDArray[np.float32]:
    """Divide; a divisor below 1, as of black, counts as 1."""
    return np.asarray(above / np.maximum(below, np.float32(1.0)), np.float32)
