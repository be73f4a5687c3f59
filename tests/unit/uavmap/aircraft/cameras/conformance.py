"""One contract and one bench, on virtual time, for every source of pictures.

A bench is a source and the hardware behind it, which the test controls. The hardware takes pictures
on the test's command, each at a known time.
"""

from __future__ import annotations

import asyncio
import contextlib
import io
from dataclasses import dataclass, field

import numpy as np
from PIL import Image
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import ImageError, LinkError, UavmapError
from missions.units import LatLon
from tests.support.mavlink_peer import Peer, heartbeat, position
from uavmap.aircraft.cameras.folder import FolderSource
from uavmap.aircraft.cameras.mavlink import MavlinkSource
from uavmap.aircraft.cameras.pose import Mount
from uavmap.aircraft.cameras.source import Announcement, FrameSource
from uavmap.aircraft.cameras.stream import RawFrame, StreamSource
from uavmap.aircraft.cameras.triggered import TriggeredSource

SIZE_PX = (64, 48)
LATENCY_S = 0.3


def jpeg(shade, exif=None):
    out = io.BytesIO()
    image = Image.new("RGB", SIZE_PX, (shade % 256, 100, 100))
    image.save(out, "JPEG", **({} if exif is None else {"exif": exif}))
    return out.getvalue()


async def inline(function):
    return function()


@dataclass
class Bench:
    source: FrameSource
    hardware: object
    told: list[str]
    announced: list[Announcement] = field(default_factory=list)

    async def shoot(self, count, interval_s=1.0, first=0):
        """Take pictures at an interval; return the time of each exposure."""
        times = []
        for number in range(first, first + count):
            times.append(asyncio.get_running_loop().time())
            await self.hardware.expose(number)
            await asyncio.sleep(interval_s)
        return times

    async def load(self):
        good = []
        for picture in self.announced:
            try:
                await picture.load()
                good.append(True)
            except UavmapError:
                good.append(False)
        return good


# --- a folder --------------------------------------------------------------------------------
class FolderHardware:
    def __init__(self, folder):
        self.folder = folder

    def later(self, name, data):
        path = self.folder / name

        def write():
            with contextlib.suppress(OSError):
                path.write_bytes(data)

        asyncio.get_running_loop().call_later(LATENCY_S, write)

    async def expose(self, number):
        self.later(f"DSC{number:04}.JPG", jpeg(number))

    async def spoil(self, number):
        """Delete a picture as soon as it appears."""
        name = f"DSC{number:04}.JPG"
        self.later(name, jpeg(number))
        loop = asyncio.get_running_loop()
        loop.call_later(LATENCY_S + 0.2, (self.folder / name).unlink)

    def vanish(self):
        self.folder.rename(self.folder.with_suffix(".gone"))

    def come_back(self):
        self.folder.with_suffix(".gone").rename(self.folder)


@contextlib.asynccontextmanager
async def running(run):
    task = asyncio.ensure_future(run())
    try:
        yield
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


@contextlib.asynccontextmanager
async def folder_bench(tmp_path):
    folder = tmp_path / "card"
    folder.mkdir()
    (folder / "OLD.JPG").write_bytes(jpeg(1))
    told = []
    source = FolderSource(folder, LATENCY_S, told.append, inline)
    await source.begin()
    bench = Bench(source, FolderHardware(folder), told)
    source.listen(bench.announced.append)
    async with running(source.run):
        yield bench


# --- a stream --------------------------------------------------------------------------------
class StreamHardware:
    def __init__(self):
        self._queue = asyncio.Queue()
        self._wants = lambda t_s: False
        self.there = True
        self.opened = 0

    async def open(self, wants):
        if not self.there:
            raise LinkError("the test's camera cannot be opened")
        self.opened += 1
        self._wants = wants
        if self.opened == 1:  # the source reads the first frame to learn its size
            self._put(0, np.zeros((SIZE_PX[1], SIZE_PX[0], 3), np.uint8))

    async def next(self):
        return await self._queue.get()

    async def close(self):
        pass

    def _put(self, number, loaded):
        there_s = asyncio.get_running_loop().time()
        if self.there and self._wants(there_s):
            self._queue.put_nowait(RawFrame(there_s, loaded))

    async def expose(self, number):
        image = np.full((SIZE_PX[1], SIZE_PX[0], 3), number % 256, np.uint8)
        asyncio.get_running_loop().call_later(LATENCY_S, self._put, number, image)

    async def spoil(self, number):
        broken = ImageError("half of a frame")
        asyncio.get_running_loop().call_later(LATENCY_S, self._put, number, broken)

    def vanish(self):
        self.there = False
        self._queue.put_nowait(None)

    def come_back(self):
        self.there = True


@contextlib.asynccontextmanager
async def stream_bench(tmp_path):
    hardware, told = StreamHardware(), list[str]()
    source = StreamSource("the test's camera", hardware, LATENCY_S, SIZE_PX, told.append)
    await source.begin()
    bench = Bench(source, hardware, told)
    source.listen(bench.announced.append)
    async with running(source.run):
        yield bench


# --- over MAVLink ----------------------------------------------------------------------------
EPOCH_S = 1_790_000_000.0
AHEAD_S = 100.0
"""Time between the start of the vehicle and that of the loop, s."""


