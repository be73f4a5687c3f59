"""Devices and streams that give one picture after the other, read in a thread of their own.

OpenCV reads V4L2 devices, RTSP and video over HTTP. Programs that write JPEGs to their standard
output read the rest (libcamera, GStreamer).
"""

from __future__ import annotations

import contextlib
import math
import os
import shlex
import shutil
import subprocess
from collections.abc import Callable, Sequence
from typing import Final

import cv2
import numpy as np

from missions.errors import ImageError, LinkError
from uavmap.aircraft.cameras.source import Loaded
from uavmap.base.image_files import MAX_PICTURE_BYTES

OPEN_TIMEOUT_MS: Final = 10_000
READ_TIMEOUT_MS: Final = 5_000
URL_SETTLE_S: Final = 1.5
"""Time that FFmpeg reads ahead to analyse a stream, s; old pictures come first."""
DEVICE_SETTLE_S: Final = 0.3
_CHUNK_BYTES: Final = 1 << 16
_BEGIN, _END = b"\xff\xd8\xff", b"\xff\xd9"


class OpenCvCapture:
    """A device or URL that OpenCV reads. One thread calls all but `interrupt`."""

    def __init__(self, target: str, name: str, size_px: tuple[int, int]) -> None:
        device = target.startswith("/dev/")
        self._name = name
        self.settle_s = DEVICE_SETTLE_S if device else URL_SETTLE_S
        """Time after its opening in which it may give old pictures, real seconds."""
        if device:
            self._capture = cv2.VideoCapture(target, cv2.CAP_V4L2)
            self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, size_px[0])
            self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, size_px[1])
            # an old frame in a buffer would be dated too late
            self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        else:
            limits = [
                cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, OPEN_TIMEOUT_MS,
                cv2.CAP_PROP_READ_TIMEOUT_MSEC, READ_TIMEOUT_MS,
            ]  # fmt: skip
            self._capture = cv2.VideoCapture(target, cv2.CAP_FFMPEG, limits)
        if not self._capture.isOpened():
            self._capture.release()
            remedy = (
                "is it plugged in, free, and may this user read it (group video)?"
                if device
                else "does it play in VLC or ffplay on this computer?"
            )
            raise LinkError(f"{name}: cannot be opened; {remedy}")

    def grab(self) -> bool:
        """Wait for the next picture; return False at the end."""
        return bool(self._capture.grab())

    def retrieve(self) -> Loaded:
        """Return the last grabbed picture. Raises `ImageError`."""
        good, image = self._capture.retrieve()
        if not good or image is None:
            raise ImageError(f"{self._name}: a frame cannot be decoded")
        if image.ndim == 2:
            image = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
        return image.astype(np.uint8, copy=False)

    def interrupt(self) -> None:
        """Do nothing: OpenCV cannot be interrupted; its own limits end a `grab`."""

    def close(self) -> None:
        """Close the device."""
        self._capture.release()


class PipeCapture:
    """A program that writes one JPEG after the other to its standard output."""

    def __init__(self, arguments: Sequence[str], name: str) -> None:
        self.settle_s = DEVICE_SETTLE_S
        self._buffer = bytearray()
        self._jpeg = b""
        if shutil.which(arguments[0]) is None:
            raise LinkError(f"{name}: needs the program {arguments[0]}, which is not installed")
        try:
            self._process = subprocess.Popen(
                list(arguments), stdout=subprocess.PIPE, stdin=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL, bufsize=0, start_new_session=True,
            )  # fmt: skip
        except OSError as error:
            raise LinkError(f"{name}: {arguments[0]} cannot be run: {error.strerror}") from None

    def grab(self) -> bool:
        """Wait for the end of the next JPEG; return False at the end."""
        assert self._process.stdout is not None
        while (jpeg := next_jpeg(self._buffer)) is None:
            try:
                data = os.read(self._process.stdout.fileno(), _CHUNK_BYTES)
            except (OSError, ValueError):  # closed meanwhile
                return False
            if not data or len(self._buffer) > MAX_PICTURE_BYTES:
                return False
            self._buffer += data
        self._jpeg = jpeg
        return True

    def retrieve(self) -> Loaded:
        """Return the last grabbed JPEG."""
        return self._jpeg

    def interrupt(self) -> None:
        """End the program, and with it a waiting `grab`; call it from another thread."""
        with contextlib.suppress(OSError):
            self._process.kill()

    def close(self) -> None:
        """End the program and close its pipe."""
        self.interrupt()
        self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()


Capture = OpenCvCapture | PipeCapture
Open = Callable[[], Capture]
"""Opens a capture; raises `LinkError` with the remedy."""


def next_jpeg(buffer: bytearray) -> bytes | None:
    """Cut the first whole JPEG from the beginning of a stream; None while there is none.

    Cameras' JPEGs carry no thumbnail in such streams, so the first end marker is its end.

    >>> stream = bytearray(bytes.fromhex("00 ffd8ff01ffd9 ffd8ff02"))
    >>> next_jpeg(stream).hex(), next_jpeg(stream), stream.hex()
    ('ffd8ff01ffd9', None, 'ffd8ff02')
    """
    begin = buffer.find(_BEGIN)
    if begin < 0:
        del buffer[: max(len(buffer) - len(_BEGIN) + 1, 0)]
        return None
    end = buffer.find(_END, begin + len(_BEGIN))
    if end < 0:
        del buffer[:begin]
        return None
    jpeg = bytes(buffer[begin : end + len(_END)])
    del buffer[: end + len(_END)]
    return jpeg


def libcamera_command(number: str, size_px: tuple[int, int], interval_s: float) -> list[str]:
    """Return a command that writes JPEGs of a Raspberry Pi's camera to its standard output.

    It writes more than ordered: each picture is fresh when it is due.
    """
    program = "rpicam-vid" if shutil.which("rpicam-vid") else "libcamera-vid"
    width, height = size_px
    return [
        program, "--camera", number, "--codec", "mjpeg", "--quality", "95", "--width", str(width),
        "--height", str(height), "--framerate", str(min(max(math.ceil(3.0 / interval_s), 5), 30)),
        "--timeout", "0", "--nopreview", "--flush", "--output", "-",
    ]  # fmt: skip


def gstreamer_command(pipeline: str) -> list[str]:
    """Return a command that writes JPEGs of a raw-video pipeline to its standard output."""
    tail = "videoconvert ! jpegenc quality=95 ! fdsink fd=1 sync=false"
    return ["gst-launch-1.0", "-q", *shlex.split(pipeline), *f"! {tail}".split()]
