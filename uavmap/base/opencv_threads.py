"""OpenCV without threads of its own."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from typing import Final

import cv2


@dataclass(slots=True)
class _OneThreadEach:
    """Disables OpenCV's own threads, which would compete with ours.

    Several may work at the same time: the last one restores OpenCV's threads.
    """

    at_work: int = 0
    before: int = 0
    lock: threading.Lock = field(default_factory=threading.Lock)

    def __enter__(self) -> None:
        with self.lock:
            if not self.at_work:
                self.before = cv2.getNumThreads()
                cv2.setNumThreads(1)
            self.at_work += 1

    def __exit__(self, *_: object) -> None:
        with self.lock:
            self.at_work -= 1
            if not self.at_work:
                cv2.setNumThreads(self.before)


ONE_THREAD_EACH: Final = _OneThreadEach()
