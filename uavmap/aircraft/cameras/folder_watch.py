"""A folder that fills up with pictures: which are new, since when, and when they are whole."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from missions.errors import LinkError
from uavmap.base.image_files import MAX_PICTURE_BYTES

SUFFIXES: Final = frozenset({".jpg", ".jpeg", ".png"})
POLL_S: Final = 0.04
"""Between two looks into the folder: the appearance of a file is known within this."""
STABLE_S: Final = 1.0
"""A file that has not changed for so long is whole, even if it does not look so."""
_ENDS: Final = (b"\xff\xd9", b"\x00\x00\x00\x00IEND\xaeB\x60\x82")
_TAIL_BYTES: Final = 64
"""Some cameras write a little behind the end of a JPEG."""


@dataclass(slots=True)
class _File:
    size: int
    since_s: float
    """Since when it has this size."""
    appeared_s: float
    unsure_s: float


@dataclass(frozen=True, slots=True)
class NewFile:
    """A picture that is whole. `appeared_s` is good to +-`unsure_s`, on the looker's clock."""

    path: Path
    appeared_s: float
    unsure_s: float
    whole: bool
    """Whether it ends as a picture does; else it only does not grow any more."""


@dataclass(slots=True)
class FolderWatch:
    """Looks into one folder; what lies there at the first look is not new.

    Files whose names begin with a dot, or end otherwise than pictures do, are not looked at: write
    under such a name and rename, or write in place.
    """

    folder: Path
    _known: dict[str, _File | None] = field(default_factory=dict)
    """None: taken, or there from the beginning."""
    _looked_s: float | None = None

    def look(self, now_s: float) -> list[NewFile]:
        """The pictures that have become whole since the last look, in their order.

        Raises `LinkError` where the folder cannot be read; what was known stays known.
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
                self._known[name] = _File(size, now_s, middle_s, half_s)
                continue
            if size != file.size:
                file.size, file.since_s = size, now_s
                continue
            whole = size > 0 and _ends(self.folder / name)
            if whole or now_s - file.since_s >= STABLE_S:
                self._known[name] = None
                found.append(NewFile(self.folder / name, file.appeared_s, file.unsure_s, whole))
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
            # else a file went away between two steps: it is looked for again
        except OSError as error:
            raise LinkError(f"{self.folder}: cannot be read: {error.strerror}") from None
        return sizes


def _ends(path: Path) -> bool:
    """Whether a file ends as a picture does."""
    try:
        with path.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(max(size - _TAIL_BYTES, 0))
            tail = file.read()
    except OSError:
        return False
    return any(end in tail for end in _ENDS)


def read_file(path: Path) -> bytes:
    """The bytes of a picture. Raises `LinkError`."""
    try:
        if path.stat().st_size > MAX_PICTURE_BYTES:
            raise LinkError(f"{path}: a picture has at most {MAX_PICTURE_BYTES} bytes")
        return path.read_bytes()
    except OSError as error:
        raise LinkError(f"{path} cannot be read: {error.strerror}") from None
