"""A folder of photographs with its subfolders, or one photograph; positions from a `geo.txt`.

`geo.txt` is OpenDroneMap's image geolocation file:

    EPSG:4326                      or WGS84 UTM 15N, or a PROJ string
    image x y [z] [yaw pitch roll] [horizontal accuracy] [vertical accuracy] [more]

`x` is the easting, or the longitude. Coordinates replace those of the tags; `z` is a height above
sea level. Angles are degrees; 0 0 0 means "not known". OpenDroneMap counts the pitch from straight
down. Files made from gimbal angles have about -90 there, and are read as such: no camera of a map
points backwards by more than 45 degrees. Older files have omega, phi and kappa in these columns.
Only a comment (`# image x y z omega phi kappa`) distinguishes them.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath

import numpy as np
import pyproj
from pyproj.exceptions import CRSError, ProjError

from missions.errors import ImageError
from missions.units import LatLon
from uavmap.base.printable import printable
from uavmap.base.text_files import read_text
from uavmap.photos.sources.photo_file import SUFFIXES, read_photo
from uavmap.photos.sources.picture_record import Picture, Refused
from vision.registration.views import Measured

LARGEST_BYTES = 64 * 2**20
_DEFAULT_SIGMA_M = 3.0
_SIGMA_DEG = 5.0


@dataclass(frozen=True, slots=True)
class Entry:
    """A line of the file, None for a missing value; angles: yaw, pitch, roll as in `Picture`."""

    position: LatLon
    amsl_m: float | None
    angles_deg: tuple[float, float, float] | None
    horizontal_m: float | None
    vertical_m: float | None


@dataclass(frozen=True, slots=True)
class GeoFile:
    """The entries by picture, and notes on lines that could not be read."""

    path: Path
    entries: Mapping[str, Entry]
    notes: tuple[str, ...]

    def key_of(self, name: str) -> str | None:
        """Return the entry of a picture: by its path below the folder, or by its file name."""
        file_name = PurePosixPath(name).name
        return next((key for key in (name, file_name) if key in self.entries), None)

    def applied(self, picture: Picture, key: str) -> Picture:
        """Return a picture with the values of an entry."""
        entry = self.entries[key]
        picture = replace(
            picture,
            position=entry.position,
            position_sigma_m=entry.horizontal_m or _DEFAULT_SIGMA_M,
            notes=tuple(note for note in picture.notes if "geotag" not in note),
        )
        if entry.amsl_m is not None:
            # the height above the ground stays: the file may count from another sea level
            sigma_m = entry.vertical_m or _DEFAULT_SIGMA_M
            picture = replace(picture, amsl_m=Measured(entry.amsl_m, sigma_m))
        if entry.angles_deg is not None:
            yaw, pitch, roll = (Measured(angle, _SIGMA_DEG) for angle in entry.angles_deg)
            picture = replace(picture, yaw_deg=yaw, pitch_deg=pitch, roll_deg=roll)
        return picture


def read_geo_file(path: Path) -> GeoFile:
    """Read a geo.txt. Raises `ImageError` if its first line is no coordinate system."""
    try:
        lines = read_text(path, LARGEST_BYTES).replace("\ufeff", "").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not a text file in UTF-8"
        raise ImageError(f"{path}: cannot be read ({reason})") from None
    system = _system(lines[0].strip() if lines else "", path)
    to_wgs84 = pyproj.Transformer.from_crs(system, 4326, always_xy=True)
    opk = False
    entries: dict[str, Entry] = {}
    bad: list[int] = []
    for number, line in enumerate(lines[1:], start=2):
        words = line.split()
        if not words:
            continue
        if words[0].startswith("#"):
            opk = opk or "omega" in line.lower()
            continue
        try:
            entries[words[0]] = _entry(words[1:], to_wgs84, opk=opk)
        except (ValueError, ProjError):
            bad.append(number)
    notes: tuple[str, ...] = ()
    if bad:
        which = ", ".join(map(str, bad[:5])) + (" ..." if len(bad) > 5 else "")
        notes = (f"{len(bad)} lines of {path.name} are no positions (line {which})",)
    return GeoFile(path, entries, notes)


def _system(header: str, path: Path) -> pyproj.CRS:
    words = header.split()
    text = header
    if [word.upper() for word in words[:2]] == ["WGS84", "UTM"] and len(words) == 3:
        zone, pole = words[2][:-1], words[2][-1:].upper()
        if zone.isdecimal() and pole in ("N", "S"):
            text = f"EPSG:{(32600 if pole == 'N' else 32700) + int(zone)}"
    try:
        return pyproj.CRS.from_user_input(text)
    except CRSError:
        raise ImageError(
            f"{path}: line 1 is {printable(header)[:60]!r}: expected the coordinate system, such "
            'as "EPSG:4326" or "WGS84 UTM 15N"'
        ) from None


def _entry(words: list[str], to_wgs84: pyproj.Transformer, *, opk: bool) -> Entry:
    numbers: list[float] = []
    for word in words[:8]:
        try:
            numbers.append(float(word))
        except ValueError:
            break  # a label
    if len(numbers) < 2 or not all(map(math.isfinite, numbers)):
        raise ValueError("no position")
    lon, lat = to_wgs84.transform(numbers[0], numbers[1], errcheck=True)
    if not (abs(lat) <= 90.0 and math.isfinite(lon)):
        raise ValueError("no position")
    angles = tuple(numbers[3:6])
    turned: tuple[float, float, float] | None = None
    if len(angles) == 3 and any(angles):
        turned = _from_opk(*angles) if opk else _from_ypr(*angles)
    return Entry(
        LatLon(lat, lon if abs(lon) <= 180.0 else (lon + 180.0) % 360.0 - 180.0),
        numbers[2] if len(numbers) > 2 else None,
        turned,
        _accuracy(numbers, 6),
        _accuracy(numbers, 7),
    )


def _accuracy(numbers: list[float], at: int) -> float | None:
    return numbers[at] if len(numbers) > at and numbers[at] > 0.0 else None


def _from_ypr(yaw: float, pitch: float, roll: float) -> tuple[float, float, float]:
    return yaw % 360.0, pitch if -135.0 <= pitch <= -45.0 else pitch - 90.0, roll


def _from_opk(omega: float, phi: float, kappa: float) -> tuple[float, float, float]:
    """Convert photogrammetry's angles: Rx Ry Rz turn the camera (right, up, backwards).

    >>> [round(a) for a in _from_opk(0.0, 0.0, -90.0)]
    [90, -90, 0]
    """
    (so, co), (sp, cp), (sk, ck) = (
        (math.sin(math.radians(a)), math.cos(math.radians(a))) for a in (omega, phi, kappa)
    )
    turn = (
        np.array([[1, 0, 0], [0, co, -so], [0, so, co]])
        @ np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
        @ np.array([[ck, -sk, 0], [sk, ck, 0], [0, 0, 1]])
    )
    right, up, back = turn.T  # east, north, up
    forward = -back
    pitch = math.asin(max(-1.0, min(1.0, float(forward[2]))))
    if math.hypot(forward[0], forward[1]) < 1e-3:  # straight down: bearing of the upper edge
        return math.degrees(math.atan2(up[0], up[1])) % 360.0, math.degrees(pitch), 0.0
    yaw = math.atan2(forward[0], forward[1])
    level = np.array([math.cos(yaw), -math.sin(yaw), 0.0])
    roll = math.atan2(float(-right[2]), float(right @ level))
    return math.degrees(yaw) % 360.0, math.degrees(pitch), math.degrees(roll)


# --- the folder ----------------------------------------------------------------------------------
VIDEOS = frozenset({".mp4", ".mov", ".avi", ".mkv", ".m4v"})
GEO_FILE = "geo.txt"
RESULT_FILES = frozenset({"journal.jsonl", "detector.toml"})
"""Files of folders that hold results, or a detector with its overlays, and no photographs."""
LOOK_SUFFIX = "-looked"
"""Suffix of a picture on which `uavmap look` has drawn."""
MASK_SUFFIX = "_mask"
"""Suffix of OpenDroneMap's mask of a picture."""
_KINDS_NAMED = 6


