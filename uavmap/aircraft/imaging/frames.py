"""The pictures of one order, as they are announced: each is judged, or reported lost."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from typing import Final

from missions.errors import CommandRefusedError, ImageError, LinkError
from missions.events import FrameLost
from missions.units import Cell
from uavmap.aircraft.cameras.source import Announcement, FrameSource

PICTURE_WAIT_S: Final = 3.0
"""Delay of a picture, s; after twice this it is given up."""

MAX_WAITING: Final = 4
"""Maximum number of pictures of a stream that wait to be judged; older ones are left out."""

FIRST_REQUEST_AGE_S: Final = 1.5
REQUEST_INTERVAL_S: Final = 1.0
"""Age at which an announcement is requested, and interval to request it again, s."""

MAX_REQUESTED: Final = 20
"""Maximum number of announcements that are requested at once: a camera's count may jump."""

LookAt = Callable[[Announcement, Cell | None], Awaitable[bool]]
"""Judges an announced picture for its cell; returns whether it counts.

Raises `ImageError`, `LinkError`.
"""
Lost = Callable[[str, Announcement | None], FrameLost]
"""Makes the event of a picture that never came (None) or cannot be used, with the reason."""


@contextlib.contextmanager
def suppressed_silence() -> Iterator[None]:
    """Ignore a camera that does not answer, but not one that refuses."""
    try:
        yield
    except CommandRefusedError:
        raise
    except LinkError:
        pass


