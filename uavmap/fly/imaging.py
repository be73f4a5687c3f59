"""The camera of a vehicle, and what its frames say.

CAMERA_IMAGE_CAPTURED -> fetch -> frame -> look(frame, grid, detector) -> FrameSeen
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import CommandRefusedError, ImageError, LinkError
from missions.events import FrameLost, FrameSeen
from missions.units import Cell
from uavmap.fly.classifier import Classifier
from uavmap.fly.picture_pose import pose_of
from uavmap.link.session import Message, Session
from uavmap.pictures import read_image
from uavmap.printable import printable
from vision.look import Frame

Fetch = Callable[[str], Awaitable[bytes]]
"""From a picture's `file_url` to its bytes. Raises `LinkError`."""

PICTURE_WAIT_S: Final = 3.0
"""A picture that is late by twice this is given up."""

FIRST_ASK_S: Final = 1.5
ASK_AGAIN_S: Final = 1.0
"""An announcement that is so late is asked for, and so often again: a bad link loses those, too."""

START_TRIES: Final = 3
"""How often a camera may reject a start after it was stopped."""

MOST_MISSING: Final = 20
"""How many announcements are asked for again at once: a camera's count may jump."""


class CameraDriver:
    """Takes pictures with a vehicle's camera and judges them."""

    def __init__(
        self,
        number: int,
        session: Session,
        classifier: Classifier,
        fetch: Fetch,
        mission_time_s: Callable[[], float],
    ) -> None:
        self._number = number
        self._session = session
        self._classifier = classifier
        self._fetch = fetch
        self._now_s = mission_time_s
        self._frames: Frames | None = None
        self._idle = False
        """Whether the camera is known to take no pictures just now."""
        self._ordered_s = float("-inf")
        """When pictures were ordered last, on the loop's clock: none of them is older."""

    def uncertain(self) -> None:
        """Nobody knows what the camera does: another process may have begun it, or it restarted."""
        self._idle = False

    def on_message(self, message: Message) -> None:
        """Take note of a picture that was announced."""
        if message.get_type() == "CAMERA_IMAGE_CAPTURED" and self._frames is not None:
            self._frames.announced(message)

    @contextlib.asynccontextmanager
    async def every(self, interval_s: float) -> AsyncIterator[Frames]:
        """Pictures at an interval for as long as the context lasts."""
        async with self._frames_of(Frames(self, None, interval_s)) as frames:
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
        try:
            yield frames
        finally:
            if self._frames is frames:
                self._frames = None
            if frames.capturing:
                self.stop()

    async def start(self, interval_s: float, count: int) -> None:
        """MAV_CMD_IMAGE_START_CAPTURE; a count of 0 goes on until stopped.

        A camera that still captures (its stop was lost, or another process began it) rejects the
        start for the time being: it is stopped first. Pictures that come are as good as an
        acknowledgement. Raises `LinkError` when neither comes, or the camera refuses.
        """
        self._ordered_s = asyncio.get_running_loop().time()
        frames = self._frames
        if frames is not None:
            frames.capturing = True
        before = 0 if frames is None else frames.heard

        def coming() -> bool:
            return frames is not None and frames.heard > before

        for attempt in itertools.count(1):
            if not self._idle:
                await self._stop_first()
            self._idle = False
            try:
                await self._session.command(
                    mav.MAV_CMD_IMAGE_START_CAPTURE,
                    0,
                    interval_s,
                    count,
                    0,
                    component=self._session.view.camera_component,
                    done=coming,
                )
                return
            except CommandRefusedError:
                if attempt >= START_TRIES:
                    raise

    async def _stop_first(self) -> None:
        """IMAGE_STOP_CAPTURE, acknowledged; a camera that refuses has nothing to stop."""
        with contextlib.suppress(LinkError):
            await self._session.command(
                mav.MAV_CMD_IMAGE_STOP_CAPTURE,
                component=self._session.view.camera_component,
            )

    def stop(self) -> None:
        """MAV_CMD_IMAGE_STOP_CAPTURE, without waiting: it is sent while being called off."""
        view = self._session.view
        self._idle = False
        self._session.send(
            mav.MAVLink_command_long_message(
                view.system_id,
                view.camera_component,
                mav.MAV_CMD_IMAGE_STOP_CAPTURE,
                0,
                *([0.0] * 7),
            )
        )

    def ended(self) -> None:
        """A burst has taken all its pictures: the camera has stopped by itself."""
        self._idle = True

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
        self._session.request(mav.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED, index)

    async def judge(self, message: Message, vantage: Cell | None) -> FrameSeen | FrameLost:
        """What a picture that was announced says."""
        view, camera = self._session.view, self._classifier.camera
        loop_s = asyncio.get_running_loop().time()
        taken_s = view.captured_s(message.time_boot_ms, loop_s, self._ordered_s)
        t_s = round(self._now_s() + taken_s - loop_s, 3)
        try:
            try:
                pose = pose_of(message, view, self._classifier.grid, loop_s - taken_s)
            except ImageError as error:
                view.gate.refuse(message.get_type(), str(error), loop_s)
                raise
            data = await self._fetch(message.file_url)
            image = read_image(data, message.file_url, (camera.width_px, camera.height_px))
            here, votes = self._classifier.votes(Frame(image, pose, t_s, camera), vantage)
        except (ImageError, LinkError) as error:
            return FrameLost(self._number, t_s, printable(str(error)))
        return FrameSeen(self._number, t_s, here, votes)

    def lost(self, reason: str) -> FrameLost:
        """A picture that never came."""
        return FrameLost(self._number, round(self._now_s(), 3), reason)


