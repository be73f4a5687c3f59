"""A folder of photographs with its subfolders, or one photograph."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from missions.errors import ImageError
from uavmap.base.printable import printable
from uavmap.photos.sources.geo_txt import GeoFile, read_geo_file
from uavmap.photos.sources.photo_file import SUFFIXES, read_photo
from uavmap.photos.sources.picture_record import Picture, Refused

VIDEOS = frozenset({".mp4", ".mov", ".avi", ".mkv", ".m4v"})
GEO_FILE = "geo.txt"
OURS = frozenset({"journal.jsonl", "detector.toml"})
"""Files of folders that hold results, or a detector with its overlays, and no photographs."""
LOOKED = "-looked"
"""Suffix of a picture on which `uavmap look` has drawn."""
MASK = "_mask"
"""Suffix of OpenDroneMap's mask of a picture."""
_KINDS_NAMED = 6


@dataclass(slots=True)
class Folder:
    """The photographs below a folder, by path, without `._` files of a Mac.

    Masks and overlays are left out: pictures without any tags, named after one that has some.
    Raises `ImageError` on creation for a missing folder or file, and an unreadable geo.txt.
    """

    path: Path
    _left: Counter[str] = field(default_factory=Counter, repr=False)
    _geo: GeoFile | None = field(default=None, repr=False)
    _found: set[str] = field(default_factory=set, repr=False)

    def __post_init__(self) -> None:
        if self.path.is_dir():
            for name in sorted(_names(self.path)):
                if name.lower() == GEO_FILE and (self.path / name).is_file():
                    self._geo = read_geo_file(self.path / name)
                    break
        elif not self.path.is_file():
            raise ImageError(f"{self.path}: no such file or folder")

    def pictures(self) -> Iterator[Picture | Refused]:
        """See `uavmap.photos.sources.picture_record.PictureSource`."""
        self._left.clear()
        self._found.clear()
        if not self.path.is_dir():
            yield read_photo(self.path, self.path.name)
            return
        untold: list[tuple[str, Picture]] = []
        taken: set[str] = set()
        for path in self._photographs():
            name = path.relative_to(self.path).as_posix()
            found = read_photo(path, name)
            if isinstance(found, Picture) and self._geo is not None:
                key = self._geo.key_of(name)
                if key is not None:
                    self._found.add(key)
                    found = self._geo.applied(found, key)
            if isinstance(found, Picture):
                if found.position is None and found.taken_s is None:
                    untold.append((_original(path), found))
                    continue
                taken.add(path.stem)
            yield found
        for original, picture in untold:
            if original in taken:
                self._left["drawn on pictures of the folder: masks, overlays"] += 1
            else:
                yield picture

    def left_out(self) -> tuple[str, ...]:
        """See `uavmap.photos.sources.picture_record.PictureSource`."""
        lines = [f"{count} {what}" for what, count in _named(self._left)]
        if self._geo is not None:
            lines += self._geo.notes
            spare = len(self._geo.entries) - len(self._found)
            if spare:
                lines.append(
                    f"{spare} lines of {self._geo.path.name} name no picture of the folder"
                )
        return tuple(lines)

    def _photographs(self) -> Iterator[Path]:
        """Yield the files that end like photographs, in order; count the others."""
        for base, folders, names in os.walk(self.path, onerror=self._unreadable):
            if Path(base) != self.path and not OURS.isdisjoint(names):
                folders.clear()
                self._left["folders that uavmap has written"] += 1
                continue
            folders[:] = sorted(name for name in folders if not name.startswith("."))
            for name in sorted(names):
                path = Path(base) / name
                suffix = path.suffix.lower()
                if name.startswith("._"):
                    self._left["beginning with ._ (notes of a Mac, no pictures)"] += 1
                elif name.startswith("."):
                    self._left["hidden"] += 1
                elif path.is_symlink() and not path.exists():
                    self._left["links that lead nowhere"] += 1
                elif suffix in SUFFIXES and path.is_file():
                    yield path
                elif suffix in VIDEOS:
                    self._left["videos; give each by itself: uavmap replay FILE"] += 1
                elif name.lower() != GEO_FILE or self._geo is None:
                    self._left[f"of another kind: {printable(suffix) or 'no ending'}"] += 1

    def _unreadable(self, error: OSError) -> None:
        self._left[f"folders that cannot be read ({error.strerror})"] += 1


def _original(path: Path) -> str:
    """Return the stem of the picture on which this one may be drawn.

    >>> [_original(Path(name)) for name in ("a.png", "a.JPG.png", "a_mask.png", "a-looked.png")]
    ['a', 'a', 'a', 'a']
    """
    stem = path.stem.removesuffix(LOOKED).removesuffix(MASK)
    drawn_on = Path(stem)
    return drawn_on.stem if drawn_on.suffix.lower() in SUFFIXES else stem


def _names(folder: Path) -> list[str]:
    try:
        return os.listdir(folder)
    except OSError as error:
        raise ImageError(f"{folder}: cannot be read ({error.strerror})") from None


def _named(left: Mapping[str, int]) -> list[tuple[str, int]]:
    """Return the commonest kinds in a fixed order, the rest together."""
    ranked = sorted(left.items(), key=lambda item: (-item[1], item[0]))
    rest = sum(count for _, count in ranked[_KINDS_NAMED:])
    return ranked[:_KINDS_NAMED] + ([("of other kinds", rest)] if rest else [])
