"""The user's specification of a camera."""

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
    """A kind of camera, and its address."""

    kind: Kind
    target: str
    text: str
    """Original text."""


def parse_camera(text: str) -> CameraSpec:
    """Return the camera of a text. Raises `LinkError` with the remedy.

    >>> parse_camera("v4l2:/dev/video0").target
    '/dev/video0'
    >>> parse_camera("libcamera").target, parse_camera("rtsp://10.0.0.7/main").kind
    ('0', 'url')
    """
    name, colon, rest = text.strip().partition(":")
    if text.strip().lower().startswith(_URLS):
        return CameraSpec("url", text.strip(), text)
    match name:
        case "mavlink" if not colon:
            return CameraSpec("mavlink", "0", text)
        case "libcamera" if rest.isdecimal() or not colon:
            return CameraSpec("libcamera", rest or "0", text)
        case "v4l2" if rest.startswith("/dev/"):
            return CameraSpec("device", rest, text)
        case "gstreamer" if rest.strip():
            return CameraSpec("gstreamer", rest.strip(), text)
        case "folder" if rest:
            return CameraSpec("folder", str(Path(rest).expanduser()), text)
        case "triggered" if rest:
            return CameraSpec("triggered", str(Path(rest).expanduser()), text)
    raise LinkError(f"{text!r} is not a camera; write {HELP}")
