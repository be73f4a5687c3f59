"""A device as a MAVLink camera: a component of the aircraft that takes pictures when it is told.

    commands -> source -> pictures -> pose of their exposure -> CAMERA_IMAGE_CAPTURED, HTTP

Camera protocol v2, as uavmap and ground stations speak it. The pose comes from the autopilot's
telemetry, which passes the same link.
"""

from __future__ import annotations

import asyncio
import math
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import cv2
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import ImageError, LinkError
from uavmap.cameras.local import LocalSource
from uavmap.cameras.picture_server import KEPT, PictureStore
from uavmap.cameras.pose import Poses, rate_command
from uavmap.cameras.source import Announcement, Loaded
from uavmap.link.session import Message, Session

SHORTEST_INTERVAL_S: Final = 0.05
HEARTBEAT_S: Final = 1.0
TELEMETRY_S: Final = 3.0
"""Telemetry that a pose needs is asked for when it is silent for longer."""
_JPEG_QUALITY: Final = 95
_SENSOR_WIDTH_MM: Final = 6.17
"""Of a usual small sensor: only its ratio to the focal length tells anything."""
_STREAMS: Final = {
    mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 10.0,
    mav.MAVLINK_MSG_ID_ATTITUDE: 10.0,
}


@dataclass(frozen=True, slots=True)
class CameraFacts:
    """What CAMERA_INFORMATION says."""

    size_px: tuple[int, int]
    hfov_deg: float
    name: str


