"""All pictures of a source by their tags, without copies and unreadable files.

A source is a folder of photographs, a video, or the folder of a flight that kept its pictures. The
file pictures.csv has the result for each picture of a replay.
"""

from __future__ import annotations

import csv
import io
import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePath
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.errors import ImageError
from uavmap.base.atomic_write import write_text
from uavmap.base.printable import printable
from uavmap.journal.kept_frames import FRAMES, POSES, KeptFrame, read_kept
from uavmap.photos.sources.photo_file import eight_bits, read_photo
from uavmap.photos.sources.photo_folder import VIDEOS, Folder
from uavmap.photos.sources.picture_record import Picture, PictureSource, Refused, distance_m
from uavmap.photos.sources.video import Video
from vision.camera import Lens, euler
from vision.registration.views import Measured

_POSITION_SIGMA_M = 1.5
_HEIGHT_SIGMA_M = 1.0
_ANGLE_SIGMA_DEG = 2.0


@dataclass(slots=True)
class FlightFrames:
    """The kept pictures of a flight's folder, with their poses in the air."""

    path: Path
    _damaged: list[str] = field(default_factory=list, repr=False)

    def pictures(self) -> Iterator[Picture | Refused]:
        """See `uavmap.photos.sources.picture_record.PictureSource`."""
        self._damaged.clear()
        try:
            for kept in read_kept(self.path):
                if isinstance(kept, str):
                    self._damaged.append(kept)
                else:
                    yield self._picture(kept)
        except (OSError, UnicodeDecodeError) as error:
            raise ImageError(f"{self.path / FRAMES}: its poses cannot be read ({error})") from None

    def left_out(self) -> tuple[str, ...]:
        """See `uavmap.photos.sources.picture_record.PictureSource`."""
        return tuple(self._damaged)

    def _picture(self, kept: KeptFrame) -> Picture | Refused:
        name = PurePath(kept.frame).name  # never a path to another folder
        found = read_photo(self.path / FRAMES / name, name)
        if isinstance(found, Refused):
            return found
        roll, pitch, yaw = (math.degrees(angle) for angle in euler(kept.pose.attitude))
        lens = None
        if 0.0 < kept.hfov_deg < 180.0:
            lens = Lens.pinhole(math.radians(kept.hfov_deg), found.width_px, found.height_px)
        return replace(
            found,
            taken_s=kept.t_s,
            clock="relative",
            position=kept.pose.position,
            position_sigma_m=_POSITION_SIGMA_M,
            height_m=Measured(kept.pose.height_m, _HEIGHT_SIGMA_M),
            yaw_deg=Measured(yaw % 360.0, _ANGLE_SIGMA_DEG),
            pitch_deg=Measured(pitch, _ANGLE_SIGMA_DEG),
            roll_deg=Measured(roll, _ANGLE_SIGMA_DEG),
            lens=lens,
            lens_from="" if lens is None else "the flight that kept them",
            notes=(),
        )


# --- all pictures of a source --------------------------------------------------------------------
@dataclass(frozen=True, slots=True)
class Gathered:
    """The content of a source.

    Attributes:
        pictures: Different pictures, in the order of exposure; those without a time last.
        refused: Files that are no readable picture, or copies.
        left_out: Other files, a line for each kind.
        refined: Pictures with the poses from their overlaps, by name.
        upside_down: Names of those among them that are stored upside down.
        aside: Pictures that affect neither the map nor the poses of others, with reasons.
    """

    source: str
    pictures: tuple[Picture, ...]
    refused: tuple[Refused, ...]
    copies: int
    left_out: tuple[str, ...]
    refined: Mapping[str, Picture] = field(default_factory=dict)
    upside_down: frozenset[str] = frozenset()
    aside: tuple[tuple[Picture, str], ...] = ()

    def without(self, reasons: Mapping[str, str]) -> Gathered:
        """Set pictures aside, by name, as if they were not in the source."""
        aside = [(p, reasons[p.name]) for p in self.pictures if p.name in reasons]
        kept = tuple(p for p in self.pictures if p.name not in reasons)
        return replace(
            self,
            pictures=kept,
            aside=(*self.aside, *aside),
            refined={},
            upside_down=frozenset(),
        )

    @property
    def posed(self) -> tuple[Picture, ...]:
        """The pictures with their best poses, in the same order."""
        return tuple(self.refined.get(picture.name, picture) for picture in self.pictures)

    def none_usable(self, refused: Mapping[str, str]) -> ImageError:
        """Return the error for a source without usable pictures, from the reasons by name."""
        return ImageError(f"{self.source}: no picture can be used: {_first_of(refused)}")