@dataclass(slots=True)
class Folder:
    """The photographs below a folder, by path, without the `._` files of a Mac.

    Masks and overlays are left out: pictures without tags that are named after one with tags.
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
        untagged: list[tuple[str, Picture]] = []
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
                    untagged.append((_original(path), found))
                    continue
                taken.add(path.stem)
            yield found
        for original, picture in untagged:
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
        """Yield the files with endings of photographs, in order; count the others."""
        for base, folders, names in os.walk(self.path, onerror=self._unreadable):
            if Path(base) != self.path and not RESULT_FILES.isdisjoint(names):
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
    """Return the stem of the picture of which this one may be a mask or overlay.

    >>> [_original(Path(name)) for name in ("a.png", "a.JPG.png", "a_mask.png", "a-looked.png")]
    ['a', 'a', 'a', 'a']
    """
    stem = path.stem.removesuffix(LOOK_SUFFIX).removesuffix(MASK_SUFFIX)
    drawn_on = Path(stem)
    return drawn_on.stem if drawn_on.suffix.lower() in SUFFIXES else stem


def _names(folder: Path) -> list[str]:
    try:
        return os.listdir(folder)
    except OSError as error:
        raise ImageError(f"{folder}: cannot be read ({error.strerror})") from None


def _named(left: Mapping[str, int]) -> list[tuple[str, int]]:
    """Return the most frequent kinds in a fixed order, the rest together."""
    ranked = sorted(left.items(), key=lambda item: (-item[1], item[0]))
    rest = sum(count for _, count in ranked[_KINDS_NAMED:])
    return ranked[:_KINDS_NAMED] + ([("of other kinds", rest)] if rest else [])
