"""A folder that fills up with pictures, as a source: for a camera with its own rhythm."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, TypeVar

from PIL import ExifTags

from missions.errors import ImageError, LinkError
from uavmap.aircraft.cameras.source import Announcement, LocalSource
from uavmap.base.image_files import MAX_PICTURE_BYTES, opened
from uavmap.mavlink.continuity import RecentLeast

SUFFIXES: Final = frozenset({".jpg", ".jpeg", ".png"})
POLL_S: Final = 0.04
"""Interval of looks into the folder, s: the time of a new file is known within this."""
STABLE_S: Final = 1.0
"""Time without a change after which a file counts as whole, s."""
_ENDS: Final = (b"\xff\xd9", b"\x00\x00\x00\x00IEND\xaeB\x60\x82")
_TAIL_BYTES: Final = 64
"""Bytes at the end of a file: some cameras write a little after the end of a JPEG."""


@dataclass(slots=True)
class NewFile:
    """A picture that grows, or is whole; `appeared_s` is good to +-`unsure_s`, on our clock."""

    path: Path
    size: int
    since_s: float
    """Time since which it has this size, s."""
    appeared_s: float
    unsure_s: float


@dataclass(slots=True)
class FolderWatch:
    """Watches one folder for new pictures; files at the first look are not new.

    Files whose names begin with a dot, or have another ending than pictures, are ignored. So write
    under such a name and rename, or write in place.
    """

    folder: Path
    _known: dict[str, NewFile | None] = field(default_factory=dict)
    """Known files; None: passed on, or there from the beginning."""
    _looked_s: float | None = None

    def new_files(self, now_s: float) -> list[NewFile]:
        """Return the pictures that became whole since the last look, in their order.

        Raises `LinkError` if the folder cannot be read; known files stay known.
        """
        sizes = self._sizes()
        before_s, self._looked_s = self._looked_s, now_s
        if before_s is None:
            self._known = dict.fromkeys(sizes)
            return []
        for name in [name for name in self._known if name not in sizes]:
            del self._known[name]
        found = []
        for name, size in sizes.items():
            if name in self._known and self._known[name] is None:
                continue
            file = self._known.get(name)
            if file is None:
                middle_s, half_s = (before_s + now_s) / 2.0, (now_s - before_s) / 2.0
                path = self.folder / name
                self._known[name] = NewFile(path, size, now_s, middle_s, half_s)
                continue
            if size != file.size:
                file.size, file.since_s = size, now_s
                continue
            if (size > 0 and _ends(file.path)) or now_s - file.since_s >= STABLE_S:
                self._known[name] = None
                found.append(file)
        return sorted(found, key=lambda f: (f.appeared_s, f.path.name))

    def _sizes(self) -> dict[str, int]:
        sizes = {}
        try:
            with os.scandir(self.folder) as entries:
                for entry in entries:
                    if self._known.get(entry.name, ...) is None:
                        sizes[entry.name] = 0  # no need to ask the disk again
                        continue
                    suffix = os.path.splitext(entry.name)[1].lower()
                    if suffix not in SUFFIXES or entry.name.startswith("."):
                        continue
                    if entry.is_file():
                        sizes[entry.name] = entry.stat().st_size
        except FileNotFoundError:
            if not self.folder.is_dir():
                raise LinkError(f"{self.folder}: no such folder") from None
            # else a file vanished between two steps: the next look finds it
        except OSError as error:
            raise LinkError(f"{self.folder}: cannot be read: {error.strerror}") from None
        return sizes


def _ends(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(max(size - _TAIL_BYTES, 0))
            tail = file.read()
    except OSError:
        return False
    return any(end in tail for end in _ENDS)


def read_file(path: Path) -> bytes:
    """Return the bytes of a picture. Raises `LinkError`."""
    try:
        if path.stat().st_size > MAX_PICTURE_BYTES:
            raise LinkError(f"{path}: a picture has at most {MAX_PICTURE_BYTES} bytes")
        return path.read_bytes()
    except OSError as error:
        raise LinkError(f"{path} cannot be read: {error.strerror}") from None


def exif_time_s(path: Path) -> float | None:
    """Return EXIF DateTimeOriginal with SubsecTimeOriginal, in seconds of the camera's clock.

    None if a tag is missing: whole seconds are too coarse for a position.
    """
    try:
        with opened(path, str(path)) as picture:
            detail = picture.getexif().get_ifd(ExifTags.IFD.Exif)
    except ImageError:
        return None
    text = str(detail.get(ExifTags.Base.DateTimeOriginal, "")).strip("\0 ")
    parts = str(detail.get(ExifTags.Base.SubsecTimeOriginal, "")).strip("\0 ")
    if not (parts.isascii() and parts.isdigit()):
        return None
    try:
        whole = datetime.strptime(text, "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC).timestamp()
    except ValueError:
        return None
    return whole + float(f"0.{parts}")


@dataclass(slots=True)
class CardClock:
    """A camera's clock beside ours: the shortest delay after an exposure shows it best."""

    same_s: float = 30.0
    """Maximum delay of a file, s; a longer one means that the camera's clock was set."""
    lead: RecentLeast = field(default_factory=lambda: RecentLeast(60.0))
    """Minimum time from an exposure to its file, by both clocks, s."""

    def taken_s(self, told_s: float, received_s: float) -> float:
        """Return the exposure of a picture on our clock, by the shortest delay of a file, s."""
        lead_s, least_s = received_s - told_s, self.lead.value
        if least_s is not None and abs(lead_s - least_s) > self.same_s:
            self.lead.clear()
        self.lead.add(lead_s, received_s)
        return told_s + (self.lead.value or 0.0)


