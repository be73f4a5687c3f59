"""The camera of a vehicle: its pictures are judged, requested again, or reported lost.

    source -> announcement -> pose, picture -> PosedPicture -> judge

The judge belongs to the mission (`uavmap.aircraft.imaging.classifier.PictureJudge`).
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from functools import partial

from missions.events import FrameLost
from missions.mission.schema import Mission
from missions.units import Cell
from uavmap.aircraft.cameras.pose import Poses
from uavmap.aircraft.cameras.source import Announcement, FrameSource
from uavmap.aircraft.imaging.classifier import PosedPicture, camera_of
from uavmap.aircraft.imaging.frames import Frames
from uavmap.aircraft.map_navigation import Navigation
from uavmap.base.image_files import Image, decoded
from uavmap.base.printable import printable
from vision.plausible import implausible
from vision.projection import Frame

_Pictures = contextlib.AbstractAsyncContextManager[Frames]
Judge = Callable[[PosedPicture], Awaitable[bool]]
"""Judges a picture; returns, when its consequences are ordered, whether it counts."""


class CameraDriver:
    """Takes pictures with a vehicle's camera and has them judged."""

    def __init__(
        self,
        number: int,
        source: FrameSource,
        poses: Poses,
        mission: Mission,
        judge: Judge,
        mission_time_s: Callable[[], float],
    ) -> None:
        self._number = number
        self._source = source
        self._poses = poses
        self._mission = mission
        self._camera = camera_of(mission)
        self._judge = judge
        self._now_s = mission_time_s
        self._last: Image | None = None
        """Last picture: a stalled camera shows it again."""
        self.navigation: Navigation | None = None
        """Finds the position of pictures better than the autopilot; None: it is not used."""
        self._frames: Frames | None = None
        source.listen(self._announce)

    @property
    def streams(self) -> Mapping[int, float]:
        """Rates, Hz, by message id, that it needs; more may follow."""
        return self._poses.streams

    def uncertain(self) -> None:
        """Note that the camera's state is unknown: another process may have begun it, or it
        restarted."""
        self._source.uncertain()

    def _announce(self, picture: Announcement) -> None:
        if self._frames is not None:
            self._frames.receive_announcement(picture)

    def every(self, interval_s: float, *, anywhere: bool = False) -> _Pictures:
        """Take pictures at an interval while the context lasts; `anywhere`: without a vantage."""
        look = partial(self.judge_picture, anywhere=anywhere)
        return self._announcing_to(
            Frames(self._source, look, self.lost, interval_s, anywhere=anywhere)
        )

    def to_navigate(self, interval_s: float) -> _Pictures:
        """Take pictures at an interval to find the position by; the mission does not get them."""

        async def look(picture: Announcement, vantage: Cell | None) -> bool:
            await self._posed(picture, vantage, anywhere=True)
            return True

        return self._announcing_to(Frames(self._source, look, self.lost, interval_s, anywhere=True))

    def burst(self, most: int) -> _Pictures:
        """Take pictures in bursts of `votes.frames`, at most `most`."""
        look, interval_s = (
            partial(self.judge_picture, anywhere=False),
            self._mission.camera.interval_s,
        )
        size = self._mission.votes.frames
        return self._announcing_to(
            Frames(self._source, look, self.lost, interval_s, most=most, burst_size=size)
        )

    @contextlib.asynccontextmanager
    async def _announcing_to(self, frames: Frames) -> AsyncIterator[Frames]:
        self._frames = frames
        self._source.listen(self._announce)  # others may have listened before the flight
        try:
            await frames.begin()
            yield frames
        finally:
            if self._frames is frames:
                self._frames = None
            if frames.capturing:
                self._source.stop()

    async def judge_picture(
        self, picture: Announcement, vantage: Cell | None, *, anywhere: bool
    ) -> bool:
        """Have a picture judged; return whether it counts. Raises `ImageError`, `LinkError`."""
        return await self._judge(await self._posed(picture, vantage, anywhere=anywhere))

    async def _posed(
        self, picture: Announcement, vantage: Cell | None, *, anywhere: bool
    ) -> PosedPicture:
        t_s = self._exposed_s(picture)
        pose = await self._poses.pose_of(picture)
        data = await picture.load()
        finder = self.navigation
        if finder is not None:
            camera = self._camera
            image = decoded(data, picture.name, (camera.width_px, camera.height_px))
            # a stalled camera shows a vehicle at rest while it is commanded to move
            stalls = implausible(image, self._last, noiseless=self._mission.camera.noiseless)
            self._last = image
            if not stalls:
                pose = finder.add_frame(Frame(image, pose, t_s, camera)).pose
        return PosedPicture(self._number, t_s, pose, vantage, anywhere, picture.name, data)

    def lost(self, reason: str, picture: Announcement | None = None) -> FrameLost:
        """Return the event of a picture that never came (None), or cannot be used."""
        t_s = round(self._now_s(), 3) if picture is None else self._exposed_s(picture)
        return FrameLost(self._number, t_s, printable(reason))

    def _exposed_s(self, picture: Announcement) -> float:
        return round(self._now_s() + picture.taken_s - asyncio.get_running_loop().time(), 3)
