"""The ground beneath the cells of a live page, laid together of the pictures that come."""

from __future__ import annotations

from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

SIDE_PX: Final = 1600
"""The longer side of the mosaic."""
PAPER: Final = (243, 247, 247)
_QUALITY: Final = 80
_FAR: Final = 0.02
"""A pixel's weight falls from 1 in the middle of its picture to this at the rim."""

Image = NDArray[np.uint8]


class Mosaic:
    """A picture of the ground, north up, in which the finest and steepest view of a place shows.

    `place` is the rectangle that it covers, metres: `west`, `north`, `width_m`, `height_m`. `base`
    lies beneath, a JPEG of the same rectangle, or nothing.
    """

    def __init__(self, place: dict[str, float], base: bytes = b"") -> None:
        self._px_per_m = SIDE_PX / max(place["width_m"], place["height_m"])
        size = [max(1, round(place[side] * self._px_per_m)) for side in ("width_m", "height_m")]
        self._image: Image = np.full((size[1], size[0], 3), PAPER, np.uint8)
        if base:
            image = cv2.imdecode(np.frombuffer(base, np.uint8), cv2.IMREAD_COLOR)
            self._image = np.asarray(cv2.resize(np.asarray(image), size), np.uint8)
        self._weight = np.zeros(self._image.shape[:2], np.float32)
        self._metres = np.array(
            [
                [1.0 / self._px_per_m, 0.0, place["west"]],
                [0.0, -1.0 / self._px_per_m, place["north"]],
                [0.0, 0.0, 1.0],
            ]
        )

    def add(self, picture: Image, pixel_of_ground: NDArray[np.float64]) -> None:
        """Lay a picture, (rows, columns, 3) of blue-green-red, on the ground.

        `pixel_of_ground` leads from metres east and north to its pixels, 3 x 3.
        """
        rows, columns = picture.shape[:2]
        matrix = pixel_of_ground @ self._metres
        corners = np.array([[0, 0, 1], [columns, 0, 1], [columns, rows, 1], [0, rows, 1.0]])
        ground = corners @ np.linalg.inv(matrix).T
        if not ((ground[:, 2] > 0).all() or (ground[:, 2] < 0).all()):
            return  # a corner shows the sky
        at = ground[:, :2] / ground[:, 2:]
        high = np.minimum(np.ceil(at.max(axis=0)), self._weight.shape[::-1]).astype(int)
        low = np.maximum(np.floor(at.min(axis=0)), 0).astype(int)
        if (high <= low).any():
            return
        moved = matrix @ np.array([[1.0, 0.0, low[0]], [0.0, 1.0, low[1]], [0.0, 0.0, 1.0]])
        size = (int(high[0] - low[0]), int(high[1] - low[1]))
        how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        image = cv2.warpPerspective(picture, moved, size, flags=how)
        weight = cv2.warpPerspective(_steepness(rows, columns), moved, size, flags=how)
        weight *= rows * columns / cv2.contourArea(at.astype(np.float32))
        window = (slice(low[1], high[1]), slice(low[0], high[0]))
        better = weight > self._weight[window]
        self._image[window][better] = image[better]
        self._weight[window][better] = weight[better]

    def jpeg(self) -> bytes:
        """Return the mosaic so far."""
        return jpeg(self._image)


def jpeg(image: NDArray[Any]) -> bytes:
    """Return a picture of the ground as a page gets it."""
    return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()


def _steepness(rows: int, columns: int) -> NDArray[np.float32]:
    down = np.abs(np.linspace(-1.0, 1.0, rows, dtype=np.float32))[:, None]
    across = np.abs(np.linspace(-1.0, 1.0, columns, dtype=np.float32))[None, :]
    found: Any = np.maximum(1.0 - np.maximum(down, across), _FAR)
    return np.asarray(found, np.float32)
