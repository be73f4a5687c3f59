"""The camera of a vehicle, and what its frames say.

CAMERA_IMAGE_CAPTURED -> fetch -> frame -> look(frame, grid, detector) -> FrameSeen
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import ImageError, LinkError
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
"""How long a picture may be late before it is asked for again, and then given up."""

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
        self._ordered_s = float("-inf")
        """When pictures were ordered last, on the loop's clock: none of them is older."""

    def on_message(self, message: Message) -> None:
        """Take note of a picture that was announced."""
        if message.get_type() == "CAMERA_IMAGE_CAPTURED" and self._frames is not None:
            self._frames.announced(message)

    @contextlib.asynccontextmanager
    async def every(self, interval_s: float) -> AsyncIterator[Frames]:
        """Pictures at an interval for as long as the context lasts."""
        async with self._frames_of(Frames(self, None)) as frames:
            await self.start(interval_s, 0)
            yield frames

    @contextlib.asynccontextmanager
    async def burst(self, most: int) -> AsyncIterator[Frames]:
        """Pictures in bursts of a look's number, at most so many."""
        async with self._frames_of(Frames(self, most)) as frames:
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
        """MAV_CMD_IMAGE_START_CAPTURE; a count of 0 goes on until stopped."""
        self._ordered_s = asyncio.get_running_loop().time()
        if self._frames is not None:
            self._frames.capturing = True
        await self._session.command(
            mav.MAV_CMD_IMAGE_START_CAPTURE,
            0,
            interval_s,
            count,
            0,
            component=self._session.view.camera_component,
        )

    def stop(self) -> None:
        """MAV_CMD_IMAGE_STOP_CAPTURE, without waiting: it is sent while being called off."""
        view = self._session.view
        self._session.send(
            mav.MAVLink_command_long_message(
                view.system_id,
                view.camera_component,
                mav.MAV_CMD_IMAGE_STOP_CAPTURE,
                0,
                *([0.0] * 7),
            )
        )

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


class Frames:
    """The pictures of one order, as they are announced."""

    def __init__(self, eyes: CameraDriver, most: int | None) -> None:
        self._eyes = eyes
        self._most = most
        self._announced: asyncio.Queue[Message] = asyncio.Queue()
        self._next_index: int | None = None
        self._seen: set[int] = set()
        self._pending = 0
        self._none_pending = asyncio.Event()
        self._none_pending.set()
        self.capturing = False

    def announced(self, message: Message) -> None:
        """A picture was taken; ask for those between the last one and this."""
        index = message.image_index
        if index in self._seen:
            return
        if self._next_index is not None:
            for missing in range(max(self._next_index, index - MOST_MISSING), index):
                self._eyes.ask_again(missing)
        self._next_index = max(index + 1, self._next_index or 0)
        self._seen.add(index)
        self._pending += 1
        self._none_pending.clear()
        self._announced.put_nowait(message)

    async def finish(self) -> None:
        """Take no more, and wait (not for long) until those announced are judged and reported."""
        self._eyes.stop()
        self.capturing = False
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(PICTURE_WAIT_S):
                await self._none_pending.wait()

    def _done(self) -> None:
        self._pending -= 1
        if self._pending == 0:
            self._none_pending.set()

    async def judged(self, vantage: Cell | None) -> AsyncIterator[FrameSeen | FrameLost]:
        """Every picture's verdicts, in the order of their coming."""
        if self._most is None:
            while True:
                yield await self._eyes.judge(await self._announced.get(), vantage)
                self._done()
        taken = 0
        while taken < self._most:
            count = min(self._eyes.burst_size, self._most - taken)
            await self._eyes.start(self._eyes.interval_s, count)
            for _ in range(count):
                taken += 1
                yield await self._next(vantage)
            self.capturing = False

    async def _next(self, vantage: Cell | None) -> FrameSeen | FrameLost:
        wait_s = self._eyes.interval_s + PICTURE_WAIT_S
        for last_try in (False, True):
            try:
                async with asyncio.timeout(wait_s):
                    message = await self._announced.get()
            except TimeoutError:
                if not last_try and self._next_index is not None:
                    self._eyes.ask_again(self._next_index)
                continue
            return await self._eyes.judge(message, vantage)
        return self._eyes.lost("a picture was ordered, but none was announced")
