"""A device or stream of continuous pictures, dated one by one, reopened at its end."""

from __future__ import annotations

import asyncio
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

from missions.errors import ImageError, LinkError
from uavmap.aircraft.cameras.captures import Capture, Open
from uavmap.aircraft.cameras.source import Announcement, Loaded, LocalSource
from uavmap.base.image_files import decoded

SHORTEST_STALL_S: Final = 0.3
STALL_SPACINGS: Final = 4.0
"""Duration of a stall in usual spacings; at least `SHORTEST_STALL_S`."""
BURST_SHARE: Final = 0.5
"""Share of the usual spacing below which frames follow each other as a backlog."""
MAX_BACKLOG_S: Final = 3.0
"""Maximum duration of a backlog, for any spacing, s."""
_SHARE: Final = 0.1


class Freshness:
    """The check that a frame arrives when it should, and is not one of a backlog.

    After a stall of the network a stream delivers its backlog, frame upon frame. Such frames are of
    an earlier moment, and would be placed at the vehicle's present position.
    """

    def __init__(self) -> None:
        self._last_s: float | None = None
        self._usual_s: float | None = None
        self._stalled_s: float | None = None
        """Time when the backlog began, None without one."""

    def fresh(self, there_s: float) -> bool:
        """Note a frame; return whether it is fresh."""
        last_s, self._last_s = self._last_s, there_s
        if last_s is None:
            return True
        gap_s = there_s - last_s
        if self._usual_s is None:
            self._usual_s = gap_s
            return True
        if gap_s > max(SHORTEST_STALL_S, STALL_SPACINGS * self._usual_s):
            self._stalled_s = there_s
            return False
        if self._stalled_s is not None:
            piled_up = gap_s < BURST_SHARE * self._usual_s
            if piled_up and there_s - self._stalled_s < MAX_BACKLOG_S:
                return False
            self._stalled_s = None
        self._usual_s += _SHARE * (gap_s - self._usual_s)
        return True


REOPEN_S: Final = 1.0
"""Wait before a stream that ended is reopened, s."""
SILENT_S: Final = 8.0
"""Maximum silence of a reader, s; then it hangs: it is abandoned, and another one is begun."""
FIRST_PICTURE_WAIT_S: Final = 20.0
"""Maximum wait for the first picture, s."""
JOIN_S: Final = 2.0
"""Maximum wait for a thread to end, s."""
MAX_HELD_PICTURES: Final = 6
"""Maximum number of pictures that wait to be judged; the oldest are dropped."""
_LOG_INTERVAL_S: Final = 10.0
_WAITING: Final = 2

Wants = Callable[[float], bool]
Log = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class RawFrame:
    """A frame of a stream, with the time of its arrival on the loop's clock."""

    there_s: float
    loaded: Loaded | ImageError


class ThreadReader:
    """Reads a capture in a thread: grabs every frame, decodes the wanted ones, keeps the newest."""

    def __init__(self, open_capture: Open) -> None:
        self._open_capture = open_capture
        self._capture: Capture | None = None
        self._thread: threading.Thread | None = None
        self._over = threading.Event()
        self._frames: deque[RawFrame] = deque(maxlen=_WAITING)
        self._news = asyncio.Event()
        self._ended = False
        self._received_s = 0.0

    async def open(self, wants: Wants) -> None:
        """Open it, in its thread; `wants` selects frames to decode by time. Raises `LinkError`."""
        loop = asyncio.get_running_loop()
        opened: asyncio.Future[None] = loop.create_future()
        over = self._over = threading.Event()
        self._frames.clear()
        self._ended = False

        def tell(function: Callable[[], None]) -> None:
            if not over.is_set():
                loop.call_soon_threadsafe(function)

        def settle(error: LinkError | None) -> None:
            if opened.done():
                return
            if error is None:
                opened.set_result(None)
            else:
                opened.set_exception(error)

        def read() -> None:
            try:
                capture = self._open_capture()
            except LinkError as error:
                tell(partial(settle, error))
                return
            self._capture = capture
            watch, settled_s = Freshness(), time.monotonic() + capture.settle_s
            tell(partial(settle, None))
            try:
                while not over.is_set() and capture.grab():
                    there_s = loop.time()
                    good = watch.fresh(there_s) and time.monotonic() >= settled_s
                    frame = _retrieved(capture, there_s) if good and wants(there_s) else None
                    tell(partial(self._put, over, there_s, frame))
            finally:
                capture.close()
                tell(lambda: self._end(over))

        self._thread = threading.Thread(target=read, name="camera", daemon=True)
        self._thread.start()
        await opened
        self._received_s = loop.time()

    def _put(self, over: threading.Event, there_s: float, frame: RawFrame | None) -> None:
        if over is self._over:
            self._received_s = there_s
            if frame is not None:
                self._frames.append(frame)
            self._news.set()

    def _end(self, over: threading.Event) -> None:
        if over is self._over:
            self._ended = True
            self._news.set()

    async def next(self) -> RawFrame | None:
        """Return the next wanted frame; None when the stream has ended."""
        while not self._frames:
            if self._ended:
                return None
            self._news.clear()
            left_s = self._received_s + SILENT_S - asyncio.get_running_loop().time()
            try:
                async with asyncio.timeout(max(left_s, 0.0)):
                    await self._news.wait()
            except TimeoutError:
                return None
        return self._frames.popleft()

    async def close(self) -> None:
        """Close it; it may be reopened. The thread ends with its present wait."""
        self._over.set()
        capture, self._capture = self._capture, None
        if capture is not None:
            capture.interrupt()
        if self._thread is not None:  # a hanging one is abandoned
            await asyncio.to_thread(self._thread.join, JOIN_S)


