"""Indices over the bands of a camera: plants, water, hot spots."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from missions.errors import ImageError, MissionFileError
from vision.detectors.interface import check_number, check_whole, marked, sigmoid

Kind = Literal["exg", "ndvi", "ndwi", "hot"]
_MAD: Final = 1.4826  # of a normal distribution, standard deviations in a median deviation
_MOST_BAND: Final = 31


@dataclass(frozen=True, slots=True)
class IndexDetector:
    """The ROI is on one side of a value of an index.

    | `kind` | index | range |
    |---|---|---|
    | `exg` | excess green: (2 green - red - blue) / (red + green + blue) | -1 to 2 |
    | `ndvi` | plants: (nir - red) / (nir + red) | -1 to 1 |
    | `ndwi` | water: (green - nir) / (green + nir) | -1 to 1 |
    | `hot` | hot spot: the mean of the bands, above the picture's median, in robust standard \
deviations | |

    A picture may have any number of bands, 8 or 16 bits; ratios need no scale.

    Attributes:
        kind: Which.
        value: The border, -100 to 100.
        side: Which side of it is the ROI: `"above"` or `"below"`.
        softness: How far beyond the border the probability is 0.73, 0.001 to 100.
        blue, green, red, nir: Which band of the picture that is, from 0. A colour picture has
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
            check_whole(key, getattr(self, key), _MOST_BAND)

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
