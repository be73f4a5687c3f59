"""How much one picture has to say about a cell: the weight of its vote.

Three things make a look good, and the weight is their product, 0 to 1:

* coverage: the part of the cell that is in the picture;
* resolution: `n / (n + ENOUGH_PX)` with the cell's `n` pixels. Few pixels are uncertain, and of
  many more do not help, for what the detector takes wrongly it takes wrongly in all of them;
* obliqueness: the fourth power of the cosine of the angle from straight down. Seen aslant a cell
  is hidden by what stands on it, and lies beside its place by the tangent of that angle for each
  metre of height.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

ENOUGH_PX: Final = 64.0
"""A cell of so many pixels weighs half of what a perfectly resolved one does."""
HALF_SEEN: Final = 0.5
"""A cell of which less is in a picture gets no vote of it."""

Floats = NDArray[np.float64]


def weights(seen: Floats, corners_px: Floats, slant: Floats) -> Floats:
    """The weight of each cell's vote, shape (n,).

    Args:
        seen: The part of each cell that is in the picture, 0 to 1.
        corners_px: Its corners in the picture, shape (n, 4, 2), around it; NaN behind the camera,
            which weighs 0.
        slant: Of the line of sight, the way over the ground for a metre down: the tangent of the
            angle from straight down.

    >>> square = np.array([[[0, 0], [8, 0], [8, 8], [0, 8]]], float)
    >>> weights(np.array([1.0]), square, np.array([0.0])).tolist()
    [0.5]
    >>> weights(np.array([0.5]), square, np.array([1.0])).tolist()
    [0.0625]
    """
    x, y = corners_px[..., 0], corners_px[..., 1]
    twice = x * np.roll(y, -1, axis=-1) - y * np.roll(x, -1, axis=-1)
    pixels = np.abs(twice.sum(axis=-1)) / 2.0
    resolved = np.where(np.isfinite(pixels), pixels / (pixels + ENOUGH_PX), 0.0)
    found: Floats = seen * resolved / (1.0 + slant * slant) ** 2
    return found
