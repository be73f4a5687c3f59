"""A camera that is a MAVLink component: its commands, announcements and files.

Camera protocol v2: IMAGE_START_CAPTURE, CAMERA_IMAGE_CAPTURED with pose and `file_url`, requested
again by its index. Files come by HTTP, or by the part of MAVLink FTP that a picture needs.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import math
import re
import struct
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import CommandRefusedError, LinkError
from missions.units import LatLon, Quaternion
from uavmap.aircraft.cameras.source import Announcement, FrameSource, ReportedPose, nothing_came
from uavmap.base.image_files import MAX_PICTURE_BYTES
from uavmap.base.printable import printable
from uavmap.mavlink.session import GROUND_SYSTEM_ID, Message, Session
from uavmap.mavlink.vehicle_view import STAMP_SLACK_S, VehicleView

REPLY_S: Final = 0.5
FTP_TRIES: Final = 6
FETCH_S: Final = 60.0
"""Maximum time of a picture, s; a telemetry radio of 57600 baud carries 200 kB in that time."""

TERMINATE, OPEN, BURST = 1, 4, 15
NAK: Final = 129
END_OF_FILE: Final = 6
_HEAD: Final = struct.Struct("<HBBBBBxI")
_DATA_BYTES: Final = 239
_PAYLOAD_BYTES: Final = 251
_URL: Final = re.compile(r"mftp://(?:\[;comp=(?P<component>\d{1,3})\])?(?P<path>/?[^\[\]]+)")
_ERRORS: Final = {
    1: "it failed", 2: "it failed", 4: "it has no session free", 7: "it does not know the command",
    8: "the file is protected", 10: "there is no such file",
}  # fmt: skip


class _Reply:
    """A packet of the server."""

    def __init__(self, payload: bytes) -> None:
        (
            self.sequence, self.session, self.opcode, size, self.of, self.burst_ends, self.offset,
        ) = _HEAD.unpack_from(payload)  # fmt: skip
        self.data = payload[_HEAD.size : _HEAD.size + min(size, _DATA_BYTES)]

    @property
    def error(self) -> int:
        """Code of its refusal."""
        return self.data[0] if self.data else 1


class MavlinkFtp:
    """Fetches files of the aircraft at the other end of a session, one after the other.

    A `file_url` such as `mftp:///DCIM/12.jpg` or `mftp://[;comp=100]/DCIM/12.jpg` names a file of a
    component that supports FILE_TRANSFER_PROTOCOL over the same link.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._sequence = 0
        self._asked = 0
        """Component that is asked."""
        self._replies: asyncio.Queue[_Reply] = asyncio.Queue()
        self._one = asyncio.Lock()
        session.listen(self._on_message, "FILE_TRANSFER_PROTOCOL")

    async def fetch(self, url: str) -> bytes:
        """Return the bytes of a file. Raises `LinkError`."""
        match = _URL.fullmatch(url)
        name = printable(url)
        if match is None or not url.isascii() or len(match["path"]) > _DATA_BYTES:
            raise LinkError(f"{name} cannot be fetched: it names no file")
        async with self._one:
            self._asked = int(match["component"] or self._session.view.camera_component)
            try:
                async with asyncio.timeout(FETCH_S), self._opened(match["path"]) as (number, size):
                    return await self._read(number, size)
            except TimeoutError:
                raise LinkError(
                    f"{name} cannot be fetched: not done within {FETCH_S:g} s"
                ) from None
            except LinkError as error:
                raise LinkError(f"{name} cannot be fetched: {error}") from None

    @contextlib.asynccontextmanager
    async def _opened(self, path: str) -> AsyncIterator[tuple[int, int]]:
        """Yield the number of a session, and the size of the file."""
        reply = await self._answer_to(OPEN, data=path.encode("ascii"))
        if len(reply.data) < 4:
            raise LinkError("the answer has no size")
        (size,) = struct.unpack_from("<I", reply.data)
        try:
            if size > MAX_PICTURE_BYTES:
                raise LinkError(f"{size} bytes; a picture has at most {MAX_PICTURE_BYTES}")
            yield reply.session, size
        finally:
            self._send(TERMINATE, reply.session)

    async def _read(self, number: int, size: int) -> bytes:
        """Return all of a file: bursts from the first gap on, until there is none."""
        data, known = bytearray(size), [False] * -(-size // _DATA_BYTES)
        tries = 0
        while not all(known):
            first = known.index(False)
            sent = self._send(BURST, number, offset=first * _DATA_BYTES, size=_DATA_BYTES)
            if await self._take_burst(number, sent, data, known):
                tries = 0
                continue
            tries += 1
            if tries >= FTP_TRIES:
                raise LinkError("it does not answer")
        return bytes(data)

    async def _take_burst(self, number: int, sent: int, data: bytearray, known: list[bool]) -> bool:
        """Receive until the burst ends, or falls silent; return whether anything came."""
        came = False
        while True:
            try:
                async with asyncio.timeout(REPLY_S):
                    reply = await self._replies.get()
            except TimeoutError:
                return came
            if reply.of != BURST or reply.session != number:
                continue
            if reply.opcode == NAK:
                if reply.error == END_OF_FILE:
                    return came
                raise LinkError(_ERRORS.get(reply.error, "it was refused"))
            block, rest = divmod(reply.offset, _DATA_BYTES)
            end = reply.offset + len(reply.data)
            if rest or end > len(data) or (end < len(data) and len(reply.data) != _DATA_BYTES):
                continue
            data[reply.offset : end] = reply.data
            known[block] = came = True
            if reply.burst_ends or all(known):
                return came

    async def _answer_to(self, opcode: int, data: bytes) -> _Reply:
        for _ in range(FTP_TRIES):
            sent = self._send(opcode, 0, data=data)
            try:
                async with asyncio.timeout(REPLY_S):
                    while True:
                        reply = await self._replies.get()
                        if reply.of == opcode and reply.sequence == (sent + 1) & 0xFFFF:
                            break
            except TimeoutError:
                continue
            if reply.opcode == NAK:
                raise LinkError(_ERRORS.get(reply.error, "it was refused"))
            return reply
        raise LinkError("it does not answer")

    def _send(
        self, opcode: int, number: int, *, offset: int = 0, size: int = 0, data: bytes = b""
    ) -> int:
        """Send a packet; return its number."""
        sequence, self._sequence = self._sequence, (self._sequence + 2) & 0xFFFF
        head = _HEAD.pack(sequence, number, opcode, len(data) or size, 0, 0, offset)
        payload = (head + data).ljust(_PAYLOAD_BYTES, b"\0")
        self._session.send(
            mav.MAVLink_file_transfer_protocol_message(
                0, self._session.view.system_id, self._asked, list(payload)
            )
        )
        return sequence

    def _on_message(self, message: Message) -> None:
        if message.target_system not in (0, GROUND_SYSTEM_ID):
            return
        if message.get_srcComponent() == self._asked:
            self._replies.put_nowait(_Reply(bytes(message.payload)))


Fetch = Callable[[str], Awaitable[bytes]]
"""Returns the bytes at a picture's `file_url`. Raises `LinkError`."""

START_TRIES: Final = 3
"""Maximum number of starts that a camera may reject after it was stopped."""


class CommandedSource(FrameSource):
    """A camera that is commanded by messages of a session.

    Messages may be lost, repeated and rejected. `component` returns at each send the target: the
    camera or the autopilot.
    """

    def __init__(self, session: Session, component: Callable[[], int]) -> None:
        super().__init__()
        self._session = session
        self._component = component
        self._idle = False
        """True if the camera is known to take no pictures now."""
        self._ordered_s = float("-inf")
        """Time of the last order, on the loop's clock, s: no picture is older."""

    def uncertain(self) -> None:
        """Note that the camera's state is unknown."""
        self._idle = False

    def note_end(self) -> None:
        """Note that a burst has taken all its pictures: the camera has stopped by itself."""
        self._idle = True

    async def start(
        self, interval_s: float, count: int, coming: Callable[[], bool] = nothing_came
    ) -> None:
        """Send MAV_CMD_IMAGE_START_CAPTURE; a count of 0 continues until stopped.

        A camera that still captures (its stop was lost, or another process began it) rejects the
        start for the time being: it is stopped first. Pictures that come are as good as an
        acknowledgement. Raises `LinkError` when neither comes, or the camera refuses.
        """
        self._ordered_s = asyncio.get_running_loop().time()
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
        """Send IMAGE_STOP_CAPTURE, acknowledged; a camera that refuses has nothing to stop."""
        with contextlib.suppress(LinkError):
            await self._session.command(mav.MAV_CMD_IMAGE_STOP_CAPTURE, component=self._component())

    def stop(self) -> None:
        """Send MAV_CMD_IMAGE_STOP_CAPTURE, without waiting: it is sent during a cancellation."""
        self._idle = False
        self._session.send_command(mav.MAV_CMD_IMAGE_STOP_CAPTURE, component=self._component())


class MavlinkSource(CommandedSource):
    """The camera component of the vehicle at the other end of a session."""

    def __init__(self, session: Session, fetch: Fetch) -> None:
        super().__init__(session, lambda: session.view.camera_component)
        self._by_http = fetch
        self._ftp = MavlinkFtp(session)
        session.listen(self._on_message, "CAMERA_IMAGE_CAPTURED")

    def ask_again(self, index: int) -> None:
        """Have a lost announcement repeated."""
        self._session.request(mav.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED, index)

    def _on_message(self, message: Message) -> None:
        self._deliver(self._announcement(message))

    async def fetch(self, url: str) -> bytes:
        """Return the file of a picture, by MAVLink FTP or by HTTP. Raises `LinkError`."""
        if url.startswith("mftp://"):
            return await self._ftp.fetch(url)
        return await self._by_http(url)

    def _announcement(self, message: Message) -> Announcement:
        view = self._session.view
        url, now_s = message.file_url, asyncio.get_running_loop().time()
        taken_s = view.captured_s(message.time_boot_ms, now_s, self._ordered_s)
        said_s = view.captured_s(message.time_boot_ms, math.inf)
        wrong = abs(said_s - taken_s) > STAMP_SLACK_S
        return Announcement(
            name=url,
            taken_s=taken_s,
            load=lambda: self.fetch(url),
            index=message.image_index,
            reported=reported_pose(message, view),
            fault="its time cannot be right" if wrong else None,
            kind=message.get_type(),
        )


def reported_pose(message: Message, view: VehicleView) -> ReportedPose:
    """Return the pose in a CAMERA_IMAGE_CAPTURED; zeros and NaN mean that a camera lacks a
    value."""
    position = None
    if not message.lat == message.lon == 0:
        position = LatLon(message.lat / 1e7, message.lon / 1e7)
    attitude = None
    if any(message.q) and not all(map(math.isnan, message.q)):
        attitude = Quaternion(*message.q)
    return ReportedPose(position, view.height_of(message), attitude)
