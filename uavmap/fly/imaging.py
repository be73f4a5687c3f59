"""The camera of a vehicle, and what its frames say.

source -> announcement -> pose, picture -> frame -> look(frame, grid, detector) -> FrameSeen
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import replace

from missions.errors import ImageError, LinkError
from missions.events import FrameLost, FrameSeen
from missions.units import Cell
from uavmap.cameras.pose import Poses
from uavmap.cameras.source import Announcement, FrameSource, decoded
from uavmap.fly.classifier import Classifier
from uavmap.fly.frames import Frames, suppressed_silence
from uavmap.fly.navigation import Navigation
from uavmap.printable import printable
from uavmap.record.frames import Keeper, KeptFrame
from vision.look import Frame


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
