"""Pictures of a real lens as a pinhole would have taken them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.camera import Camera
from vision.lens import Lens

_WIDEST_RAD = math.radians(150.0)
"""Widest pinhole: a wider one shows more of its picture's rim than of the ground."""
_EDGE_STEPS = 33
_TOUCH_PX = 1e-4


@dataclass(frozen=True, slots=True)
class Straightening:
    """Where each pixel of the pinhole's picture is found in the lens's."""

    camera: Camera
    columns: NDArray[np.float32]
    rows: NDArray[np.float32]

    def applied(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return a picture of the lens as its pinhole would have taken it, of `camera`'s size."""
        straight = cv2.remap(
            image, self.columns, self.rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(straight, dtype=np.uint8)


def straightening(lens: Lens) -> Straightening:
    """Return the pinhole of a lens, and the map to its pictures.

    Its axis and picture size are the lens's. All of its picture lies inside the lens's: corners are
    left out, nothing is made up.

    >>> plan = straightening(Lens.pinhole(math.radians(80.0), 640, 480))
    >>> round(math.degrees(plan.camera.hfov_rad), 3)
    80.0
    """
    width_px, height_px = lens.width_px, lens.height_px
    focal_px = _focal_px(lens)
    camera = Camera(2.0 * math.atan(width_px / 2.0 / focal_px), width_px, height_px)
    u, v = np.meshgrid(
        np.arange(width_px, dtype=np.float64), np.arange(height_px, dtype=np.float64)
    )
    x = (u - (width_px - 1) / 2.0) / focal_px
    y = (v - (height_px - 1) / 2.0) / focal_px
    pixels = distorted(lens, np.stack([x, y], axis=-1).reshape(-1, 2))
    pixels = pixels.reshape(height_px, width_px, 2).astype(np.float32)
    return Straightening(
        camera, np.ascontiguousarray(pixels[..., 0]), np.ascontiguousarray(pixels[..., 1])
    )


def distorted(lens: Lens, rays: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return pixels of rays (x, y, 1), x to the right and y down; shape (n, 2) both."""
    matrix = np.array([[lens.fx_px, 0, lens.cx_px], [0, lens.fy_px, lens.cy_px], [0, 0, 1.0]])
    coefficients = np.array(lens.distortion or (0.0,) * 4)
    if lens.model == "fisheye":
        found = cv2.fisheye.distortPoints(rays.reshape(-1, 1, 2), matrix, coefficients)
    else:
        along = np.column_stack([rays, np.ones(len(rays))])
        none = np.zeros(3)
        found, _ = cv2.projectPoints(along, none, none, matrix, coefficients)
    return np.asarray(found, dtype=np.float64).reshape(-1, 2)


def _focal_px(lens: Lens) -> float:
    """Return the shortest focal length at which the pinhole's rim lies in the lens's picture."""
    width_px, height_px = lens.width_px, lens.height_px
    across = np.linspace(-0.5, width_px - 0.5, _EDGE_STEPS) - (width_px - 1) / 2.0
    along = np.linspace(-0.5, height_px - 0.5, _EDGE_STEPS) - (height_px - 1) / 2.0
    left, top = np.full(_EDGE_STEPS, across[0]), np.full(_EDGE_STEPS, along[0])
    rim = np.concatenate(
        [
            np.column_stack(side)
            for side in ((across, top), (across, -top), (left, along), (-left, along))
        ]
    )

    low_px = -0.5 - _TOUCH_PX
    right_px, bottom_px = width_px + low_px + 2 * _TOUCH_PX, height_px + low_px + 2 * _TOUCH_PX

    def inside(focal_px: float) -> bool:
        # all of the way out to the rim: a polynomial may turn back on itself
        for part in (0.25, 0.5, 0.75, 1.0):
            u, v = distorted(lens, rim * part / focal_px).T
            within = (u >= low_px) & (u <= right_px) & (v >= low_px) & (v <= bottom_px)
            if not bool(within.all()):
                return False
        return True

    low = width_px / 2.0 / math.tan(_WIDEST_RAD / 2.0)
    high = 20.0 * max(lens.fx_px, lens.fy_px)
    for _ in range(50):
        middle = (low + high) / 2.0
        low, high = (low, middle) if inside(middle) else (middle, high)
    return high