class Ordered:
    """A camera that takes pictures only as ordered, at the other end of a session.

    `component` answers the commands: a camera component, or the autopilot.
    """

    def __init__(self, component):
        self.peer = Peer()
        self.component = component
        self.there = True
        self.left = 0
        self.interval_s = 0.0
        self.last_s = -1e9
        self.taken = 0
        self.peer.answer = self._answer

    def _answer(self, message):
        if not self.there or message.get_type() != "COMMAND_LONG":
            return
        if message.target_component != self.component:
            return
        if message.command == mav.MAV_CMD_IMAGE_START_CAPTURE:
            if self.left:
                self._ack(message.command, mav.MAV_RESULT_TEMPORARILY_REJECTED)
                return
            self.interval_s, self.left = message.param2, int(message.param3) or -1
            self.last_s = -1e9
        elif message.command == mav.MAV_CMD_IMAGE_STOP_CAPTURE:
            self.left = 0
        self._ack(message.command, mav.MAV_RESULT_ACCEPTED)

    def _ack(self, command, result):
        self.peer.send(
            mav.MAVLink_command_ack_message(command, result, 0, 0, 245, 191),
            component=self.component,
        )

    def due(self):
        """Return whether the camera takes a picture now, and record it."""
        now_s = asyncio.get_running_loop().time()
        if not self.left or not self.there or now_s - self.last_s < 0.9 * self.interval_s:
            return False
        self.left -= self.left > 0
        self.last_s = now_s
        return True

    def vanish(self):
        self.there, self.left = False, 0

    def come_back(self):
        self.there = True

    async def telemetry(self):
        """Send heartbeat, position and attitude ten times a second, without delay."""
        loop, peer = asyncio.get_running_loop(), self.peer
        while True:
            boot_ms = round((loop.time() + AHEAD_S) * 1000)
            place = position(LatLon(48.0, 11.0), t_s=boot_ms / 1000.0, amsl_m=500.0)
            level = mav.MAVLink_attitude_message(boot_ms, 0, 0, 0, 0, 0, 0)
            for message in (heartbeat(), place, level):
                peer.session.feed(peer.frame(message, 1))
            await asyncio.sleep(0.1)


class ComponentHardware(Ordered):
    def __init__(self):
        super().__init__(mav.MAV_COMP_ID_CAMERA)
        self.pictures = {}

    async def fetch(self, url):
        if url not in self.pictures:
            raise LinkError(f"{url}: 404")
        return self.pictures[url]

    async def expose(self, number):
        self._announce(number, there=True)

    async def spoil(self, number):
        self._announce(number, there=False)

    def _announce(self, number, there):
        if not self.due():
            return
        index, self.taken = self.taken, self.taken + 1
        url = f"http://127.0.0.1/{number}.jpg"
        if there:
            self.pictures[url] = jpeg(number)
        boot_ms = round((asyncio.get_running_loop().time() + AHEAD_S) * 1000)
        message = mav.MAVLink_camera_image_captured_message(
            boot_ms, 0, 0, 480_000_000, 110_000_000, 500_000, 12_000,
            [0.7071068, 0.0, -0.7071068, 0.0], index, 1, url.encode(),
        )  # fmt: skip
        self.peer.send(message, after_s=0.1, component=self.component)


class TriggerHardware(Ordered):
    def __init__(self, folder):
        super().__init__(mav.MAV_COMP_ID_AUTOPILOT1)
        self.card = FolderHardware(folder)

    async def expose(self, number):
        if self._trigger():
            await self.card.expose(number)

    async def spoil(self, number):
        """Trigger the camera while it is not ready."""
        self._trigger()

    def _trigger(self):
        if not self.due():
            return False
        self.taken += 1
        utc_s = EPOCH_S + asyncio.get_running_loop().time()
        self.peer.send(
            mav.MAVLink_camera_feedback_message(
                round(utc_s * 1e6), 0, 0, self.taken, 480_000_000, 110_000_000, 500.0, 12.0,
                0.0, 0.0, 90.0, 0.0, 0, self.taken,
            ),
            after_s=0.02,
        )  # fmt: skip
        return True

    def vanish(self):
        super().vanish()
        self.card.vanish()

    def come_back(self):
        super().come_back()
        self.card.come_back()


@contextlib.asynccontextmanager
async def mavlink_bench(tmp_path):
    hardware = ComponentHardware()
    source = MavlinkSource(hardware.peer.session, hardware.fetch)
    bench = Bench(source, hardware, [])
    source.listen(bench.announced.append)
    async with running(hardware.telemetry):
        await asyncio.sleep(0.5)
        yield bench


@contextlib.asynccontextmanager
async def triggered_bench(tmp_path):
    folder = tmp_path / "card"
    folder.mkdir()
    hardware, told = TriggerHardware(folder), list[str]()
    session = hardware.peer.session
    session.view.gate.say = told.append
    source = TriggeredSource(session, Mount(), folder, LATENCY_S, told.append, inline)
    await source.begin()
    bench = Bench(source, hardware, told)
    source.listen(bench.announced.append)
    async with running(hardware.telemetry), running(source.run):
        await asyncio.sleep(0.5)
        yield bench


BENCHES = {
    "folder": folder_bench,
    "stream": stream_bench,
    "mavlink": mavlink_bench,
    "triggered": triggered_bench,
}