def _first_of(refused: Mapping[str, str]) -> str:
    name, reason = next(iter(refused.items()))
    more = f" (and {len(refused) - 1} more)" if len(refused) > 1 else ""
    return f"{name}: {reason}{more}"


def gather(source: PictureSource) -> Gathered:
    """Read the tags of every picture. Raises `ImageError` if there is none."""
    found = list(source.pictures())
    pictures = [one for one in found if isinstance(one, Picture)]
    refused = [one for one in found if isinstance(one, Refused)]
    left_out = tuple(source.left_out())
    if not pictures and not refused:
        there = f"; there are {', '.join(left_out)}" if left_out else ""
        raise ImageError(
            f"{source.path}: no pictures (*.jpg, *.jpeg, *.png, *.tif, *.tiff) in this folder or "
            f"those below it{there}"
        )
    if not pictures:
        raise ImageError(f"{source.path}: no picture can be read: {_first_of(dict(refused))}")
    kept, copies = different(pictures)
    return Gathered(str(source.path), kept, (*refused, *copies), len(copies), left_out)


def open_source(path: Path, video_start_s: float | None = None) -> PictureSource:
    """Return the source at a path. Raises `ImageError` if there is none.

    `video_start_s`: begin of a video with a .tlog beside it, in seconds since 1970.
    """
    if path.is_file() and path.suffix.lower() in VIDEOS:
        return Video(path, video_start_s)
    if (path / FRAMES / POSES).is_file():
        return FlightFrames(path)
    return Folder(path)


SAME_PLACE_M: Final = 0.5
"""Maximum distance of one capture's tags, m: a copy may have rounded them."""
ALIKE: Final = 0.99
"""Minimum correlation of two small pictures of one capture; the next one over ground has less."""
_ALIKE_LEVELS: Final = 2.0  # minimum contrast for a correlation
_SMALL_PX: Final = (32, 24)
_DECODED_PX: Final = 256

Small = NDArray[np.float32]


def when(picture: Picture) -> tuple[bool, float, float, float, float, int, str]:
    """Return the order of pictures: time, then the content of their files; names come last."""
    place, height = picture.position, picture.height_m
    return (
        picture.taken_s is None,
        picture.taken_s or 0.0,
        0.0 if place is None else place.lat_deg,
        0.0 if place is None else place.lon_deg,
        0.0 if height is None else height.value,
        picture.content.size_bytes,
        picture.name,
    )


def different(pictures: Sequence[Picture]) -> tuple[tuple[Picture, ...], tuple[Refused, ...]]:
    """Return the pictures, each once, in the order of `when`; and the copies, with reasons.

    A copy is no second observation. A file is recognised by its bytes. A capture that was saved
    again (smaller, brighter, at another quality) has the same time, place and nearly the same
    pixels.
    """
    ordered = sorted(pictures, key=when)
    files, same_files = _other_bytes(ordered)
    copies = _same_captures(files)
    kept = tuple(picture for picture in files if picture.name not in copies)
    again = [Refused(name, f"the same capture as {of}") for name, of in sorted(copies.items())]
    return kept, (*same_files, *again)


def _other_bytes(pictures: Sequence[Picture]) -> tuple[list[Picture], list[Refused]]:
    """Return the pictures without those of the same content; and these.

    Only pictures of the same size can be equal, so few are read.
    """
    sizes = Counter(picture.content.size_bytes for picture in pictures)
    first: dict[str, str] = {}
    kept, copies = [], []
    for picture in pictures:
        if sizes[picture.content.size_bytes] > 1:
            try:
                digest = picture.content.digest()
            except ImageError as error:
                copies.append(Refused(picture.name, str(error)))
                continue
            if digest in first:
                copies.append(Refused(picture.name, f"the same file as {first[digest]}"))
                continue
            first[digest] = picture.name
        kept.append(picture)
    return kept, copies


