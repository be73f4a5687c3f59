"""Judges the pictures of a mission: frame -> look(frame, grid, detector) -> FrameSeen."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal

from missions.errors import ImageError
from missions.events import FrameLost, FrameSeen
from uavmap.aircraft.cameras.source import decoded
from uavmap.aircraft.imaging.classifier import Classifier
from uavmap.aircraft.imaging.imaging import Taken
from uavmap.base.printable import printable
from uavmap.journal.kept_frames import Keeper, KeptFrame
from vision.projection import Frame


class PictureJudge:
    """Judges the pictures of every vehicle of a service, each by a classifier of its own."""

    def __init__(
        self, classifiers: Mapping[int, Classifier], keepers: Sequence[Keeper] = ()
    ) -> None:
        self._classifiers = classifiers
        self._keepers = keepers

    def verdict(self, taken: Taken) -> FrameSeen | FrameLost:
        """What a picture says of the cells around its vantage, or of all that it shows whole."""
        classifier = self._classifiers[taken.vehicle]
        camera = classifier.camera
        try:
            image = decoded(taken.data, taken.name, (camera.width_px, camera.height_px))
            hfov_deg = math.degrees(camera.hfov_rad)
            kept = KeptFrame("", taken.vehicle, taken.t_s, taken.pose, hfov_deg)
            for keeper in self._keepers:
                keeper.keep(kept, taken.data)
            frame = Frame(image, taken.pose, taken.t_s, camera)
            if taken.anywhere:
                votes = classifier.votes_anywhere(frame)
                overview: Literal[True] | None = True if classifier.is_overview(frame) else None
                return FrameSeen(taken.vehicle, taken.t_s, None, votes, overview=overview)
            here, votes = classifier.votes(frame, taken.vantage)
        except ImageError as error:
            return FrameLost(taken.vehicle, taken.t_s, printable(str(error)))
        return FrameSeen(taken.vehicle, taken.t_s, here, votes)
