"""The camera of a vehicle, and what its frames say.

CAMERA_IMAGE_CAPTURED -> fetch -> frame -> look(frame, grid, detector) -> FrameSeen
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import CommandRefusedError, ImageError, LinkError
from missions.events import FrameLost, FrameSeen
from missions.units import Cell
from uavmap.fly.classifier import Classifier
from uavmap.fly.frames import Frames, suppressed_silence
from uavmap.fly.picture_pose import pose_of
from uavmap.link.session import Message, Session
from uavmap.pictures import read_image
from uavmap.printable import printable
from vision.look import Frame

Fetch = Callable[[str], Awaitable[bytes]]
"""From a picture's `file_url` to its bytes. Raises `LinkError`."""

START_TRIES: Final = 3
"""How often a camera may reject a start after it was stopped."""


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

    async def judge(
        self, message: Message, vantage: Cell | None, *, anywhere: bool = False
    ) -> FrameSeen | FrameLost:
        """What a picture that was announced says: of the cells around its vantage, which is the
        cell below by default, or (`anywhere`) of all that it shows whole.
        """
        view, camera = self._session.view, self._classifier.camera
        loop_s = asyncio.get_running_loop().time()
        taken_s = view.captured_s(message.time_boot_ms, loop_s, self._ordered_s)
        t_s = round(self._now_s() + taken_s - loop_s, 3)
        try:
            try:
                pose = pose_of(message, view, self._classifier.grid, taken_s)
            except ImageError as error:
                view.gate.refuse(message.get_type(), str(error), loop_s)
                raise
            data = await self._fetch(message.file_url)
            image = read_image(data, message.file_url, (camera.width_px, camera.height_px))
            frame = Frame(image, pose, t_s, camera)
            if anywhere:
                return FrameSeen(self._number, t_s, None, self._classifier.votes_anywhere(frame))
            here, votes = self._classifier.votes(frame, vantage)
        except (ImageError, LinkError) as error:
            return FrameLost(self._number, t_s, printable(str(error)))
        return FrameSeen(self._number, t_s, here, votes)

    def lost(self, reason: str) -> FrameLost:
        """A picture that never came."""
        return FrameLost(self._number, round(self._now_s(), 3), reason)
