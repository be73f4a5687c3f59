"""The opening of a camera from its specification by the user."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from uavmap.aircraft.cameras.captures import (
    Capture,
    OpenCvCapture,
    PipeCapture,
    gstreamer_command,
    libcamera_command,
)
from uavmap.aircraft.cameras.folder import FolderSource, Log, Slowly
from uavmap.aircraft.cameras.mavlink import Fetch, MavlinkSource
from uavmap.aircraft.cameras.pose import Mount
from uavmap.aircraft.cameras.source import FrameSource
from uavmap.aircraft.cameras.spec import CameraSpec
from uavmap.aircraft.cameras.stream import StreamSource, ThreadReader
from uavmap.aircraft.cameras.triggered import TriggeredSource
from uavmap.mavlink.session import Session

RESTART_WAIT_S: Final = 1.0


@dataclass(frozen=True, slots=True)
class Settings:
    """The camera of a mission file (`camera`), or of a command line."""

    size_px: tuple[int, int]
    interval_s: float
    latency_s: float
    mount: Mount


@contextlib.asynccontextmanager
async def opened_camera(
    spec: CameraSpec,
    session: Session,
    fetch: Fetch,
    settings: Settings,
    say: Log,
    slowly: Slowly[Any] = asyncio.to_thread,
) -> AsyncIterator[FrameSource]:
    """Open the source of a specification; `say` logs its events.

    Raises `LinkError` if it cannot be opened, or does not fulfil `settings`.
    """
    if spec.kind == "mavlink":
        yield MavlinkSource(session, fetch)
        return
    source: FolderSource | TriggeredSource | StreamSource
    if spec.kind == "folder":
        source = FolderSource(Path(spec.target), settings.latency_s, say, slowly)
    elif spec.kind == "triggered":
        folder, mount = Path(spec.target), settings.mount
        source = TriggeredSource(session, mount, folder, settings.latency_s, say, slowly)
    else:
        reader = ThreadReader(partial(_capture, spec, settings))
        source = StreamSource(spec.text, reader, settings.latency_s, settings.size_px, say)
    await source.begin()
    running = asyncio.create_task(_kept_running(spec, source.run, say))
    try:
        yield source
    finally:
        running.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await running


async def _kept_running(spec: CameraSpec, run: Callable[[], Any], say: Log) -> None:
    """Restart a camera after any error, which is logged: it never ends a mission."""
    while True:
        try:
            await run()
        except Exception as error:
            say(f"{spec.text}: {error or type(error).__name__}; it is restarted")
        await asyncio.sleep(RESTART_WAIT_S)


def _capture(spec: CameraSpec, settings: Settings) -> Capture:
    if spec.kind == "libcamera":
        command = libcamera_command(spec.target, settings.size_px, settings.interval_s)
        return PipeCapture(command, spec.text)
    if spec.kind == "gstreamer":
        return PipeCapture(gstreamer_command(spec.target), spec.text)
    return OpenCvCapture(spec.target, spec.text, settings.size_px)
