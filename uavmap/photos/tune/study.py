"""The painter's loop: paint, learn, look at the new map, paint the picture that it asks for."""

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
from uavmap.photos.tune.tune_job import MODEL, Wishes, tune
from vision.detectors.learned_model import LearnedDetector

_DOUBTFUL: Final = (0, 200, 255, 255)  # blue, green, red, opaque


@dataclass(frozen=True, slots=True)
class Round:
    """What the page shows of the loop.

    Attributes:
        busy: Whether a detector is learned now.
        text: What happens, or the outcome of the last round.
        number: Number of rounds that gave a map.
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
    """Learns from what is painted so far, in a thread of its own, one round at a time.

    A round learns the default kind of model only; `uavmap tune` compares all when the painting is
    over.
    """

    def __init__(self, images: Path, masks: Path, out: Path, wishes: Wishes) -> None:
        self._images, self._masks, self._out = images, masks, out
        self._wishes = Wishes(wishes.seed, wishes.width_px, wishes.cell_px, KINDS[:1], (*SETS,)[:1])
        self._drafts = Drafts(images)
        self._lock = threading.Lock()
        self._round = Round(False, "", 0, ())
        self._thread: threading.Thread | None = None

    @property
    def round(self) -> Round:
        """What the page shows now."""
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
                self._images, self._masks, self._out, self._wishes, self._show, self._drafts
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
        """Return the outlines of what is unfamiliar in a picture, PNG; None without a detector."""
        if not self._round.number:
            return None
        detector = LearnedDetector((self._out / MODEL).read_bytes())
        image = read_picture(picture, self._wishes.width_px)
        unfamiliar = detector.judged(image).unfamiliar
        drawn = np.zeros((*image.shape[:2], 4), np.uint8)
        if unfamiliar is not None:
            outline(drawn, unfamiliar, _DOUBTFUL)
        return cv2.imencode(".png", drawn)[1].tobytes()