def _same_captures(pictures: Sequence[Picture]) -> dict[str, str]:
    """Return names of captures that have a better copy, with the name of that copy.

    Only pictures of one time and place can be one capture; only these are decoded, small.
    """
    by_time: dict[float, list[Picture]] = defaultdict(list)
    for picture in pictures:
        if picture.taken_s is not None and picture.position is not None:
            by_time[picture.taken_s].append(picture)
    copies: dict[str, str] = {}
    for group in by_time.values():
        if len(group) == 1:
            continue
        kept: list[tuple[Picture, Small]] = []
        for picture in sorted(group, key=_worse):
            small = _small(picture)
            if small is None:
                continue  # the judgement reports the reason
            of = next((k.name for k, seen in kept if _one(picture, small, k, seen)), None)
            if of is None:
                kept.append((picture, small))
            else:
                copies[picture.name] = of
    return copies


def _worse(picture: Picture) -> tuple[int, int, str]:
    return -picture.width_px * picture.height_px, -picture.content.size_bytes, picture.name


def _small(picture: Picture) -> Small | None:
    try:
        image = eight_bits(picture.content.decode(_DECODED_PX))
    except ImageError:
        return None
    gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return cv2.resize(gray, _SMALL_PX, interpolation=cv2.INTER_AREA).astype(np.float32)


def _one(picture: Picture, small: Small, other: Picture, seen: Small) -> bool:
    """Return True for two pictures of one time that are of one place, and nearly the same."""
    assert picture.position is not None
    assert other.position is not None
    if distance_m(picture.position, other.position) > SAME_PLACE_M:
        return False
    if float(np.abs(small - seen).mean()) <= _ALIKE_LEVELS:
        return True
    a, b = small - small.mean(), seen - seen.mean()
    norm = float(np.sqrt((a * a).sum() * (b * b).sum()))
    return norm > 0.0 and float((a * b).sum()) >= ALIKE * norm


# --- pictures.csv --------------------------------------------------------------------------------
PICTURES_FILE: Final = "pictures.csv"
_POSE: Final = ("lat_deg", "lon_deg", "height_m", "yaw_deg", "pitch_deg", "roll_deg")
_REFINED: Final = tuple(f"refined_{column}" for column in _POSE)
COLUMNS: Final = (
    "picture", "used", "reason", "cells", "upside_down", "taken_s", "lat_deg", "lon_deg",
    "height_m", "amsl_m", "yaw_deg", "pitch_deg", "roll_deg", "hfov_deg", *_REFINED,
    "refined_sigma_m", "notes",
)  # fmt: skip
"""The tagged and the refined pose; the latter is empty if none was estimated."""


class PictureRow(NamedTuple):
    """A picture as tagged and as refined, or an unreadable file, and why it is not used."""

    picture: Picture | None
    name: str
    reason: str
    cells: int
    turned: bool
    refined: Picture | None = None


def write_pictures(rows: Iterable[PictureRow], path: Path) -> None:
    """Write a line for each picture."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, COLUMNS, restval="", lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow(_values(row))
    write_text(path, text.getvalue())


def _values(row: PictureRow) -> dict[str, str | int]:
    values: dict[str, str | int] = {
        "picture": _cell(row.name),
        "used": "no" if row.reason else "yes",
        "reason": _cell(row.reason),
        "cells": row.cells,
        "upside_down": "yes" if row.turned else "",
    }
    picture = row.picture
    if picture is None:
        return values
    values |= {
        "taken_s": "" if picture.taken_s is None else f"{picture.taken_s:.3f}",
        **dict(zip(_POSE, _pose(picture), strict=True)),
        "amsl_m": _number(picture.amsl_m),
        "hfov_deg": "" if picture.lens is None else f"{picture.lens.hfov_deg:.2f}",
        "notes": _cell("; ".join(picture.notes)),
    }
    if row.refined is not None and row.refined.position is not None:
        values |= dict(zip(_REFINED, _pose(row.refined), strict=True))
        values["refined_sigma_m"] = f"{row.refined.position_sigma_m:.2f}"
    return values


def _pose(picture: Picture) -> tuple[str, ...]:
    place = picture.position
    angles = picture.height_m, picture.yaw_deg, picture.pitch_deg, picture.roll_deg
    lat_lon = ("", "") if place is None else (f"{place.lat_deg:.8f}", f"{place.lon_deg:.8f}")
    return (*lat_lon, *map(_number, angles))


def _number(measured: Measured | None) -> str:
    return "" if measured is None else f"{measured.value:.2f}"


def _cell(text: str) -> str:
    """Return foreign text in a form that a spreadsheet does not execute as a formula."""
    clean = printable(text)
    return f"'{clean}" if clean[:1] in ("=", "+", "-", "@") else clean