@contextlib.contextmanager
def suppressed_silence() -> Iterator[None]:
    """Let a camera that does not answer pass, and one that refuses not."""
    try:
        yield
    except CommandRefusedError:
        raise
    except LinkError:
        pass


class Frames:
    """The pictures of one order, as they are announced.

    `most` None: a stream, until it is stopped; else bursts, of so many in all.
    """

    def __init__(self, camera: CameraDriver, most: int | None, interval_s: float) -> None:
        self._camera = camera
        self._most = most
        self._interval_s = interval_s
        self._announced: asyncio.Queue[Message] = asyncio.Queue()
        self._next_index: int | None = None
        self._seen: set[int] = set()
        self._pending = 0
        self._progress = asyncio.Event()
        self.heard = 0
        """How many pictures were announced."""
        self.capturing = False

    def announced(self, message: Message) -> None:
        """A picture was taken; ask for those between the last one and this."""
        index = message.image_index
        if index in self._seen:
            return
        if self._next_index is not None:
            for missing in range(max(self._next_index, index - MOST_MISSING), index):
                self._camera.ask_again(missing)
        self._next_index = max(index + 1, self._next_index or 0)
        self._seen.add(index)
        self._pending += 1
        self.heard += 1
        self._announced.put_nowait(message)

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
                message = await self._announced.get()
        except TimeoutError:
            if self.capturing:
                self._camera.uncertain()
                with suppressed_silence():
                    await self._camera.start(self._interval_s, 0)
            return self._camera.lost("the camera is silent: no picture was announced")
        event = await self._camera.judge(message, vantage)
        self._judged()
        return event

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
                    message = await self._announced.get()
            except TimeoutError:
                wait_s = ASK_AGAIN_S
                if self._next_index is not None:
                    self._camera.ask_again(self._next_index)
                elif not again and clock.time() - begin_s >= PICTURE_WAIT_S:
                    again = True
                    with suppressed_silence():
                        await self._camera.start(self._interval_s, left)
                continue
            event = await self._camera.judge(message, vantage)
            self._judged()
            return event
        return self._camera.lost("a picture was ordered, but none was announced")
