"""One picture of a flight with the region that its detector finds."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from missions.events import Event, FrameSeen
from missions.flight.state import Setting, State
from uavmap.aircraft.imaging.classifier import detector_of
from uavmap.base import messages
from uavmap.base.atomic_write import write_bytes
from uavmap.base.image_files import decoded
from uavmap.journal.kept_frames import KeptFrame
from uavmap.output.drawing.judged import FILE, outlined
from uavmap.runner.operator.company import Onlooker

Taken = tuple[KeptFrame, bytes | NDArray[np.uint8]]


class JudgedPicture(Onlooker):
    """Writes the first picture, and then the first one with region, with the detector's region.

    It works in a thread that delays no frame. A flight that has `found` region keeps the old
    picture.
    """

    def __init__(self, folder: Path, setting: Setting, *, found: bool = False) -> None:
        self._path = folder / FILE
        self._mission = setting.mission
        self._log = messages.bound("uavmap.flight")
        self._waiting: dict[int, Taken] = {}
        self._found = found and self._path.exists()
        self._is_first = True
        self._worker = ThreadPoolExecutor(1, "judged-picture")

    def keep(self, frame: KeptFrame, picture: bytes | NDArray[np.uint8]) -> None:
        """Keep a picture until its verdicts come."""
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
        if self._found or self._is_first:
            self._is_first = False
            self._worker.submit(self._write, *taken)
        if self._found:
            self._waiting.clear()

    def end(self) -> None:
        """Wait for the end of a write."""
        self._worker.shutdown()

    def _write(self, frame: KeptFrame, picture: bytes | NDArray[np.uint8]) -> None:
        """Judge a picture once more, and write it."""
        ratio = max(frame.pose.height_m / self._mission.altitude_m(0), 1.0)
        try:
            image = decoded(picture, frame.frame)
            region = detector_of(self._mission, ratio).mask(image)
            write_bytes(self._path, outlined(image, region))
        except Exception as error:  # the flight is more important
            self._log.info(f"{self._path}: the judged picture is left out ({error})")
