"""What a user writes for a camera."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from missions.errors import LinkError

Kind = Literal["mavlink", "device", "url", "libcamera", "gstreamer", "folder", "triggered"]

HELP: Final = (
    "mavlink, v4l2:/dev/video0, libcamera, rtsp://..., http://..., gstreamer:PIPELINE, folder:PATH "
    "or triggered:PATH"
)
_URLS: Final = ("rtsp://", "rtsps://", "http://", "https://")


@dataclass(frozen=True, slots=True)
class CameraSpec:
    """A kind of camera, and where it is."""

    kind: Kind
    target: str
    text: str
    """As it was written."""


def parse_camera(text: str) -> CameraSpec:
    """The camera that a text names. Raises `LinkError` with the remedy.

    >>> parse_camera("v4l2:/dev/video0").target
    '/dev/video0'
    >>> parse_camera("libcamera").target, parse_camera("rtsp://10.0.0.7/main").kind
    ('0', 'url')
    """
    name, colon, rest = text.strip().partition(":")
    if name in ("mavlink", "libcamera") and not colon:
        return CameraSpec("mavlink" if name == "mavlink" else "libcamera", "0", text)
    if text.strip().lower().startswith(_URLS):
        return CameraSpec("url", text.strip(), text)
    if name == "v4l2" and rest.startswith("/dev/"):
        return CameraSpec("device", rest, text)
    if name == "libcamera" and rest.isdecimal():
        return CameraSpec("libcamera", rest, text)
    if name == "gstreamer" and rest.strip():
        return CameraSpec("gstreamer", rest.strip(), text)
    if name == "folder" and rest:
        return CameraSpec("folder", str(Path(rest).expanduser()), text)
    if name == "triggered" and rest:
        return CameraSpec("triggered", str(Path(rest).expanduser()), text)
    raise LinkError(f"{text!r} is not a camera; write {HELP}")
