"""The painter's loop: paint, learn, read the new map, paint the next picture."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from missions.errors import UavmapError
from uavmap.output.drawing.judged import outline
from uavmap.photos.draft_map import MAP, Drafts
from uavmap.photos.next_pictures import Next
from uavmap.photos.tune.examples import read_picture
from uavmap.photos.tune.selection import KINDS, SETS
from uavmap.photos.tune.tune_job import MODEL, TuneSettings, tune
from vision.detectors.learned_model import LearnedDetector

_NEAREST: Final = cv2.INTER_NEAREST
_DOUBTFUL: Final = (0, 200, 255, 255)  # blue, green, red, opaque


@dataclass(frozen=True, slots=True)
class Round:
    """State of the loop for the page.

    Attributes:
        busy: True while a detector is learned.
        text: The step under way, or the outcome of the last round.
        number: Number of rounds with a map.
        asked: The pictures to paint next.
    """

    busy: bool
    text: str
    number: int
    asked: Sequence[Next]

    def as_json(self) -> dict[str, Any]:
        """Return it for the page."""
        return {
            "busy": self.busy,
            "text": self.text,
            "number": self.number,
            "asked": [[Path(one.picture).stem, round(one.area_m2)] for one in self.asked],
        }


class Study:
    """Learns from the painted examples, in a thread of its own, one round at a time.

    A round learns the default kind of model only. `uavmap tune` compares all kinds when the
    painting is over.
    """

    def __init__(self, images: Path, masks: Path, out: Path, settings: TuneSettings) -> None:
        self._images, self._masks, self._out = images, masks, out
        self._settings = TuneSettings(
            settings.seed, settings.width_px, settings.cell_px, KINDS[:1], (*SETS,)[:1]
        )
        self._drafts = Drafts(images)
        self._lock = threading.Lock()
        self._round = Round(False, "", 0, ())
        self._thread: threading.Thread | None = None

    @property
    def round(self) -> Round:
        """Current state for the page."""
        return self._round

    def learn(self) -> bool:
        """Begin a round; return False while one is under way."""
        with self._lock:
            if self._round.busy:
                return False
            self._show("learning", busy=True)
            self._thread = threading.Thread(target=self._learn, name="learn", daemon=True)
            self._thread.start()
        return True

    def finish(self) -> None:
        """Wait until the round that is under way is over."""
        if self._thread is not None:
            self._thread.join()

    def _learn(self) -> None:
        try:
            report = tune(
                self._images, self._masks, self._out, self._settings, self._show, self._drafts
            )
        except UavmapError as error:
            self._show(str(error), busy=False)
            return
        except Exception as error:
            self._show(f"the round has failed: {type(error).__name__}: {error}", busy=False)
            raise
        asked = self._drafts.asked
        number = self._round.number + 1
        text = f"cells IoU {report['cells']['iou']:.2f} on pictures that it was not learned from"
        self._round = Round(False, text, number, asked)

    def _show(self, text: str, *, busy: bool = True) -> None:
        self._round = Round(busy, text, self._round.number, self._round.asked)

    def map(self) -> bytes | None:
        """Return the picture of the last map, PNG; None before there is one."""
        path = self._out / MAP
        return path.read_bytes() if self._round.number and path.is_file() else None

    def doubtful(self, picture: Path) -> bytes | None:
        """Return outlines of unfamiliar ground in a picture, PNG; None without a detector."""
        if not self._round.number:
            return None
        detector = LearnedDetector((self._out / MODEL).read_bytes())
        image = read_picture(picture, self._settings.width_px)
        unfamiliar = detector.judged(image).unfamiliar
        drawn = np.zeros((*image.shape[:2], 4), np.uint8)
        if unfamiliar is not None:
            size = (image.shape[1], image.shape[0])
            outline(drawn, cv2.resize(unfamiliar, size, interpolation=_NEAREST), _DOUBTFUL)
        return cv2.imencode(".png", drawn)[1].tobytes()
