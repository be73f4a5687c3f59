"""A Rerun recording of a flight under way, from the side of the flight.

A process beside it writes the file. It is told by a thread from a queue, so that neither a slow
disk nor a fault of the SDK ever holds up, or ends, what steers aircraft: what the queue has no room
for is left out, which is told at the end.
"""

from __future__ import annotations

import contextlib
import pickle
import queue
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from missions.errors import OutputError
from missions.events import Event
from missions.state import Setting, State
from uavmap.animation import check_path
from uavmap.animation.rerun_child import READY
from uavmap.animation.rerun_recording import SUFFIX, sdk
from uavmap.child_process import Child
from uavmap.fly.onlooker import Onlooker, Steered
from uavmap.fly.progress import Progress
from uavmap.record.flight_plan import FlightPlan
from uavmap.record.frames import KeptFrame

WAITING: Final = 5000
"""So many events and pictures may wait to be written."""
WAITING_BYTES: Final = 64 << 20
"""... and pictures of so many bytes."""
ROOM_S: Final = 10.0
"""So long a flight that is simulated waits for room, real seconds: nobody is in the air."""
END_S: Final = 60.0
"""So long its end is waited for, real seconds."""
ENDED: Final = "its process has ended"


def check_recording(path: Path) -> None:
    """Raise `OutputError` for a name that does not end in .rrd, or where rerun-sdk is missing."""
    check_path(path, (SUFFIX,))
    sdk()


@contextlib.contextmanager
def recorded(
    path: Path, plan: FlightPlan, progress: Progress, onlooker: Onlooker | None
) -> Iterator[FlightRecorder]:
    """A recording of the flight within the context, for who else hears of it and looks on.

    Raises `OutputError`, before anything flies, for a name that does not end in .rrd, where
    rerun-sdk is missing, and where the file cannot be written.
    """
    check_recording(path)
    recorder = FlightRecorder(path, plan, progress, onlooker)
    try:
        yield recorder
    finally:
        recorder.close()


class FlightRecorder:
    """Passes on what a flight tells, and records it: a `Progress` and an `Onlooker`."""

    def __init__(
        self, path: Path, plan: FlightPlan, inner: Progress, onlooker: Onlooker | None
    ) -> None:
        self._path = path
        self._inner, self._onlooker = inner, onlooker
        self._wait_s = ROOM_S if plan.simulated else 0.0
        self._queue: queue.Queue[Any] = queue.Queue(WAITING)
        self._lock = threading.Lock()
        self._bytes = 0
        """Of the pictures that wait."""
        self._left_out = 0
        self._dead = self._told = False
        self._child = Child("uavmap.animation.rerun_child", "rerun")
        self._writer = threading.Thread(target=self._write, name="rerun", daemon=True)
        self._writer.start()
        self._put((plan, str(path)))
        said = self._child.stdout.readline().decode(errors="replace").strip()
        if said != READY:
            self._queue.put(None)
            self._child.process.wait()
            why = said or self._child.last_words(END_S) or ENDED
            raise OutputError(f"the Rerun recording does not begin: {why}")

    # --- progress --------------------------------------------------------------------------
    def say(self, text: str) -> None:
        """A line that stays."""
        self._inner.say(text)

    def begin(self, setting: Setting, *, again: bool) -> None:
        """The flight starts."""
        self._inner.begin(setting, again=again)

    def update(self, event: Event, state: State, again: int) -> None:
        """An event was taken in."""
        self._inner.update(event, state, again)
        self._put(event)

    def end(self) -> None:
        """The flight is over."""
        self._inner.end()

    # --- onlooker --------------------------------------------------------------------------
    def look_back(self, setting: Setting, event: Event, state: State) -> None:
        """What a flight that is gone on with has brought before."""
        if self._onlooker is not None:
            self._onlooker.look_back(setting, event, state)
        self._put(event)

    def keep(self, frame: KeptFrame, picture: bytes | NDArray[np.uint8]) -> None:
        """A picture is about to be judged."""
        if self._onlooker is not None:
            self._onlooker.keep(frame, picture)
        size = len(picture) if isinstance(picture, bytes) else picture.nbytes
        with self._lock:
            if self._bytes + size > WAITING_BYTES and not self._wait_s:
                self._left_out += 1
                return
            self._bytes += size
        self._put((frame, picture), size)

    def hand(
        self, service: Steered, say: Callable[[str], None]
    ) -> contextlib.AbstractContextManager[None]:
        """Nothing of its own: no orders come from a recording."""
        if self._onlooker is not None:
            return self._onlooker.hand(service, say)
        return contextlib.nullcontext()

    # --- out -------------------------------------------------------------------------------
    def _put(self, item: Any, size: int = 0) -> None:
        if self._dead:
            self._tell()
        else:
            try:
                self._queue.put((item, size), self._wait_s > 0.0, self._wait_s or None)
                return
            except queue.Full:
                self._left_out += 1
        with self._lock:
            self._bytes -= size

    def _write(self) -> None:
        pipe = self._child.stdin
        try:
            while (waiting := self._queue.get()) is not None:
                item, size = waiting
                with self._lock:
                    self._bytes -= size
                pickle.dump(item, pipe, protocol=pickle.HIGHEST_PROTOCOL)
                pipe.flush()
        except Exception:  # a pipe that is closed, or what cannot be packed: no flight ends by it
            self._dead = True
        finally:
            with contextlib.suppress(OSError, ValueError):
                pipe.close()

    def _tell(self) -> None:
        if not self._told:
            self._told = True
            why = self._child.last_words() or ENDED
            self._inner.say(
                f"the Rerun recording has failed ({why}); the flight goes on "
                "without it, and `uavmap animate DIR --rerun FILE.rrd` makes one of its results"
            )

    # --- over ------------------------------------------------------------------------------
    def close(self) -> None:
        """Have it made whole; says where it is, or that it is not."""
        say, path = self._inner.say, self._path
        try:
            with contextlib.suppress(queue.Full):
                self._queue.put(None, timeout=END_S)
            code = self._child.process.wait(END_S)
        except (subprocess.TimeoutExpired, KeyboardInterrupt):
            say(f"{path} is still being written, by process {self._child.process.pid}")
            return
        self._child.close(END_S)
        if self._left_out:
            say(f"{self._left_out} events or pictures are not in {path}: it could not keep up")
        if code or self._dead:
            self._tell()
        elif path.exists():
            say(f"recording in {path}")