def _retrieved(capture: Capture, there_s: float) -> RawFrame:
    try:
        return RawFrame(there_s, capture.retrieve())
    except ImageError as error:
        return RawFrame(there_s, error)


class StreamSource(LocalSource):
    """Frames of a stream, dated by their arrival, less `latency_s`."""

    def __init__(
        self, name: str, reader: ThreadReader, latency_s: float, size_px: tuple[int, int], say: Log
    ) -> None:
        super().__init__(latency_s)
        self._name = name
        self._reader = reader
        self._size_px = size_px
        self._log_line = say
        self._first = False
        self._number = 0
        self._held: OrderedDict[int, Loaded | ImageError] = OrderedDict()
        self._logged_s = float("-inf")

    async def begin(self) -> None:
        """Open it and check a picture. Raises `LinkError` if it is not as configured."""
        self._first = True
        await self._reader.open(self._wants)
        try:
            async with asyncio.timeout(FIRST_PICTURE_WAIT_S):
                frame = await self._reader.next()
        except TimeoutError:
            frame = None
        finally:
            self._first = False
        if frame is None:
            await self._reader.close()
            raise LinkError(f"{self._name}: is open, but no picture comes")
        try:
            if isinstance(frame.loaded, ImageError):
                raise frame.loaded
            decoded(frame.loaded, self._name, self._size_px)
        except ImageError as error:
            await self._reader.close()
            raise LinkError(
                f"{error}; set camera.width_px and camera.height_px to what it gives"
            ) from None

    def _wants(self, there_s: float) -> bool:
        return self._first or self._cadence.wants(there_s - self._latency_s)

    async def run(self) -> None:
        """Announce its frames until cancelled, and reopen it at its end. `begin` comes first."""
        try:
            while True:
                while (frame := await self._reader.next()) is not None:
                    self._keep_frame(frame)
                await self._reader.close()
                self._log(f"{self._name}: no more pictures come; it is opened again")
                await self._reopen()
        finally:
            await self._reader.close()

    async def _reopen(self) -> None:
        while True:
            await asyncio.sleep(REOPEN_S)
            try:
                await self._reader.open(self._wants)
                return
            except LinkError as error:
                self._log(str(error))

    def _log(self, text: str) -> None:
        now_s = asyncio.get_running_loop().time()
        if now_s - self._logged_s >= _LOG_INTERVAL_S:
            self._logged_s = now_s
            self._log_line(text)

    def _keep_frame(self, frame: RawFrame) -> None:
        taken_s = frame.there_s - self._latency_s
        if not self._cadence.selects(taken_s):
            return
        self._number += 1
        number, held = self._number, self._held
        held[number] = frame.loaded
        if len(held) > MAX_HELD_PICTURES:
            held.popitem(last=False)
        self._deliver(
            Announcement(f"{self._name} frame {number}", taken_s, lambda: self._load(number))
        )

    async def _load(self, number: int) -> Loaded:
        loaded = self._held.pop(number, None)
        if loaded is None:
            raise LinkError(f"{self._name} frame {number}: judged slower than pictures are taken")
        if isinstance(loaded, ImageError):
            raise loaded
        return loaded
