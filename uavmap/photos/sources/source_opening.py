"""What a path given to `uavmap replay` is: a folder or photograph, a video, an earlier flight."""

from __future__ import annotations

from pathlib import Path

from uavmap.journal.kept_frames import FRAMES, POSES
from uavmap.photos.sources.flight_frames import FlightFrames
from uavmap.photos.sources.photo_folder import VIDEOS, Folder
from uavmap.photos.sources.picture_record import PictureSource
from uavmap.photos.sources.video import Video


def open_source(path: Path, video_start_s: float | None = None) -> PictureSource:
    """The source at a path. Raises `ImageError` where there is none.

    `video_start_s`: when a video begins, in seconds since 1970; for one with a .tlog beside it.
    """
    if path.is_file() and path.suffix.lower() in VIDEOS:
        return Video(path, video_start_s)
    if (path / FRAMES / POSES).is_file():
        return FlightFrames(path)
    return Folder(path)
