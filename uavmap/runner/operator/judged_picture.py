"""Keeps one picture of a flight with what its detector takes for region."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.errors import UavmapError
from missions.events import Event, FrameSeen
from missions.flight.state import Setting, State
from uavmap.aircraft.imaging.classifier import detector_of
from uavmap.base.atomic_write import write_bytes
from uavmap.base.image_files import decoded
from uavmap.journal.kept_frames import KeptFrame
from uavmap.output.drawing.judged import FILE, outlined
from uavmap.runner.operator.company import Onlooker

_LOG: Final = logging.getLogger("uavmap.flight")
Taken = tuple[KeptFrame, bytes | NDArray[np.uint8]]


class JudgedPicture(Onlooker):
    """Writes the first picture with region, else the first one, at the end of a flight. Nothing is
    decoded or drawn before: aircraft fly then. A resumed flight keeps the old picture."""

    def __init__(self, folder: Path, setting: Setting) -> None:
        self._path = folder / FILE
        self._mission = setting.mission
        self._waiting: dict[int, Taken] = {}
        self._chosen: Taken | None = None
        self._found = self._path.exists()

    def keep(self, frame: KeptFrame, picture: bytes | NDArray[np.uint8]) -> None:
        """Remember a picture until its verdicts come."""
        if not self._found:
            self._waiting[frame.vehicle] = frame, picture

    def update(self, event: Event, state: State, again: int) -> None:
        """Choose a picture by its verdicts."""
        if self._found or not isinstance(event, FrameSeen):
            return
        taken = self._waiting.pop(event.vehicle, None)
        if taken is None or taken[0].t_s != event.t_s:
            return
        self._found = any(vote.positive for vote in event.votes)
        if self._found or self._chosen is None:
            self._chosen = taken
        if self._found:
            self._waiting.clear()

    def end(self) -> None:
        """Judge the picture once more, and write it."""
        if self._chosen is None:
            return
        frame, picture = self._chosen
        mission, self._chosen = self._mission, None
        ratio = max(frame.pose.height_m / mission.altitude_m(0), 1.0)
        try:
            image = decoded(picture, frame.frame)
            region = detector_of(mission, ratio).mask(image)
            write_bytes(self._path, outlined(image, region))
        except (UavmapError, OSError) as error:
            _LOG.info(f"{self._path}: the judged picture is left out ({error})")
