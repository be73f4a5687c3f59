"""What every source of pictures has to do, whatever it is: one bench, on virtual time.

A bench is a source with the hardware behind it in the test's hands. Its hardware takes pictures on
the test's word, each at a known time.
"""

from __future__ import annotations

import asyncio
import contextlib
import io
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from PIL import Image

from missions.errors import UavmapError
from uavmap.cameras.folder import Card, FolderSource
from uavmap.cameras.source import Announcement, FrameSource
from uavmap.cameras.stream import Grabbed, StreamSource, Wants

SIZE_PX = (64, 48)
LATENCY_S = 0.3


def jpeg(shade: int, exif: Image.Exif | None = None) -> bytes:
    out = io.BytesIO()
    image = Image.new("RGB", SIZE_PX, (shade % 256, 100, 100))
    image.save(out, "JPEG", **({} if exif is None else {"exif": exif}))
    return out.getvalue()


async def inline(function: Callable[[], Any]) -> Any:
    """Instead of a thread: nothing takes time."""
    return function()


class Hardware(Protocol):
    """What takes the pictures of a bench."""

    def expose(self, number: int) -> Awaitable[None]:
        """Take a picture now; it is there `LATENCY_S` later."""
        ...

    def spoil(self, number: int) -> Awaitable[None]:
        """Take one that cannot be had."""
        ...

    def vanish(self) -> None:
        """Be unplugged."""
        ...

    def come_back(self) -> None:
        """Be plugged in again."""
        ...


@dataclass
class Bench:
    source: FrameSource
    hardware: Hardware
    told: list[str]
    heard: list[Announcement] = field(default_factory=list)

    async def shoot(self, count: int, interval_s: float = 1.0, first: int = 0) -> list[float]:
        """Pictures at an interval; when each was exposed."""
        times = []
        for number in range(first, first + count):
            times.append(asyncio.get_running_loop().time())
            await self.hardware.expose(number)
            await asyncio.sleep(interval_s)
        return times

    async def load(self) -> list[bool]:
        """Whether each announced picture can be had."""
        good = []
        for picture in self.heard:
            try:
                await picture.load()
                good.append(True)
            except UavmapError:
                good.append(False)
        return good


# --- a folder --------------------------------------------------------------------------------
class FolderHardware:
    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def later(self, name: str, data: bytes) -> None:
        path = self.folder / name

        def write() -> None:
            with contextlib.suppress(OSError):
                path.write_bytes(data)

        asyncio.get_running_loop().call_later(LATENCY_S, write)

    async def expose(self, number: int) -> None:
        self.later(f"DSC{number:04}.JPG", jpeg(number))

    async def spoil(self, number: int) -> None:
        """Deleted as soon as it was seen."""
        name = f"DSC{number:04}.JPG"
        self.later(name, jpeg(number))
        loop = asyncio.get_running_loop()
        loop.call_later(LATENCY_S + 0.2, (self.folder / name).unlink)

    def vanish(self) -> None:
        self.folder.rename(self.folder.with_suffix(".gone"))

    def come_back(self) -> None:
        self.folder.with_suffix(".gone").rename(self.folder)


@contextlib.asynccontextmanager
async def running(run: Callable[[], Awaitable[None]]) -> AsyncIterator[None]:
    task = asyncio.ensure_future(run())
    try:
        yield
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


@contextlib.asynccontextmanager
async def folder_bench(tmp_path: Path) -> AsyncIterator[Bench]:
    folder = tmp_path / "card"
    folder.mkdir()
    (folder / "OLD.JPG").write_bytes(jpeg(1))
    told: list[str] = []
    source = FolderSource(folder, LATENCY_S, told.append, inline)
    await source.begin()
    bench = Bench(source, FolderHardware(folder), told)
    source.listen(bench.heard.append)
    async with running(source.run):
        yield bench


# --- a stream --------------------------------------------------------------------------------
class StreamHardware:
    """A reader whose frames come from the test."""

    def __init__(self) -> None:
        self._queue: asyncio.Queue[Grabbed | None] = asyncio.Queue()
        self._wants: Wants = lambda t_s: False
        self.there = True
        self.opened = 0

    async def open(self, wants: Wants) -> None:
        from missions.errors import LinkError

        if not self.there:
            raise LinkError("the test's camera cannot be opened")
        self.opened += 1
        self._wants = wants
        if self.opened == 1:  # the first frame is looked at
            self._put(0, np.zeros((SIZE_PX[1], SIZE_PX[0], 3), np.uint8))

    async def next(self) -> Grabbed | None:
        return await self._queue.get()

    async def close(self) -> None:
        pass

    def _put(self, number: int, loaded: Any) -> None:
        there_s = asyncio.get_running_loop().time()
        if self.there and self._wants(there_s):
            self._queue.put_nowait(Grabbed(there_s, loaded))

    async def expose(self, number: int) -> None:
        image = np.full((SIZE_PX[1], SIZE_PX[0], 3), number % 256, np.uint8)
        asyncio.get_running_loop().call_later(LATENCY_S, self._put, number, image)

    async def spoil(self, number: int) -> None:
        from missions.errors import ImageError

        broken = ImageError("half of a frame")
        asyncio.get_running_loop().call_later(LATENCY_S, self._put, number, broken)

    def vanish(self) -> None:
        self.there = False
        self._queue.put_nowait(None)

    def come_back(self) -> None:
        self.there = True


@contextlib.asynccontextmanager
async def stream_bench(tmp_path: Path) -> AsyncIterator[Bench]:
    hardware, told = StreamHardware(), list[str]()
    source = StreamSource("the test's camera", hardware, LATENCY_S, SIZE_PX, told.append)
    await source.begin()
    bench = Bench(source, hardware, told)
    source.listen(bench.heard.append)
    async with running(source.run):
        yield bench


__all__ = ["Bench", "Card", "folder_bench", "running", "stream_bench"]
