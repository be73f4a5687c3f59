"""Films and drawings as files: GIF, MP4, PNG, SVG."""

from __future__ import annotations

import io
import os
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final, TypeVar

import cv2
import numpy as np
from PIL import Image

from missions.errors import OutputError
from uavmap.base.atomic_write import write_bytes
from uavmap.output.drawing.palette import TRACKS
from uavmap.output.film.film import FPS, HOLD_S, Film
from uavmap.output.film.stage import KEY_COLOURS, Stage

FILMS: Final = (".gif", ".mp4")
DRAWINGS: Final = (".png", ".svg")
_SAY_EVERY_S: Final = 2.0
_SAMPLES: Final = 4
_UNKNOWN: Final = 255

Say = Callable[[str], None]
T = TypeVar("T")


def check_path(path: Path, suffixes: tuple[str, ...]) -> None:
    """Check the name of a file before work is put into it.

    Raises `OutputError` for another kind, or a folder that does not exist or is read-only.
    """
    if path.suffix.lower() not in suffixes:
        raise OutputError(f"{path}: the name must end in {' or '.join(suffixes)}")
    if path.is_dir():
        raise OutputError(f"{path} is a folder, not a file")
    if not path.parent.is_dir():
        raise OutputError(f"{path} cannot be written: there is no folder {path.parent}")
    if not os.access(path.parent, os.W_OK):
        raise OutputError(f"{path} cannot be written: {path.parent} may not be written to")


def save(path: Path, data: bytes) -> None:
    """Write a file. Raises `OutputError`."""
    try:
        write_bytes(path, data)
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror}") from None


def write_film(film: Film, path: Path, say: Say) -> None:
    """Write a film as GIF or MP4, by the end of the name; report progress every two seconds.

    The same film gives the same GIF, byte for byte. Raises `OutputError`.
    """
    check_path(path, FILMS)
    stage, times = Stage(film), film.times()
    frames = _patiently(stage.frames(times), f"{path.name}: frame {{}} of {len(times)}", say)
    if path.suffix.lower() == ".gif":
        few = _FewColours(film)
        save(path, gif([few.of(frame) for frame in frames]))
    else:
        save(path, mp4(stage.size, frames))


def _patiently(items: Iterable[T], text: str, say: Say) -> Iterator[T]:
    said_s = time.monotonic()
    for number, item in enumerate(items, start=1):
        if time.monotonic() - said_s >= _SAY_EVERY_S:
            said_s = time.monotonic()
            say(text.format(number))
        yield item


def gif(frames: Sequence[Image.Image]) -> bytes:
    """Encode frames that share a palette as a GIF that loops and holds the last."""
    first, *rest = frames
    buffer = io.BytesIO()
    first.save(
        buffer,
        "GIF",
        save_all=True,
        append_images=rest,
        duration=[1000 // FPS] * len(rest) + [round(HOLD_S * 1000)],
        loop=0,
        optimize=False,
    )
    return buffer.getvalue()


class _FewColours:
    """Frames in a palette: colours with a meaning exactly, blends by the nearest colour.

    Pillow's own search for the nearest rounds every colour first: paper would turn grey.
    """

    def __init__(self, film: Film) -> None:
        keys = list(dict.fromkeys((*KEY_COLOURS, *TRACKS)))
        times = film.times()
        chosen = [times[i * (len(times) - 1) // (_SAMPLES - 1)] for i in range(_SAMPLES)]
        mosaic = np.concatenate([np.asarray(frame) for frame in Stage(film).frames(chosen)])
        # one of 256 is left to Pillow, which marks with it what a frame leaves as it was
        blends = Image.fromarray(mosaic).quantize(255 - len(keys), Image.Quantize.MEDIANCUT)
        self._flat = [*(c for key in keys for c in key), *(blends.getpalette() or [])][: 3 * 255]
        self._palette = np.array(self._flat, np.int64).reshape(-1, 3)
        # the index of every colour that there is
        self._indices = np.full(1 << 24, _UNKNOWN, np.uint8)

    def of(self, frame: Image.Image) -> Image.Image:
        # red is the lowest byte
        codes = np.asarray(frame.convert("RGBX")).view("<u4")[..., 0] & 0xFFFFFF
        indices = self._indices[codes]
        for code in np.unique(codes[indices == _UNKNOWN]).tolist():
            colour = (code & 255, code >> 8 & 255, code >> 16)
            self._indices[code] = np.argmin(((self._palette - colour) ** 2).sum(axis=1))
        few = Image.fromarray(self._indices[codes] if _UNKNOWN in indices else indices)
        few.putpalette(self._flat)
        return few


def mp4(size: tuple[int, int], frames: Iterable[Image.Image]) -> bytes:
    """Encode frames as MP4 (MPEG-4 part 2), through a file, as OpenCV needs one.

    Raises `OutputError` where this OpenCV lacks the codec.
    """
    with tempfile.TemporaryDirectory() as folder:
        name = str(Path(folder) / "film.mp4")
        codec = cv2.VideoWriter.fourcc(*"mp4v")
        video = cv2.VideoWriter(name, codec, float(FPS), size)
        if not video.isOpened():
            raise OutputError("this OpenCV cannot write MP4 (codec mp4v is missing); write a .gif")
        for frame in frames:
            last = frame
            video.write(cv2.cvtColor(np.asarray(frame), cv2.COLOR_RGB2BGR))
        for _ in range(round(HOLD_S * FPS)):
            video.write(cv2.cvtColor(np.asarray(last), cv2.COLOR_RGB2BGR))
        video.release()
        return Path(name).read_bytes()
