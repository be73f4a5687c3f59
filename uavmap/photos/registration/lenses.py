"""The camera of each picture, and its picture as a pinhole would have taken it."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from missions.mission.schema import Mission
from uavmap.photos.sources.picture_record import Picture
from vision.camera import Camera
from vision.lens import Lens
from vision.straighten import Straightening, straightening


@dataclass(slots=True)
class Lenses:
    """The lens of a picture: the calibration given, else that of its tags, else the mission's.

    Attributes:
        given: A calibration for all pictures, which is scaled to their sizes.
    """

    given: Lens | None = None
    _plans: dict[Lens, Straightening] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __reduce__(self) -> tuple[object, ...]:
        """A lock does not travel, and plans are made anew."""
        return Lenses, (self.given,)

    def lens(self, picture: Picture, mission: Mission) -> Lens:
        """The lens of the picture at its full size."""
        lens = self.given or picture.lens
        if lens is None:
            hfov_rad = math.radians(mission.camera.hfov_deg)
            lens = Lens.pinhole(hfov_rad, picture.width_px, picture.height_px)
        return lens

    def straightened(
        self, image: NDArray[np.uint8], picture: Picture, mission: Mission
    ) -> tuple[NDArray[np.uint8], Camera]:
        """A decoded picture without the distortion of its lens, and the pinhole that fits it."""
        rows, columns = image.shape[:2]
        lens = self.lens(picture, mission)
        if lens.is_pinhole:
            return image, Camera(lens.hfov_rad, columns, rows)
        plan = self._plan(lens.scaled(columns, rows))
        return plan.applied(image), plan.camera

    def _plan(self, lens: Lens) -> Straightening:
        # the focal length of a tag is not quite the same in each picture; a map of its own is dear
        alike = replace(lens, fx_px=round(lens.fx_px, 1), fy_px=round(lens.fy_px, 1))
        with self._lock:
            plan = self._plans.get(alike)
            if plan is None:
                if len(self._plans) >= 4:
                    self._plans.clear()
                plan = self._plans[alike] = straightening(alike)
            return plan