MAX_TIME_ERROR_S: Final = 0.25
"""Maximum uncertainty of a picture's time, +- s; beyond it its place is unknown."""
_LOG_INTERVAL_S: Final = 10.0

T = TypeVar("T")
Slowly = Callable[[Callable[[], T]], Awaitable[T]]
"""Runs slow work: `asyncio.to_thread`, but for tests on virtual time."""
Log = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class CardPicture:
    """A picture in a folder, with the best estimate of its time."""

    path: Path
    taken_s: float
    """Time of the exposure on the loop's clock, s."""
    fault: str | None


class Card:
    """The pictures of a folder, one after the other, as they become whole."""

    def __init__(
        self, folder: Path, latency_s: float, say: Log, slowly: Slowly[Any] = asyncio.to_thread
    ) -> None:
        self.folder = folder
        self._latency_s = latency_s
        self._log = say
        self._slowly = slowly
        self._watch = FolderWatch(folder)
        self._clock = CardClock()
        self._logged_s = float("-inf")

    async def begin(self) -> None:
        """Note the existing files. Raises `LinkError` without such a folder."""
        loop = asyncio.get_running_loop()
        await self._slowly(lambda: self._watch.new_files(loop.time()))

    async def run(self, found: Callable[[CardPicture], None]) -> None:
        """Call `found` with each new picture, until cancelled; the folder may vanish and return."""
        loop = asyncio.get_running_loop()

        def look() -> list[tuple[NewFile, float | None]]:
            return [(new, exif_time_s(new.path)) for new in self._watch.new_files(loop.time())]

        while True:
            try:
                for new, exif_s in await self._slowly(look):
                    found(self._picture(new, exif_s))
            except LinkError as error:
                if loop.time() - self._logged_s >= _LOG_INTERVAL_S:
                    self._logged_s = loop.time()
                    self._log(str(error))
            await asyncio.sleep(POLL_S)

    def _picture(self, new: NewFile, exif_s: float | None) -> CardPicture:
        at_s = new.appeared_s
        if exif_s is not None:
            at_s = round(self._clock.taken_s(exif_s, new.appeared_s), 6)
        # its own clock gives a picture's time, however late the file is seen
        vague = exif_s is None and new.unsure_s > MAX_TIME_ERROR_S
        fault = "its time is unknown: the folder is too slow" if vague else None
        return CardPicture(new.path, at_s - self._latency_s, fault)

    async def load(self, path: Path) -> bytes:
        """Return the bytes of a picture. Raises `LinkError`."""
        data: bytes = await self._slowly(lambda: read_file(path))
        return data


class FolderSource(LocalSource):
    """The pictures of a folder; those that appear without an order are left out."""

    def __init__(
        self, folder: Path, latency_s: float, say: Log, slowly: Slowly[Any] = asyncio.to_thread
    ) -> None:
        super().__init__(latency_s)
        self._card = Card(folder, latency_s, say, slowly)

    async def begin(self) -> None:
        """Note the existing files. Raises `LinkError` without such a folder."""
        await self._card.begin()

    async def run(self) -> None:
        """Watch the folder until cancelled."""
        await self._card.run(self._announce)

    def _announce(self, picture: CardPicture) -> None:
        if self._cadence.selects(picture.taken_s):
            self._deliver(
                Announcement(
                    name=str(picture.path),
                    taken_s=picture.taken_s,
                    load=lambda: self._card.load(picture.path),
                    fault=picture.fault,
                )
            )
