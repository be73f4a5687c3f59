"""The camera of a vehicle: its pictures are judged, asked for again, or reported lost.

source -> announcement -> pose, picture -> frame -> look(frame, grid, detector) -> FrameSeen
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from dataclasses import replace
from typing import Final

from missions.errors import CommandRefusedError, ImageError, LinkError
from missions.events import FrameLost, FrameSeen
from missions.units import Cell
from uavmap.aircraft.cameras.pose import Poses
from uavmap.aircraft.cameras.source import Announcement, FrameSource, decoded
from uavmap.aircraft.imaging.classifier import Classifier
from uavmap.aircraft.map_navigation import Navigation
from uavmap.base.printable import printable
from uavmap.journal.kept_frames import Keeper, KeptFrame
from vision.look import Frame

PICTURE_WAIT_S: Final = 3.0
"""A picture that is late by twice this is given up."""

MOST_WAITING: Final = 4
"""So many pictures of a stream may wait to be judged, before older ones are left out."""

FIRST_ASK_S: Final = 1.5
ASK_AGAIN_S: Final = 1.0
"""An announcement that is so late is asked for, and so often again: a bad link loses those, too."""

MOST_MISSING: Final = 20
"""How many announcements are asked for again at once: a camera's count may jump."""


@contextlib.contextmanager
def suppressed_silence() -> Iterator[None]:
    """Let a camera that does not answer pass, and one that refuses not."""
    try:
        yield
    except CommandRefusedError:
        raise
    except LinkError:
        pass


class CameraDriver:
    """Takes pictures with a vehicle's camera and judges them."""

    def __init__(
        self,
        number: int,
        source: FrameSource,
        poses: Poses,
        classifier: Classifier,
        mission_time_s: Callable[[], float],
        keeper: Keeper | None = None,
    ) -> None:
        self._number = number
        self._source = source
        self._poses = poses
        self._classifier = classifier
        self._now_s = mission_time_s
        self._keeper = keeper
        self.navigation: Navigation | None = None
        """Tells where pictures were taken, better than the autopilot does."""
        self._frames: Frames | None = None
        source.listen(self._announced)

    @property
    def streams(self) -> Mapping[int, float]:
        """Rates, Hz, by message id, that it needs of the autopilot; they may become more."""
        return self._poses.streams

    def uncertain(self) -> None:
        """Nobody knows what the camera does: another process may have begun it, or it restarted."""
        self._source.uncertain()

    def _announced(self, picture: Announcement) -> None:
        """Take note of a picture that was taken."""
        if self._frames is not None:
            self._frames.announced(picture)

    @contextlib.asynccontextmanager
    async def every(self, interval_s: float, *, anywhere: bool = False) -> AsyncIterator[Frames]:
        """Pictures at an interval for as long as the context lasts.

        `anywhere`: they are evidence of all that they show, and of no vantage.
        """
        async with self._frames_of(Frames(self, None, interval_s, anywhere=anywhere)) as frames:
            with suppressed_silence():  # a silent camera is told by its missing pictures
                await self.start(interval_s, 0)
            yield frames

    @contextlib.asynccontextmanager
    async def burst(self, most: int) -> AsyncIterator[Frames]:
        """Pictures in bursts of a look's number, at most so many."""
        async with self._frames_of(Frames(self, most, self.interval_s)) as frames:
            yield frames

    @contextlib.asynccontextmanager
    async def _frames_of(self, frames: Frames) -> AsyncIterator[Frames]:
        self._frames = frames
        self._source.listen(self._announced)  # others may have, before the flight
        try:
            yield frames
        finally:
            if self._frames is frames:
                self._frames = None
            if frames.capturing:
                self.stop()

    async def start(self, interval_s: float, count: int) -> None:
        """Have pictures taken; a count of 0 goes on until stopped.

        Raises `LinkError` where nothing answers and none comes, or the camera refuses.
        """
        frames = self._frames
        if frames is not None:
            frames.capturing = True
        before = 0 if frames is None else frames.heard

        def coming() -> bool:
            return frames is not None and frames.heard > before

        await self._source.start(interval_s, count, coming)

    def stop(self) -> None:
        """Have none taken any more; without waiting, for it is said while being called off."""
        self._source.stop()

    def ended(self) -> None:
        """A burst has taken all its pictures: the camera has stopped by itself."""
        self._source.ended()

    @property
    def burst_size(self) -> int:
        """How many frames a cell gets."""
        return self._classifier.mission.votes.frames

    @property
    def interval_s(self) -> float:
        """Time between two frames of a cell."""
        return self._classifier.mission.camera.interval_s

    def ask_again(self, index: int) -> None:
        """Have a lost announcement repeated."""
        self._source.ask_again(index)

    async def judge(
        self, picture: Announcement, vantage: Cell | None, *, anywhere: bool = False
    ) -> FrameSeen | FrameLost:
        """What a picture that was announced says: of the cells around its vantage, which is the
        cell below by default, or (`anywhere`) of all that it shows whole.
        """
        camera = self._classifier.camera
        t_s = round(self._now_s() + picture.taken_s - asyncio.get_running_loop().time(), 3)
        try:
            pose = await self._poses.of(picture)
            size_px = (camera.width_px, camera.height_px)
            data = await picture.load()
            frame = Frame(decoded(data, picture.name, size_px), pose, t_s, camera)
            finder = self.navigation
            # a camera that stalls shows a vehicle that stands while it is told to move
            if finder is not None and finder.watches and not self._classifier.doubt(frame):
                frame = finder.placed(frame)
            if self._keeper is not None:
                hfov_deg = math.degrees(camera.hfov_rad)
                self._keeper.keep(KeptFrame("", self._number, t_s, frame.pose, hfov_deg), data)
            if anywhere:
                votes = self._classifier.votes_anywhere(frame)
                seen = FrameSeen(self._number, t_s, None, votes)
                return replace(seen, overview=True) if self._classifier.is_overview(frame) else seen
            here, votes = self._classifier.votes(frame, vantage)
        except (ImageError, LinkError) as error:
            return FrameLost(self._number, t_s, printable(str(error)))
        return FrameSeen(self._number, t_s, here, votes)

    def lost(self, reason: str) -> FrameLost:
        """A picture that never came."""
        return FrameLost(self._number, round(self._now_s(), 3), reason)


