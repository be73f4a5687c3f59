"""A camera that is a MAVLink component: commands to it, announcements and files from it.

Camera protocol v2: IMAGE_START_CAPTURE, CAMERA_IMAGE_CAPTURED with pose and `file_url`, a lost
announcement asked for again by its index.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import math
from collections.abc import Awaitable, Callable
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import CommandRefusedError, LinkError
from missions.units import LatLon, Quaternion
from uavmap.aircraft.cameras.mavlink_ftp import MavlinkFtp
from uavmap.aircraft.cameras.source import Announcement, FrameSource, ToldPose, never
from uavmap.mavlink.session import Message, Session
from uavmap.mavlink.vehicle_view import STAMP_SLACK_S, VehicleView

Fetch = Callable[[str], Awaitable[bytes]]
"""From a picture's `file_url` to its bytes. Raises `LinkError`."""

START_TRIES: Final = 3
"""How often a camera may reject a start after it was stopped."""


class CaptureCommands:
    """IMAGE_START_CAPTURE and IMAGE_STOP_CAPTURE, which a component may lose, repeat and reject.

    `component` says which, at the time of sending: the camera's, or the autopilot's.
    """

    def __init__(self, session: Session, component: Callable[[], int]) -> None:
        self._session = session
        self._component = component
        self._idle = False
        """Whether the camera is known to take no pictures just now."""
        self.ordered_s = float("-inf")
        """When pictures were ordered last, on the loop's clock: none of them is older."""

    def uncertain(self) -> None:
        """Nobody knows what the camera does."""
        self._idle = False

    def ended(self) -> None:
        """A burst has taken all its pictures: the camera has stopped by itself."""
        self._idle = True

    async def start(self, interval_s: float, count: int, coming: Callable[[], bool]) -> None:
        """MAV_CMD_IMAGE_START_CAPTURE; a count of 0 goes on until stopped.

        A camera that still captures (its stop was lost, or another process began it) rejects the
        start for the time being: it is stopped first. Pictures that come are as good as an
        acknowledgement. Raises `LinkError` when neither comes, or the camera refuses.
        """
        self.ordered_s = asyncio.get_running_loop().time()
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
                    component=self._component(),
                    done=coming,
                )
                return
            except CommandRefusedError:
                if attempt >= START_TRIES:
                    raise

    async def _stop_first(self) -> None:
        """IMAGE_STOP_CAPTURE, acknowledged; a camera that refuses has nothing to stop."""
        with contextlib.suppress(LinkError):
            await self._session.command(mav.MAV_CMD_IMAGE_STOP_CAPTURE, component=self._component())

    def stop(self) -> None:
        """MAV_CMD_IMAGE_STOP_CAPTURE, without waiting: it is sent while being called off."""
        self._idle = False
        self._session.send_command(mav.MAV_CMD_IMAGE_STOP_CAPTURE, component=self._component())


class CommandedSource(FrameSource):
    """What the cameras have in common that are commanded by messages of a session."""

    def __init__(self, session: Session, component: Callable[[], int]) -> None:
        super().__init__()
        self._session = session
        self._commands = CaptureCommands(session, component)

    async def start(
        self, interval_s: float, count: int, coming: Callable[[], bool] = never
    ) -> None:
        """Have it take pictures. Raises `CommandRefusedError`, `LinkError`."""
        await self._commands.start(interval_s, count, coming)

    def stop(self) -> None:
        """Have it stop."""
        self._commands.stop()

    def ended(self) -> None:
        """It has stopped by itself."""
        self._commands.ended()

    def uncertain(self) -> None:
        """Nobody knows what it does."""
        self._commands.uncertain()


class MavlinkSource(CommandedSource):
    """The camera component of the vehicle at the other end of a session."""

    def __init__(self, session: Session, fetch: Fetch) -> None:
        super().__init__(session, lambda: session.view.camera_component)
        self._by_http = fetch
        self._ftp = MavlinkFtp(session)
        session.listen(self._on_message)

    def ask_again(self, index: int) -> None:
        """Have a lost announcement repeated."""
        self._session.request(mav.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED, index)

    def _on_message(self, message: Message) -> None:
        if message.get_type() == "CAMERA_IMAGE_CAPTURED":
            self._heard(self._announcement(message))

    async def fetch(self, url: str) -> bytes:
        """The file of a picture, by MAVLink FTP or by HTTP. Raises `LinkError`."""
        if url.startswith("mftp://"):
            return await self._ftp.fetch(url)
        return await self._by_http(url)

    def _announcement(self, message: Message) -> Announcement:
        view = self._session.view
        url, now_s = message.file_url, asyncio.get_running_loop().time()
        taken_s = view.captured_s(message.time_boot_ms, now_s, self._commands.ordered_s)
        said_s = view.captured_s(message.time_boot_ms, math.inf)
        wrong = abs(said_s - taken_s) > STAMP_SLACK_S
        return Announcement(
            name=url,
            taken_s=taken_s,
            load=lambda: self.fetch(url),
            index=message.image_index,
            told=told_pose(message, view),
            fault="its time cannot be right" if wrong else None,
            kind=message.get_type(),
        )


def told_pose(message: Message, view: VehicleView) -> ToldPose:
    """What a CAMERA_IMAGE_CAPTURED tells; zeros and NaN are what cameras say that do not know."""
    position = None
    if not message.lat == message.lon == 0:
        position = LatLon(message.lat / 1e7, message.lon / 1e7)
    attitude = None
    if any(message.q) and not all(map(math.isnan, message.q)):
        attitude = Quaternion(*message.q)
    return ToldPose(position, view.height_of(message), attitude)
