"""Recorded pixels as detectors take them: three bands of 8 bits."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

_OUTLIERS: Final = 0.5  # per cent at either end that may be defects
_NARROW: Final = 0.25
"""Samples of 16 bits that span less than this part of their range are spread over it."""


def eight_bits(image: NDArray[np.uint8] | NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Blue-green-red, 8 bits, of any picture that a source decodes.

    Of 16 bits the upper 8 are taken. A thermal sensor uses a few hundred of its 65,536 levels: such
    a picture is spread between its own darkest and brightest half per cent, so that levels are no
    temperatures any more, and the same ground may differ from picture to picture.

    >>> eight_bits(np.full((2, 2), 0x8000, np.uint16))[0, 0].tolist()
    [128, 128, 128]
    """
    narrow = np.asarray(image, dtype=np.uint8) if image.dtype == np.uint8 else _narrowed(image)
    if narrow.ndim == 2:
        narrow = np.asarray(cv2.cvtColor(narrow, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    return np.ascontiguousarray(narrow, dtype=np.uint8)


def _narrowed(image: NDArray[np.uint8] | NDArray[np.uint16]) -> NDArray[np.uint8]:
    low, high = (float(level) for level in np.percentile(image, (_OUTLIERS, 100.0 - _OUTLIERS)))
    if high - low >= _NARROW * 65535.0 or high <= low:
        return (image >> 8).astype(np.uint8)
    spread = (image.astype(np.float32) - low) * (255.0 / (high - low))
    return np.clip(np.round(spread), 0.0, 255.0).astype(np.uint8)
