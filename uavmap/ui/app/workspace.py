"""The folder of the page: its missions, results, pictures and detectors."""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from missions.errors import UavmapError
from uavmap.base.text_files import read_text
from uavmap.journal.flight_plan import JOURNAL
from uavmap.journal.kept_frames import FRAMES

RESULTS: Final = "results"
PICTURES: Final = (".jpg", ".jpeg", ".png", ".tif", ".tiff")
_SUMMARY: Final = "summary.json"
_SUMMARY_BYTES: Final = 1 << 22
_MOST: Final = 200
"""Maximum number of listed folders of each kind; the newest are first."""
_NAME: Final = re.compile(r"[\w. -]{1,60}")
_FILE_NAME: Final = re.compile(r"[^\W_][\w. ()+,-]{0,200}")


@dataclass(frozen=True, slots=True)
class ResultsFolder:
    """The results folder of a flight or a replay, also of one under way."""

    folder: Path
    name: str
    """Path relative to the workspace."""

    @property
    def stamp(self) -> tuple[str, int | None]:
        """Return a value that changes when it ends or continues."""
        try:
            return self.name, (self.folder / _SUMMARY).stat().st_mtime_ns
        except OSError:
            return self.name, None

    def summary(self) -> dict[str, Any] | None:
        """Read its figures; None before its end."""
        try:
            summary = json.loads(read_text(self.folder / _SUMMARY, _SUMMARY_BYTES))
        except (OSError, ValueError):
            return None
        return summary if isinstance(summary, dict) else None


def verdict(summary: dict[str, Any] | None) -> str:
    """Return the end of a flight or a replay in a few words.

    >>> verdict({"completed": True, "patches": [{"area_m2": 1200.4}]})
    'complete, 1,200 m2'
    """
    if summary is None:
        return "under way, or interrupted"
    area_m2 = sum(float(patch.get("area_m2", 0.0)) for patch in summary.get("patches", ()))
    area = f", {area_m2:,.0f} m2" if area_m2 else ""
    return ("complete" if summary.get("completed") else "not complete") + area


@dataclass(frozen=True, slots=True)
class Workspace:
    """A folder on this computer. All paths that a page names must be in it."""

    folder: Path

    def missions(self) -> list[str]:
        """Return the names of the mission files in alphabetical order."""
        return sorted(path.name for path in self.folder.glob("*.toml") if path.is_file())

    def results(self) -> list[ResultsFolder]:
        """Return the results folders; the newest is first."""
        found = self.folder.glob(f"{RESULTS}/*/{JOURNAL}")
        folders = (path.parent for path in _newest(found))
        return [ResultsFolder(folder, str(folder.relative_to(self.folder))) for folder in folders]

    def picture_folders(self) -> list[str]:
        """Return the folders with pictures, except results."""
        folders = (path for path in self.folder.iterdir() if path.is_dir())
        return sorted(
            path.name
            for path in folders
            if path.name != RESULTS and not path.name.startswith(".") and _has_pictures(path)
        )

    def flights_with_pictures(self) -> list[str]:
        """Return the names of the flights with kept pictures; the newest is first."""
        return [flown.name for flown in self.results() if (flown.folder / FRAMES).is_dir()]

    def folder_to_paint(self, name: str) -> str:
        """Return the folder with the pictures of photographs or of a flight."""
        return f"{name}/{FRAMES}" if (self.folder / name / FRAMES).is_dir() else name

    def detectors(self) -> list[str]:
        """Return the folders made by `uavmap tune`."""
        return sorted(path.parent.name for path in self.folder.glob("*/detector.toml"))

    def path_of(self, name: str) -> Path:
        """Return the path of a file of this folder. Raises `UavmapError` for one elsewhere."""
        path = (self.folder / name).resolve()
        if not path.is_relative_to(self.folder.resolve()):
            raise UavmapError(f"{name}: not in {self.folder}; choose a file of this folder")
        return path

    def place_for(self, folder: str, name: str) -> Path:
        """Return the path for a file from a browser, in the subfolder `folder`, or in this for "".

        Raises `UavmapError` for a name that a command would misread, and for a file that exists.
        """
        for part in filter(None, (folder, name)):
            if not _FILE_NAME.fullmatch(part):
                raise UavmapError(f"{part!r}: use letters, digits, spaces, '-', '_', '.'")
        path = self.path_of(str(Path(folder, name)))
        if path.exists():
            raise UavmapError(f"{name}: already exists; choose another name")
        return path

    def new_folder(self, name: str) -> str:
        """Return the name of a new folder: `name`, with a number if it exists."""
        return next(
            each
            for number in itertools.count(1)
            if not (self.folder / (each := name if number == 1 else f"{name}-{number}")).exists()
        )

    def new_name(self, wanted: str, ending: str) -> str:
        """Return the name of a new file. Raises `UavmapError` for a bad name."""
        name = wanted.strip().removesuffix(ending)
        if not _NAME.fullmatch(name) or name.startswith((".", "-")):
            raise UavmapError(
                f"name = {wanted!r}: use letters, digits, spaces, '-' and '_', at most 60"
            )
        if (self.folder / (name + ending)).exists():
            raise UavmapError(f"{name}{ending}: already exists; choose another name")
        return name + ending


def _newest(paths: Iterable[Path]) -> list[Path]:
    return sorted(paths, key=lambda path: path.stat().st_mtime, reverse=True)[:_MOST]


def _has_pictures(folder: Path) -> bool:
    return any(path.suffix.lower() in PICTURES for path in folder.iterdir())