class Frames:
    """The announced pictures of one order.

    `most` None: a stream, until it is stopped; else bursts of `burst_size`, `most` pictures in all.
    `anywhere`: judged by all that they show.
    """

    def __init__(
        self,
        source: FrameSource,
        look: LookAt,
        lost: Lost,
        interval_s: float,
        *,
        most: int | None = None,
        burst_size: int = 1,
        anywhere: bool = False,
    ) -> None:
        self._source = source
        self._look = look
        self._lost = lost
        self._anywhere = anywhere
        self._most = most
        self._burst_size = burst_size
        self.interval_s = interval_s
        """Interval between two pictures, s."""
        self._announced: asyncio.Queue[Announcement] = asyncio.Queue()
        self._next_index: int | None = None
        self._seen: set[int] = set()
        self._pending = 0
        self._progress = asyncio.Event()
        self._left_out = False
        """True once it was logged that pictures are left out."""
        self._whole = True
        """True while all pictures of the present burst were announced."""
        self.announced_count = 0
        """Number of announced pictures."""
        self.capturing = False

    def receive_announcement(self, picture: Announcement) -> None:
        """Note a picture; request those between the last one and this."""
        if picture.index is not None and not self._new(picture.index):
            return
        self._pending += 1
        self.announced_count += 1
        self._announced.put_nowait(picture)

    def _new(self, index: int) -> bool:
        if index in self._seen:
            return False
        if self._next_index is not None:
            for missing in range(max(self._next_index, index - MAX_REQUESTED), index):
                self._source.ask_again(missing)
        self._next_index = max(index + 1, self._next_index or 0)
        self._seen.add(index)
        return True

    async def finish(self) -> None:
        """Stop, and wait for the first picture, then while one after the other is judged.

        A slow link takes its time, a dead one ends the wait.
        """
        if self.announced_count == 0:
            await self._moved_on()
        self._source.stop()
        self.capturing = False
        while self._pending and await self._moved_on():
            pass

    async def go_on(self, interval_s: float) -> None:
        """Take further pictures, at an interval, after `finish` or during captures."""
        self.interval_s = interval_s
        await self.start()

    async def begin(self) -> None:
        """Begin a stream; bursts begin one by one, as they are judged."""
        if self._most is None:
            await self.start()

    async def start(self) -> None:
        """Have pictures taken until stopped; missing ones show a silent camera."""
        with suppressed_silence():
            await self._start(0)

    async def _start(self, count: int) -> None:
        """Have pictures taken; a count of 0 continues until stopped.

        Raises `LinkError` if neither answer nor picture comes, or the camera refuses.
        """
        self.capturing, before = True, self.announced_count
        await self._source.start(self.interval_s, count, lambda: self.announced_count > before)

    async def _moved_on(self) -> bool:
        """Return whether another picture is judged, or lost, within the time for one."""
        self._progress.clear()
        try:
            async with asyncio.timeout(self.interval_s + PICTURE_WAIT_S):
                await self._progress.wait()
        except TimeoutError:
            return False
        return True

    def left_over(self) -> list[FrameLost]:
        """Return the announced pictures that were never judged, as lost."""
        pending, self._pending = self._pending, 0
        late = "it came too late: the pictures are fetched slower than they are taken"
        return [self._lost(late, None) for _ in range(pending)]

    async def judged(self, vantage: Cell | None) -> AsyncIterator[FrameLost | None]:
        """Have every picture judged, in order; yield each lost one, and None for each good one."""
        if self._most is None:
            while True:
                yield await self._streamed(vantage)
        taken = 0
        while taken < self._most:
            count = min(self._burst_size, self._most - taken)
            try:
                await self._start(count)
            except CommandRefusedError:
                raise
            except LinkError as silence:  # the link may still work, and the camera may recover
                taken += count
                yield self._lost(f"the camera is silent: {silence}", None)
                continue
            self._whole = True
            for left in range(count, 0, -1):
                taken += 1
                yield await self._next(vantage, left)

    async def _streamed(self, vantage: Cell | None) -> FrameLost | None:
        """Judge the next picture of a stream.

        If none comes for long, one is lost, and the camera is started again: it may have restarted,
        or missed the start.
        """
        try:
            async with asyncio.timeout(2.0 * self.interval_s + PICTURE_WAIT_S):
                picture = await self._announced.get()
        except TimeoutError:
            if self.capturing:
                self._source.uncertain()
                await self.start()
            return self._lost("the camera is silent: no picture was announced", None)
        if self._anywhere and self._announced.qsize() >= MAX_WAITING:
            picture = self._newest()
            if not self._left_out:
                self._left_out = True
                self._announced.put_nowait(picture)
                return self._lost(
                    "detection is slower than the frame rate: pictures are dropped from now on",
                    None,
                )
        return await self._judge_picture(picture, vantage)

    async def _judge_picture(self, picture: Announcement, vantage: Cell | None) -> FrameLost | None:
        try:
            await self._look(picture, vantage)
        except (ImageError, LinkError) as error:
            return self._lost(str(error), picture)
        finally:
            self._note_verdict()
        return None

    def _newest(self) -> Announcement:
        """Return the last waiting picture; older ones are left out, or the backlog would only
        grow."""
        self._note_verdict()
        while self._announced.qsize() > 1:
            self._announced.get_nowait()
            self._note_verdict()
        return self._announced.get_nowait()

    def _note_verdict(self) -> None:
        self._pending -= 1
        self._progress.set()

    async def _next(self, vantage: Cell | None, left: int) -> FrameLost | None:
        """Judge the next picture of a burst with `left` to come; request it until it is given up.

        Without any announcement begin the burst once more.
        """
        clock = asyncio.get_running_loop()
        begin_s = clock.time()
        due_s = begin_s + 2.0 * (self.interval_s + PICTURE_WAIT_S)
        wait_s, again = self.interval_s + FIRST_REQUEST_AGE_S, False
        while (left_s := due_s - clock.time()) > 0.0:
            try:
                async with asyncio.timeout(min(wait_s, left_s)):
                    picture = await self._announced.get()
            except TimeoutError:
                wait_s = REQUEST_INTERVAL_S
                if self._next_index is not None:
                    self._source.ask_again(self._next_index)
                elif not again and clock.time() - begin_s >= PICTURE_WAIT_S:
                    again = True
                    with suppressed_silence():
                        await self._start(left)
                continue
            if left == 1:  # before the mission judges it, and gives another order
                self.capturing = False
                if self._whole:
                    self._source.note_end()
            return await self._judge_picture(picture, vantage)
        self._whole = False
        if left == 1:
            self.capturing = False
        return self._lost("a picture was ordered, but none was announced", None)
