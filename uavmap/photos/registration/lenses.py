"""The lens of each picture, and its picture as a pinhole would have taken it."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from uavmap.photos.sources.picture_record import Picture
from vision.camera import Camera
from vision.lens import Lens, Straightening, straightening


@dataclass(slots=True)
class Lenses:
    """The lens of a picture: the calibration given, its tags', or a pinhole of `hfov_deg`."""

    hfov_deg: float
    given: Lens | None = None
    _plans: dict[Lens, Straightening] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __reduce__(self) -> tuple[object, ...]:
        """A lock does not travel, and plans are made anew."""
        return Lenses, (self.hfov_deg, self.given)

    def lens(self, picture: Picture) -> Lens:
        """Return the lens of the picture at its full size."""
        if lens := self.given or picture.lens:
            return lens
        return Lens.pinhole(math.radians(self.hfov_deg), picture.width_px, picture.height_px)

    def straightened(
        self, image: NDArray[np.uint8], lens: Lens
    ) -> tuple[NDArray[np.uint8], Camera]:
        """Return a decoded picture without distortion, and the pinhole that fits it."""
        rows, columns = image.shape[:2]
        if lens.is_pinhole:
            return image, Camera(lens.hfov_rad, columns, rows)
        plan = self._plan(lens.scaled(columns, rows))
        return plan.applied(image), plan.camera

    def _plan(self, lens: Lens) -> Straightening:
        # tags give each picture another focal length; a map of its own would be dear
        alike = replace(lens, fx_px=round(lens.fx_px, 1), fy_px=round(lens.fy_px, 1))
        with self._lock:
            plan = self._plans.get(alike)
            if plan is None:
                if len(self._plans) >= 4:
                    self._plans.clear()
                plan = self._plans[alike] = straightening(alike)
            return plan
