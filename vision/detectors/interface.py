"""What a detector is."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray


class Detector(Protocol):
    """Marks the pixels that look like the Region Of Interest.

    A detector is a function of the picture alone: the same picture gives the same mask.
    """

    @property
    def name(self) -> str:
        """The name by which a mission file asks for it."""
        ...

    def mask(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The ROI of a picture.

        Args:
            image: shape (rows, columns, 3), uint8, blue-green-red. It is left as it is.

        Returns:
            Shape (rows, columns), uint8: 255 where it looks like the ROI, else 0.
        """
        ...
