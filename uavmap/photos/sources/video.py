"""A video with its telemetry beside it, a DJI's captions or a .tlog: a picture of it a second."""

from __future__ import annotations

import hashlib
import math
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.errors import ImageError
from uavmap.photos.sources.focal_length import film_lens
from uavmap.photos.sources.photo_file import Pixels, reduced
from uavmap.photos.sources.picture_record import Picture, Refused
from uavmap.photos.sources.video_telemetry import Moment, nearest, read_srt, read_tlog
from vision.registration.views import Measured

EVERY_S: Final = 1.0
"""Time between frames, s: a video from a stand-still adds no evidence beyond one frame."""
_AHEAD: Final = 4  # frames that were passed while another thread asked for a later one
_POSITION_SIGMA_M: Final = 5.0
_LARGEST_SIDE: Final = 10_000
_LONGEST_FRAMES: Final = 10_000_000


@dataclass(slots=True)
class Video:
    """The frames of a video at an interval of `EVERY_S`, with the telemetry of the file beside it.

    `start_utc_s`, in seconds since 1970, ties the video to a .tlog. Raises `ImageError` on creation
    if the video or the telemetry cannot be read.
    """

    path: Path
    start_utc_s: float | None = None
    _moments: tuple[Moment, ...] = field(init=False, repr=False)
    _reader: _Reader = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._moments = self._telemetry()
        self._reader = _Reader(self.path)

    def _telemetry(self) -> tuple[Moment, ...]:
        """Return the moments beside the video, in seconds from its start."""
        beside = {path.suffix.lower(): path for path in self.path.parent.glob("*.*")
                  if path.stem == self.path.stem and path.is_file()}  # fmt: skip
        if ".srt" in beside:
            return read_srt(beside[".srt"])
        if ".tlog" not in beside:
            raise ImageError(
                f"{self.path}: no {self.path.stem}.SRT (a DJI's captions) and no "
                f"{self.path.stem}.tlog beside it; one of them says where each frame was taken"
            )
        if self.start_utc_s is None:
            raise ImageError(
                f"{self.path}: when did the recording begin? Its .tlog tells times of day; give "
                "--video-start 2024-05-01T10:11:12Z"
            )
        start_s = self.start_utc_s
        logged = read_tlog(beside[".tlog"])
        return tuple(replace(moment, t_s=moment.t_s - start_s) for moment in logged)

    def pictures(self) -> Iterator[Picture | Refused]:
        """See `uavmap.photos.sources.picture_record.PictureSource`."""
        reader = self._reader
        for index in range(0, reader.count, reader.step):
            t_s = index / reader.frames_s
            moment = nearest(self._moments, t_s)
            name = f"{self.path.name}#{index}"
            if abs(moment.t_s - t_s) > EVERY_S + 1.0:
                yield Refused(name, f"no telemetry of it (the nearest is of {moment.t_s:.1f} s)")
                continue
            yield self._picture(name, index, t_s, moment)

    def left_out(self) -> tuple[str, ...]:
        """See `uavmap.photos.sources.picture_record.PictureSource`."""
        return ()

    def _picture(self, name: str, index: int, t_s: float, moment: Moment) -> Picture:
        reader = self._reader
        size = (reader.width_px, reader.height_px)
        return Picture(
            name,
            VideoFrame(reader, index),
            *size,
            taken_s=t_s,
            clock="relative",
            position=moment.position,
            position_sigma_m=_POSITION_SIGMA_M,
            height_m=_measured(moment.height_m, 2.0),
            amsl_m=_measured(moment.amsl_m, 10.0),
            yaw_deg=_measured(None if moment.yaw_deg is None else moment.yaw_deg % 360.0, 5.0),
            pitch_deg=_measured(moment.pitch_deg, 1.0),
            roll_deg=_measured(moment.roll_deg, 1.0),
            lens=None if moment.film_mm is None else film_lens(moment.film_mm, *size),
            lens_from="" if moment.film_mm is None else "the captions of the video",
        )


def _measured(value: float | None, sigma: float) -> Measured | None:
    return None if value is None else Measured(value, sigma)


@dataclass(frozen=True, slots=True)
class VideoFrame:
    """The pixels of a frame."""

    reader: _Reader
    index: int

    @property
    def size_bytes(self) -> int:
        """Frames have no files: their number tells them apart."""
        return self.index

    def digest(self) -> str:
        """See `uavmap.photos.sources.picture_record.Content`."""
        return hashlib.sha256(f"{self.reader.path.name}#{self.index}".encode()).hexdigest()

    def decode(self, max_width_px: int) -> Pixels:
        """See `uavmap.photos.sources.picture_record.Content`."""
        return reduced(self.reader.frame(self.index), max_width_px)


class _Reader:
    """A video, read forwards; a request for an earlier frame begins it again."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()
        self._passed: dict[int, NDArray[np.uint8]] = {}
        self._next = 0
        self._video = self._opened()
        get = self._video.get
        self.width_px = round(get(cv2.CAP_PROP_FRAME_WIDTH))
        self.height_px = round(get(cv2.CAP_PROP_FRAME_HEIGHT))
        self.frames_s = get(cv2.CAP_PROP_FPS)
        self.count = round(get(cv2.CAP_PROP_FRAME_COUNT))
        sides = (self.width_px, self.height_px)
        plain = all(1 <= side <= _LARGEST_SIDE for side in sides)
        rate = math.isfinite(self.frames_s) and 0.1 < self.frames_s < 1000.0
        if not (plain and rate and 0 < self.count <= _LONGEST_FRAMES):
            raise ImageError(f"{path}: not a readable video")
        self.step = max(1, round(self.frames_s * EVERY_S))

    def frame(self, index: int) -> NDArray[np.uint8]:
        """Return a frame by its number from 0. Raises `ImageError` if it cannot be decoded."""
        with self._lock:
            if index in self._passed:
                return self._passed.pop(index)
            if index < self._next:
                self._video.release()
                self._video, self._next = self._opened(), 0
            while self._next < index:
                if not self._video.grab():
                    raise ImageError(f"the video ends at frame {self._next}")
                self._keep_asked()
                self._next += 1
            good, image = self._video.read()
            self._next += 1
            if not good or image is None:
                raise ImageError("the frame cannot be decoded")
            return np.asarray(image, dtype=np.uint8)

    def _keep_asked(self) -> None:
        """Keep passed frames that another thread is about to request."""
        if self._next % self.step:
            return
        good, image = self._video.retrieve()
        if good and image is not None:
            self._passed[self._next] = np.asarray(image, dtype=np.uint8)
            while len(self._passed) > _AHEAD:
                del self._passed[min(self._passed)]

    def _opened(self) -> cv2.VideoCapture:
        video = cv2.VideoCapture(str(self.path))
        if not video.isOpened():
            raise ImageError(f"{self.path}: not a readable video")
        return video
