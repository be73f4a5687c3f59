"""A real lens: focal lengths, principal point and distortion, as in OpenCV."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

Model = Literal["brown", "fisheye"]
"""`brown`: k1 k2 p1 p2 [k3 [k4 k5 k6]]; `fisheye`: k1 k2 k3 k4 (Kannala-Brandt), as in OpenCV."""

_COUNTS = {"brown": (0, 4, 5, 8), "fisheye": (4,)}
_CENTRED = 1e-4  # of the width: a tenth of a pixel in a thousand


@dataclass(frozen=True, slots=True)
class Lens:
    """The intrinsics of a picture of `width_px` x `height_px`, in pixels; (0, 0) is a pixel's
    centre.

    Attributes:
        width_px: At least 1.
        height_px: At least 1.
        fx_px: Focal length along the columns, above 0.
        fy_px: Focal length along the rows, above 0.
        cx_px: Column of the principal point, inside the picture.
        cy_px: Row of the principal point, inside the picture.
        model: Meaning of `distortion`.
        distortion: Coefficients; none for a pinhole.

    >>> lens = Lens.pinhole(math.radians(90.0), 640, 480)
    >>> round(lens.fx_px, 6), lens.cx_px, round(math.degrees(lens.hfov_rad), 6)
    (320.0, 319.5, 90.0)
    """

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    model: Model = "brown"
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.width_px < 1 or self.height_px < 1:
            raise ValueError(f"a picture of {self.width_px} x {self.height_px} px has no pixels")
        numbers = (self.fx_px, self.fy_px, self.cx_px, self.cy_px, *self.distortion)
        if not all(map(math.isfinite, numbers)):
            raise ValueError("a lens has finite numbers")
        if self.fx_px <= 0.0 or self.fy_px <= 0.0:
            raise ValueError(f"focal lengths {self.fx_px:g}, {self.fy_px:g} px: must be above 0")
        inside = (
            -0.5 < self.cx_px < self.width_px - 0.5 and -0.5 < self.cy_px < self.height_px - 0.5
        )
        if not inside:
            raise ValueError(
                f"principal point ({self.cx_px:g}, {self.cy_px:g}) px outside of the picture of "
                f"{self.width_px} x {self.height_px} px"
            )
        if len(self.distortion) not in _COUNTS[self.model]:
            counts = ", ".join(map(str, _COUNTS[self.model]))
            raise ValueError(
                f"{len(self.distortion)} coefficients of distortion; the model {self.model} has "
                f"{counts}"
            )

    @classmethod
    def pinhole(cls, hfov_rad: float, width_px: int, height_px: int) -> Lens:
        """Return an undistorted lens, its axis through the middle; `ValueError` unless 0 < hfov <
        pi.
        """
        if not 0.0 < hfov_rad < math.pi:
            raise ValueError(f"hfov_rad is {hfov_rad:g}, expected 0 to pi, open")
        focal_px = width_px / 2.0 / math.tan(hfov_rad / 2.0)
        middle = ((width_px - 1) / 2.0, (height_px - 1) / 2.0)
        return cls(width_px, height_px, focal_px, focal_px, *middle)

    @property
    def hfov_rad(self) -> float:
        """Angle of view across the picture of a pinhole of the same focal length."""
        return 2.0 * math.atan(self.width_px / 2.0 / self.fx_px)

    @property
    def hfov_deg(self) -> float:
        """The same in degrees."""
        return math.degrees(self.hfov_rad)

    @property
    def is_pinhole(self) -> bool:
        """Whether the lens is a pinhole with square pixels, its axis in the middle."""
        return (
            self.model == "brown"
            and not any(self.distortion)
            and math.isclose(self.fx_px, self.fy_px, rel_tol=1e-4)
            and abs(self.cx_px - (self.width_px - 1) / 2.0) < _CENTRED * self.width_px
            and abs(self.cy_px - (self.height_px - 1) / 2.0) < _CENTRED * self.width_px
        )

    def scaled(self, width_px: int, height_px: int) -> Lens:
        """Return the lens of the same picture, scaled to another size.

        >>> half = Lens.pinhole(math.radians(90.0), 640, 480).scaled(320, 240)
        >>> round(half.fx_px, 6), half.cx_px
        (160.0, 159.5)
        """
        across, along = width_px / self.width_px, height_px / self.height_px
        return replace(
            self,
            width_px=width_px,
            height_px=height_px,
            fx_px=self.fx_px * across,
            fy_px=self.fy_px * along,
            cx_px=(self.cx_px + 0.5) * across - 0.5,
            cy_px=(self.cy_px + 0.5) * along - 0.5,
        )
