"""What a detector is."""

from __future__ import annotations

from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

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