class Frames:
    """The pictures of one order, as they are announced.

    `most` None: a stream, until it is stopped; else bursts, of so many in all. `anywhere`: judged
    by all that they show.
    """

    def __init__(
        self,
        camera: CameraDriver,
        most: int | None,
        interval_s: float,
        *,
        anywhere: bool = False,
    ) -> None:
        self._camera = camera
        self._anywhere = anywhere
        self._most = most
        self._interval_s = interval_s
        self._announced: asyncio.Queue[Announcement] = asyncio.Queue()
        self._next_index: int | None = None
        self._seen: set[int] = set()
        self._pending = 0
        self._progress = asyncio.Event()
        self._left_out = False
        """Whether it was told that some pictures are left out."""
        self.heard = 0
        """How many pictures were announced."""
        self.capturing = False

    def announced(self, picture: Announcement) -> None:
        """A picture was taken; ask for those between the last one and this."""
        if picture.index is not None and not self._new(picture.index):
            return
        self._pending += 1
        self.heard += 1
        self._announced.put_nowait(picture)

    def _new(self, index: int) -> bool:
        """Whether a picture of this number was not announced before."""
        if index in self._seen:
            return False
        if self._next_index is not None:
            for missing in range(max(self._next_index, index - MOST_MISSING), index):
                self._camera.ask_again(missing)
        self._next_index = max(index + 1, self._next_index or 0)
        self._seen.add(index)
        return True

    async def finish(self) -> None:
        """Take no more, and wait until those announced are judged.

        The first picture is waited for; then for each that is announced, as long as one after the
        other is judged: a slow link takes its time, a dead one ends the wait.
        """
        if self.heard == 0:
            await self._moved_on()
        self._camera.stop()
        self.capturing = False
        while self._pending and await self._moved_on():
            pass

    @property
    def interval_s(self) -> float:
        """Between two pictures."""
        return self._interval_s

    async def go_on(self, interval_s: float) -> None:
        """Take further pictures, at an interval, after `finish` or while they are taken."""
        self._interval_s = interval_s
        with suppressed_silence():
            await self._camera.start(interval_s, 0)

    async def _moved_on(self) -> bool:
        """Whether another picture is judged, or lost, within the time for one."""
        self._progress.clear()
        try:
            async with asyncio.timeout(self._interval_s + PICTURE_WAIT_S):
                await self._progress.wait()
        except TimeoutError:
            return False
        return True

    def left_over(self) -> list[FrameLost]:
        """The pictures that were announced and never judged: they are lost, and that is said."""
        pending, self._pending = self._pending, 0
        late = "it came too late: the pictures are fetched slower than they are taken"
        return [self._camera.lost(late) for _ in range(pending)]

    async def judged(self, vantage: Cell | None) -> AsyncIterator[FrameSeen | FrameLost]:
        """Every picture's verdicts, in the order of their coming."""
        if self._most is None:
            while True:
                yield await self._streamed(vantage)
        taken = 0
        while taken < self._most:
            count = min(self._camera.burst_size, self._most - taken)
            try:
                await self._camera.start(self._interval_s, count)
            except CommandRefusedError:
                raise
            except LinkError as silence:  # the link may live, and the camera may wake up
                taken += count
                yield self._camera.lost(f"the camera is silent: {silence}")
                continue
            whole = True
            for left in range(count, 0, -1):
                taken += 1
                event = await self._next(vantage, left)
                whole = whole and isinstance(event, FrameSeen)
                if left == 1:  # before the mission hears of it, and calls us off
                    self.capturing = False
                    if whole:
                        self._camera.ended()
                yield event

    async def _streamed(self, vantage: Cell | None) -> FrameSeen | FrameLost:
        """The next picture of a stream; when none comes for long, one is lost, and it is restarted.

        A camera that restarted, or never heard the start, is silent for ever otherwise.
        """
        try:
            async with asyncio.timeout(2.0 * self._interval_s + PICTURE_WAIT_S):
                picture = await self._announced.get()
        except TimeoutError:
            if self.capturing:
                self._camera.uncertain()
                with suppressed_silence():
                    await self._camera.start(self._interval_s, 0)
            return self._camera.lost("the camera is silent: no picture was announced")
        if self._anywhere and self._announced.qsize() >= MOST_WAITING:
            picture = self._newest()
            if not self._left_out:
                self._left_out = True
                self._announced.put_nowait(picture)
                return self._camera.lost(
                    "pictures are judged slower than they are taken: from now on some are left out"
                )
        event = await self._camera.judge(picture, vantage, anywhere=self._anywhere)
        self._judged()
        return event

    def _newest(self) -> Announcement:
        """Of those that wait the last: older ones are left out, or the backlog would only grow."""
        self._judged()
        while self._announced.qsize() > 1:
            self._announced.get_nowait()
            self._judged()
        return self._announced.get_nowait()

    def _judged(self) -> None:
        self._pending -= 1
        self._progress.set()

    async def _next(self, vantage: Cell | None, left: int) -> FrameSeen | FrameLost:
        """The next picture of a burst of which so many are left.

        Its announcement is asked for until it is given up; where none was heard at all, nobody
        knows what to ask for, and the burst is begun once more.
        """
        clock = asyncio.get_running_loop()
        begin_s = clock.time()
        due_s = begin_s + 2.0 * (self._interval_s + PICTURE_WAIT_S)
        wait_s, again = self._interval_s + FIRST_ASK_S, False
        while (left_s := due_s - clock.time()) > 0.0:
            try:
                async with asyncio.timeout(min(wait_s, left_s)):
                    picture = await self._announced.get()
            except TimeoutError:
                wait_s = ASK_AGAIN_S
                if self._next_index is not None:
                    self._camera.ask_again(self._next_index)
                elif not again and clock.time() - begin_s >= PICTURE_WAIT_S:
                    again = True
                    with suppressed_silence():
                        await self._camera.start(self._interval_s, left)
                continue
            event = await self._camera.judge(picture, vantage)
            self._judged()
            return event
        return self._camera.lost("a picture was ordered, but none was announced")
