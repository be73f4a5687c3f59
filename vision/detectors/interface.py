"""The interface of detectors, and checks of their parameters."""

from __future__ import annotations

from typing import Any, Final, NamedTuple, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from missions.errors import MissionFileError

Marks: TypeAlias = NDArray[np.uint8] | NDArray[np.float32]
"""Marks of a picture's pixels: a mask, 0 or 255, or a probability, 0 to 1."""


UNFAMILIAR: Final = 0.05
"""Familiarity below which a pixel is unlike all that the detector knows."""
UNSURE: Final = 0.5
"""Minimum share of unfamiliar pixels that leaves a cell unsure."""


class Judgement(NamedTuple):
    """The judgement of a picture, place by place, each (rows, columns).

    A place is a pixel, or a part of the whole picture that is larger.

    Attributes:
        marks: Basis of cells' shares: a calibrated probability, else the mask. An unfamiliar place
            is not region.
        familiarity: Likeness of each place to what the detector knows, 0 to 1, float32; None for a
            detector without examples, to which all ground is familiar.
        unlike: Standardised features of some unfamiliar places, (places, features).
        classes: Number of each place's class, uint8; 0 for none. An unfamiliar place has the class
            that it resembles. None for a detector of one class.
    """

    marks: Marks
    familiarity: NDArray[np.float32] | None = None
    unlike: NDArray[np.float32] | None = None
    classes: NDArray[np.uint8] | None = None

    @property
    def unfamiliar(self) -> NDArray[np.uint8] | None:
        """Places that are unlike all that the detector knows: 255, else 0."""
        return None if self.familiarity is None else ~marked(self.familiarity, UNFAMILIAR)


@runtime_checkable
class Detector(Protocol):
    """Marks the pixels that look like the Region Of Interest.

    A detector is a function of the picture alone, which it leaves as it is. A picture has the shape
    (rows, columns, channels): uint8 blue-green-red for all detectors; `index` and plug-ins may take
    other bands, and uint16. Parameters out of range raise `MissionFileError`, naming the key.

    If its mask is smaller than the region by some pixels at each edge, `shrinks_px` may give that
    number: the region's boundary is drawn farther out by as many. `words` may describe its region,
    to follow "region = ". `judged(image)` may return a `Judgement` with unfamiliar pixels and the
    class of each pixel. A detector with the parameter `classes` (`missions.classes.Classes`)
    distinguishes several classes, and marks those that are explored.
    """

    @property
    def name(self) -> str:
        """Name in a mission file."""

    @property
    def calibrated(self) -> bool:
        """True if `probability` is calibrated: about 70 % of the pixels at 0.7 are ROI.

        Then a cell's share of ROI is the mean over its pixels. Otherwise it is the share that the
        mask marks, as in the paper.
        """

    def probability(self, image: NDArray[Any]) -> NDArray[np.float32]:
        """Return the likeness of each pixel to the ROI: (rows, columns), float32, 0 to 1.

        `mask` marks a pixel where this is at least the detector's threshold.
        """

    def mask(self, image: NDArray[Any]) -> NDArray[np.uint8]:
        """Return the ROI of a picture: (rows, columns), uint8, 255 for ROI, else 0."""


def judged(detector: Detector, image: NDArray[Any]) -> Judgement:
    """Return a detector's judgement of a picture."""
    knows = getattr(detector, "judged", None)
    if knows is not None:
        found: Judgement = knows(image)
        return found
    return Judgement(detector.probability(image) if detector.calibrated else detector.mask(image))


def sigmoid(logit: NDArray[Any]) -> NDArray[np.float32]:
    """Return the probability of a logit."""
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(logit, -30.0, 30.0))), np.float32)


def certain(mask: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return the probability that a mask stands for, 1 or 0."""
    return (mask > 0).astype(np.float32)


def marked(probability: NDArray[np.float32], threshold: float = 0.5) -> NDArray[np.uint8]:
    """Return 255 where a probability is at least the threshold, else 0."""
    return np.where(probability >= np.float32(threshold), np.uint8(255), np.uint8(0))


def check_whole(key: str, value: object, most: int) -> None:
    """Raise `MissionFileError` unless a parameter is an integer from 0 to `most`."""
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:
        raise MissionFileError(f"detector.{key} is {value!r}: expected an integer from 0 to {most}")


def check_number(key: str, value: object, least: float, most: float) -> None:
    """Raise `MissionFileError` unless a parameter is a number in a range."""
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not number or not least <= value <= most:  # type: ignore[operator]
        raise MissionFileError(
            f"detector.{key} is {value!r}: expected a number from {least:g} to {most:g}"
        )


def check_polarity(value: object) -> None:
    """Raise `MissionFileError` unless a polarity is "dark" or "bright"."""
    if value not in ("dark", "bright"):
        raise MissionFileError(f"detector.polarity is {value!r}: expected 'dark' or 'bright'")