class CameraComponent:
    """One camera component beside the autopilot at the other end of a session.

    `transmit` takes frames to the link, `url` makes the address of a path in the store.
    """

    def __init__(
        self,
        session: Session,
        transmit: Callable[[bytes], None],
        source: LocalSource,
        poses: Poses,
        facts: CameraFacts,
        store: PictureStore,
        url: Callable[[str], str],
        component: int = mav.MAV_COMP_ID_CAMERA,
    ) -> None:
        self._session = session
        self._view = session.view
        self._transmit = transmit
        self._source = source
        self._poses = poses
        self._facts = facts
        self._store = store
        self._url = url
        self._component = component
        self._codec = mav.MAVLink(None, srcSystem=0, srcComponent=component)
        self._left = 0
        """Pictures still to take; negative: until stopped."""
        self._interval_s = 0.0
        self._last_sequence = 0
        self._taken: asyncio.Queue[tuple[int, Announcement]] = asyncio.Queue()
        self._count = 0
        self._announcements: OrderedDict[int, Message] = OrderedDict()
        session.listen(self._on_message)
        session.overheard = self._on_message
        source.listen(self._on_picture)

    async def run(self) -> None:
        """Heartbeats and pictures until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._beat())
            tasks.create_task(self._announce())

    @property
    def taken(self) -> int:
        """How many pictures it has taken."""
        return self._count

    # --- what it says ------------------------------------------------------------------------
    def _send(self, message: Message) -> None:
        if self._view.system_id == 0:  # the aircraft that it is part of is not known yet
            return
        codec = self._codec
        codec.srcSystem = self._view.system_id
        self._transmit(message.pack(codec))
        codec.seq = (codec.seq + 1) & 0xFF

    async def _beat(self) -> None:
        """HEARTBEAT, and a word to an autopilot that does not tell where it is."""
        loop = asyncio.get_running_loop()
        while True:
            self._send(
                mav.MAVLink_heartbeat_message(
                    mav.MAV_TYPE_CAMERA, mav.MAV_AUTOPILOT_INVALID, 0, 0, mav.MAV_STATE_ACTIVE, 3
                )
            )
            for message_id, rate_hz in _STREAMS.items():
                heard_s = self._session.heard_s.get(message_id, -math.inf)
                if loop.time() - heard_s > TELEMETRY_S:
                    self._send(rate_command(self._view, message_id, rate_hz))
            await asyncio.sleep(HEARTBEAT_S)

    @property
    def _boot_ms(self) -> int:
        return self._at_boot_ms(asyncio.get_running_loop().time())

    def _at_boot_ms(self, loop_s: float) -> int:
        """A time of the loop on the autopilot's clock, as far as that is known."""
        return max(round((loop_s - (self._view.boot_offset_s or 0.0)) * 1000.0), 0) & 0xFFFFFFFF

    # --- what it is told ---------------------------------------------------------------------
    def _on_message(self, message: Message) -> None:
        kind = message.get_type()
        if kind not in ("COMMAND_LONG", "COMMAND_INT") or self._view.system_id == 0:
            return
        if message.target_system not in (0, self._view.system_id):
            return
        if message.target_component not in (0, self._component):
            return
        last = (message.x, message.y, message.z) if kind == "COMMAND_INT" else (0, 0, 0)
        params = (message.param1, message.param2, message.param3, message.param4, *last)
        result, replies = self._carry_out(message.command, params)
        if result == mav.MAV_RESULT_UNSUPPORTED and message.target_component == 0:
            return  # said to everybody: somebody else may understand it
        self._send(
            mav.MAVLink_command_ack_message(
                message.command, result, 0, 0, message.get_srcSystem(), message.get_srcComponent()
            )
        )
        for reply in replies:
            self._send(reply)

    def _carry_out(
        self, command: int, params: tuple[float, ...]
    ) -> tuple[int, tuple[Message, ...]]:
        """A MAV_RESULT, and what is sent after it."""
        asked = {
            mav.MAV_CMD_REQUEST_CAMERA_INFORMATION: mav.MAVLINK_MSG_ID_CAMERA_INFORMATION,
            mav.MAV_CMD_REQUEST_CAMERA_SETTINGS: mav.MAVLINK_MSG_ID_CAMERA_SETTINGS,
            mav.MAV_CMD_REQUEST_CAMERA_CAPTURE_STATUS: mav.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS,
        }
        if command == mav.MAV_CMD_IMAGE_START_CAPTURE:
            return self._start(*params[1:4]), ()
        if command == mav.MAV_CMD_IMAGE_STOP_CAPTURE:
            self._left = 0
            self._source.stop()
            return mav.MAV_RESULT_ACCEPTED, ()
        if command == mav.MAV_CMD_SET_CAMERA_MODE:
            image = params[1] == mav.CAMERA_MODE_IMAGE
            return mav.MAV_RESULT_ACCEPTED if image else mav.MAV_RESULT_DENIED, ()
        message_id: float | None = asked.get(command)
        if command == mav.MAV_CMD_REQUEST_MESSAGE:
            message_id = params[0]
        if message_id is None:
            return mav.MAV_RESULT_UNSUPPORTED, ()
        index = int(params[1]) if math.isfinite(params[1]) else 0
        reply = self._requested(message_id, index)
        return (mav.MAV_RESULT_DENIED, ()) if reply is None else (mav.MAV_RESULT_ACCEPTED, (reply,))

    def _start(self, interval_s: float, count: float, sequence: float) -> int:
        """IMAGE_START_CAPTURE; a MAV_RESULT."""
        if not all(map(math.isfinite, (interval_s, count))) or count < 0 or interval_s < 0:
            return int(mav.MAV_RESULT_DENIED)
        number = int(min(count, 1e6))
        single = int(sequence) if number == 1 and math.isfinite(sequence) else 0
        if single >= 1 and single == self._last_sequence:
            return int(mav.MAV_RESULT_ACCEPTED)  # a repeated command is not taken twice
        if self._left != 0:
            return int(mav.MAV_RESULT_TEMPORARILY_REJECTED)
        self._interval_s = max(interval_s, SHORTEST_INTERVAL_S)
        self._left = number if number > 0 else -1
        self._last_sequence = single
        self._source.order(self._interval_s, number)
        return int(mav.MAV_RESULT_ACCEPTED)

    def _requested(self, message_id: float, index: int) -> Message | None:
        if message_id == mav.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED:
            return self._announcements.get(index)
        if message_id == mav.MAVLINK_MSG_ID_CAMERA_INFORMATION:
            return self._information()
        if message_id == mav.MAVLINK_MSG_ID_CAMERA_SETTINGS:
            return mav.MAVLink_camera_settings_message(
                self._boot_ms, mav.CAMERA_MODE_IMAGE, math.nan, math.nan
            )
        if message_id == mav.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS:
            # 0 idle, 1 capture, 3 interval capture in progress
            status = 0 if self._left == 0 else 1 if self._left == 1 else 3
            return mav.MAVLink_camera_capture_status_message(
                self._boot_ms, status, 0, self._interval_s, 0, 0.0, self._count
            )
        return None

    def _information(self) -> Message:
        width_px, height_px = self._facts.size_px
        focal_mm = _SENSOR_WIDTH_MM / 2.0 / math.tan(math.radians(self._facts.hfov_deg) / 2.0)
        return mav.MAVLink_camera_information_message(
            self._boot_ms, _text("uavmap"), _text(self._facts.name), 1, focal_mm,
            _SENSOR_WIDTH_MM, _SENSOR_WIDTH_MM * height_px / width_px, width_px, height_px, 0,
            mav.CAMERA_CAP_FLAGS_CAPTURE_IMAGE, 0, b"",
        )  # fmt: skip

    # --- pictures ----------------------------------------------------------------------------
    def _on_picture(self, picture: Announcement) -> None:
        if self._left == 0:
            return
        self._left -= self._left > 0
        self._taken.put_nowait((self._count, picture))
        self._count += 1

    async def _announce(self) -> None:
        """CAMERA_IMAGE_CAPTURED of each picture, in their order, once its pose is known."""
        while True:
            index, picture = await self._taken.get()
            path, good = f"/{index}.jpg", 1
            try:
                self._store.put(path, as_file(await picture.load()))
            except (LinkError, ImageError):
                good = 0
            message = await self._announcement(index, picture, path if good else "")
            self._announcements[index] = message
            if len(self._announcements) > KEPT:
                self._announcements.popitem(last=False)
            self._send(message)

    async def _announcement(self, index: int, picture: Announcement, path: str) -> Message:
        lat = lon = amsl_mm = height_mm = 0
        attitude = [math.nan] * 4  # "unknown"
        try:
            pose = await self._poses.of(picture)
        except ImageError:  # counted there; who gets the picture may know better
            pass
        else:
            lat, lon = round(pose.position.lat_deg * 1e7), round(pose.position.lon_deg * 1e7)
            height_mm = round(pose.height_m * 1000.0)
            amsl_mm = height_mm + round(self._view.home_amsl_m * 1000.0)
            attitude = list(pose.attitude)
        return mav.MAVLink_camera_image_captured_message(
            self._at_boot_ms(picture.taken_s), 0, 0, lat, lon, amsl_mm, height_mm, attitude,
            index, 1 if path else 0, self._url(path).encode("ascii") if path else b"",
        )  # fmt: skip


def as_file(loaded: Loaded) -> bytes:
    """A picture as a file: as it came, or as a JPEG. Raises `ImageError`."""
    if isinstance(loaded, bytes):
        return loaded
    good, data = cv2.imencode(".jpg", loaded, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    if not good:
        raise ImageError("a frame cannot be encoded")
    return bytes(data)


def _text(name: str) -> list[int]:
    return list(name.encode("ascii", "replace")[:32].ljust(32, b"\0"))
