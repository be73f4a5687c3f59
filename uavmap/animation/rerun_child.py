"""The process that writes the Rerun recording of a flight under way: started by `.rerun_flight`.

At standard input come pickles of the program that flies: first the plan and the path, then events,
and frames with their pictures. At its end cells and tree follow from the events, and the file is
whole; so it is, too, where the flight's program has died. A line at standard output says that it
has begun, or why not.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, Final

import cv2
import numpy as np

from missions.errors import UavmapError
from missions.events import Event
from uavmap.animation.of_flight import film_of_flight, title_of
from uavmap.animation.rerun_recording import Recording

READY: Final = "ready"
_NICER: Final = 10
"""Who steers aircraft goes first."""
_JPEG_QUALITY: Final = 90


def main() -> None:
    """Write a recording until standard input ends."""
    out = os.dup(sys.stdout.fileno())
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what the SDK prints is no answer
    with contextlib.suppress(OSError):
        os.nice(_NICER)
    plan, path = pickle.load(sys.stdin.buffer)
    setting = plan.known_setting()
    title = title_of(setting.mission)
    try:
        recording = Recording(Path(path), title, setting.grid)
    except UavmapError as error:
        os.write(out, f"{error}\n".encode())
        return
    os.write(out, f"{READY}\n".encode())
    events: list[Event] = []
    for item in _told(sys.stdin.buffer):
        if isinstance(item, tuple):
            frame, picture = item
            recording.add_frame(frame, _file(picture))
        else:
            recording.take_in(item)
            events.append(item)
    film, _ = film_of_flight(setting, events, title)
    recording.finish(film)
    if not events:  # nobody has flown
        Path(path).unlink(missing_ok=True)


def _told(pipe: BinaryIO) -> Iterator[Any]:
    """What comes in, to its end."""
    with contextlib.suppress(EOFError, pickle.UnpicklingError):
        while True:
            yield pickle.load(pipe)


def _file(picture: bytes | np.ndarray[Any, Any]) -> bytes:
    """A picture as a file: as it came, or a JPEG of its pixels."""
    if isinstance(picture, bytes):
        return picture
    return cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1].tobytes()


if __name__ == "__main__":
    main()
