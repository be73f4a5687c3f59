"""The data in the process of a page: the board now, and at any earlier time."""

from __future__ import annotations

import asyncio
import bisect
from collections.abc import Sequence
from pathlib import Path, PurePath
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from uavmap.output.drawing.judged import FILE as JUDGED
from uavmap.output.drawing.mosaic_file import MOSAIC
from uavmap.ui.page.board import Board, Delta
from uavmap.ui.page.live_geojson import EMPTY, geojson
from uavmap.ui.page.live_map import LiveMap
from uavmap.ui.page.page_pipe import Message

MAX_PICTURES: Final = 24
"""Maximum number of pictures in memory for slow browsers."""
PICTURE_PX: Final = 640
"""Maximum width of a picture, px."""
_QUALITY: Final = 75
_SUFFIXES: Final = (".jpg", ".png")
RESULTS: Final = {MOSAIC: "image/webp", JUDGED: "image/jpeg"}
"""Types of the pictures of the results that a page shows; a flight replaces them."""
KEY_EVERY: Final = 40
"""Number of deltas between two snapshots of a timeline."""


class Timeline:
    """All the deltas of a flight, and the board at any time of it.

    >>> board, timeline = Board(), Timeline()
    >>> for t_s in (0.0, 2.0, 4.0):
    ...     board.set_field("t_s", t_s)
    ...     timeline.add(t_s, board.since(board.version))
    >>> timeline.span, timeline.at(3.0).field("t_s")
    ((0.0, 4.0), 2.0)
    """

    def __init__(self) -> None:
        self._times: list[float] = []
        self._deltas: list[Delta] = []
        self._keys: list[Delta] = []
        self._newest = Board()

    def add(self, t_s: float, delta: Delta) -> None:
        """Add the next delta; mission times do not decrease."""
        self._newest.apply(delta)
        if len(self._times) % KEY_EVERY == 0:
            self._keys.append(self._newest.since(0))
        self._times.append(max(t_s, self._times[-1] if self._times else t_s))
        self._deltas.append(delta)

    @property
    def span(self) -> tuple[float, float]:
        """The first and the last mission time, s."""
        return (self._times[0], self._times[-1]) if self._times else (0.0, 0.0)

    def at(self, t_s: float) -> Board:
        """Return the board at a mission time, or at the first time."""
        index = max(bisect.bisect_right(self._times, t_s) - 1, 0)
        board = Board()
        if self._keys:
            key = index // KEY_EVERY
            board.apply(self._keys[key])
            for delta in self._deltas[key * KEY_EVERY + 1 : index + 1]:
                board.apply(delta)
        return board


class Hub:
    """The messages of a flight for its browsers."""

    def __init__(self, config: Message) -> None:
        self.board = Board()
        self.scene: Message | None = None
        self.ended = ""
        """Reason for the end of the messages; empty before that."""
        self.timeline = Timeline() if config.get("timeline") else None
        self.background = b""
        """Picture beneath the map, JPEG; empty without one."""
        self.answers: dict[str, asyncio.Future[str]] = {}
        self._folder = Path(config["folder"]) if config.get("folder") else None
        self._pictures: dict[str, bytes] = {}
        self.news = asyncio.Event()
        """Event that is set at the next message; then another event replaces it."""
        self._encoded = -1, EMPTY
        """Version of the board, and its map for a GIS."""
        self._encoding = asyncio.Lock()
        self._present: set[object] = set()
        self.unwatched = asyncio.Event()
        """Event that is set while no browser waits for an update."""
        self.unwatched.set()

    def enter(self, visitor: object) -> None:
        """Add a browser, which receives updates."""
        self._present.add(visitor)
        self.unwatched.clear()

    def leave(self, visitor: object) -> None:
        """Remove a browser that is closed or has all updates."""
        self._present.discard(visitor)
        if not self._present:
            self.unwatched.set()

    def wake(self) -> None:
        """Wake the tasks that wait for news."""
        self.news.set()
        self.news = asyncio.Event()

    async def receive(self, message: Message, data: bytes) -> None:
        """Receive a message of the flight (`uavmap.ui.page.page_pipe`)."""
        match message.get("kind"):
            case "scene":
                self.scene = message["scene"]
            case "delta":
                self.board.apply(message["delta"])
                if self.timeline is not None:
                    self.timeline.add(self.board.field("t_s") or 0.0, message["delta"])
            case "picture":
                image = await asyncio.to_thread(_decoded, data, message.get("shape"))
                self._pictures[str(message["id"])] = b"" if image is None else _small(image)
                while len(self._pictures) > MAX_PICTURES:
                    del self._pictures[next(iter(self._pictures))]
            case "background":
                self.background = data
            case "answer":
                answer = self.answers.pop(str(message.get("id")), None)
                if answer is not None and not answer.done():
                    answer.set_result(str(message["text"]))
            case "ended":
                self.ended = str(message["text"])
        self.wake()

    async def geojson(self, *, again: bool) -> bytes:
        """Return the live map for a GIS; `again`: the last one, for a GIS that reads it in parts.

        It is encoded once for each version of the board.
        """
        async with self._encoding:
            version, known = self._encoded
            if (
                self.scene is not None
                and (version < 0 or not again)
                and version != self.board.version
            ):
                version, live = (
                    self.board.version,
                    LiveMap.from_board(self.scene, self.board.since(0)),
                )
                known = await asyncio.to_thread(geojson, live, self.scene)
                self._encoded = version, known
            return known

    async def result(self, name: str) -> bytes:
        """Return one of `RESULTS` as it is now; empty if it does not exist."""
        if self._folder is None or name not in RESULTS:
            return b""
        path = self._folder / name
        return await asyncio.to_thread(lambda: path.read_bytes() if path.is_file() else b"")

    async def picture(self, name: str) -> bytes:
        """Return a picture as JPEG; empty for one that is not kept any more."""
        if name in self._pictures:
            return self._pictures[name]
        plain = PurePath(name).name == name and not name.startswith(".")
        if self._folder is None or not plain or not name.endswith(_SUFFIXES):
            return b""
        return await asyncio.to_thread(_shown, self._folder / "frames" / name)


def _shown(path: Path) -> bytes:
    """Return a picture small enough for a page, as JPEG; empty if it cannot be decoded."""
    image = _decoded(path.read_bytes() if path.is_file() else b"", None)
    return b"" if image is None else _small(image)


def _decoded(data: bytes, shape: Sequence[int] | None) -> NDArray[np.uint8] | None:
    """Decode a picture to shape (rows, columns, 3); None if that is impossible."""
    pixels: Any = np.frombuffer(data, np.uint8)
    if not data:
        return None
    try:
        image = cv2.imdecode(pixels, cv2.IMREAD_COLOR) if shape is None else pixels.reshape(shape)
    except (cv2.error, ValueError):
        return None
    return None if image is None else np.asarray(image, np.uint8)


def _small(image: NDArray[np.uint8]) -> bytes:
    height, width = image.shape[:2]
    if width > PICTURE_PX:
        size = (PICTURE_PX, max(round(height * PICTURE_PX / width), 1))
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()
