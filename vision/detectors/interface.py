"""What a detector is."""

from __future__ import annotations

from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from missions.errors import MissionFileError

Marks: TypeAlias = NDArray[np.uint8] | NDArray[np.float32]
"""Of a picture's pixels: a mask, 0 or 255, or a probability, 0 to 1."""


@runtime_checkable
class Detector(Protocol):
    """Marks the pixels that look like the Region Of Interest.

    A detector is a function of the picture alone: the same picture gives the same answers. A
    picture has the shape (rows, columns, channels): uint8 blue-green-red for all detectors; `index`
    and plug-ins may take other bands, and uint16. It is left as it is.

    One whose mask is smaller than the region by some pixels at each edge, because it takes off what
    is narrow, may have `shrinks_px` to say by how many: the region's boundary is drawn so much
    farther out.
    """

    @property
    def name(self) -> str:
        """The name by which a mission file asks for it."""

    @property
    def calibrated(self) -> bool:
        """Whether `probability` is one: of the pixels at 0.7, about 70 % are ROI.

        Then a cell's share of ROI is the mean over its pixels; else it is the part of them that
        the mask marks, as in the paper.
        """

    def probability(self, image: NDArray[Any]) -> NDArray[np.float32]:
        """How much each pixel looks like the ROI.

        Returns:
            Shape (rows, columns), float32, 0 to 1. `mask` marks a pixel where this is at least the
            detector's threshold. A detector that only says yes or no gives 1 and 0.
        """

    def mask(self, image: NDArray[Any]) -> NDArray[np.uint8]:
        """The ROI of a picture.

        Returns:
            Shape (rows, columns), uint8: 255 where it looks like the ROI, else 0.
        """


def certain(mask: NDArray[np.uint8]) -> NDArray[np.float32]:
    """The probability that a mask stands for, 1 or 0.

    >>> certain(np.array([[255, 0]], np.uint8)).tolist()
    [[1.0, 0.0]]
    """
    return (mask > 0).astype(np.float32)


def marked(probability: NDArray[np.float32], threshold: float) -> NDArray[np.uint8]:
    """255 where a probability is at least the threshold, else 0.

    >>> marked(np.array([[0.5, 0.4]], np.float32), 0.5).tolist()
    [[255, 0]]
    """
    return np.where(probability >= np.float32(threshold), np.uint8(255), np.uint8(0))


def check_whole(key: str, value: object, most: int) -> None:
    """Raise `MissionFileError`, naming the key, unless a parameter is an integer from 0 to `most`.

    >>> check_whole("dilations", -1, 255)
    Traceback (most recent call last):
    missions.errors.MissionFileError: detector.dilations is -1: expected an integer from 0 to 255
    """
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:
        raise MissionFileError(f"detector.{key} is {value!r}: expected an integer from 0 to {most}")


def check_number(key: str, value: object, least: float, most: float) -> None:
    """Raise `MissionFileError`, naming the key, unless a parameter is a number in a range.

    >>> check_number("softness", 3, 0.0, 2.0)
    Traceback (most recent call last):
    missions.errors.MissionFileError: detector.softness is 3: expected a number from 0 to 2
    """
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not number or not least <= value <= most:  # type: ignore[operator]
        raise MissionFileError(
            f"detector.{key} is {value!r}: expected a number from {least:g} to {most:g}"
        )


def check_polarity(value: object) -> None:
    """Raise `MissionFileError` unless a polarity is "dark" or "bright".

    >>> check_polarity("grey")
    Traceback (most recent call last):
    missions.errors.MissionFileError: detector.polarity is 'grey': expected 'dark' or 'bright'
    """
    if value not in ("dark", "bright"):
        raise MissionFileError(f"detector.polarity is {value!r}: expected 'dark' or 'bright'")
