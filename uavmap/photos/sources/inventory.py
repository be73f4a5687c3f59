"""All pictures of a source by their tags: what is there, what is there twice, what is none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from missions.errors import ImageError
from uavmap.journal.kept_frames import FRAMES, POSES
from uavmap.photos.sources.duplicate_pictures import different
from uavmap.photos.sources.flight_frames import FlightFrames
from uavmap.photos.sources.photo_folder import VIDEOS, Folder
from uavmap.photos.sources.picture_record import Picture, PictureSource, Refused
from uavmap.photos.sources.video import Video


@dataclass(frozen=True, slots=True)
class Gathered:
    """What a source holds.

    Attributes:
        source: What to call it.
        pictures: Different pictures, in the order in which they were taken; those that do not say
            when come last.
        refused: What should be a picture and is none, or is one that is there already.
        copies: How many of `refused` are copies of another picture.
        left_out: What else lies there, a line a kind.
        refined: Pictures with the poses that their overlaps give them, by name.
        upside_down: The names of those among them that were stored so.
    """

    source: str
    pictures: tuple[Picture, ...]
    refused: tuple[Refused, ...]
    copies: int
    left_out: tuple[str, ...]
    refined: Mapping[str, Picture] = field(default_factory=dict)
    upside_down: frozenset[str] = frozenset()

    @property
    def posed(self) -> tuple[Picture, ...]:
        """The pictures with the best poses that there are, in the same order."""
        return tuple(self.refined.get(picture.name, picture) for picture in self.pictures)

    def none_usable(self, refused: Mapping[str, str]) -> ImageError:
        """Return the error for pictures of which none can be used, from the reasons by name."""
        name, reason = next(iter(refused.items()))
        more = f" (and {len(refused) - 1} more)" if len(refused) > 1 else ""
        return ImageError(f"{self.source}: no picture can be used: {name}: {reason}{more}")


def gather(source: PictureSource) -> Gathered:
    """Read the tags of every picture.

    Raises `ImageError` where there is no picture at all; a line says what there is instead.
    """
    pictures: list[Picture] = []
    refused: list[Refused] = []
    for found in source.pictures():
        if isinstance(found, Picture):
            pictures.append(found)
        else:
            refused.append(found)
    left_out = tuple(source.left_out())
    if not pictures and not refused:
        there = f"; there are {', '.join(left_out)}" if left_out else ""
        raise ImageError(
            f"{source.name}: no pictures (*.jpg, *.jpeg, *.png, *.tif, *.tiff) in this folder or "
            f"those below it{there}"
        )
    if not pictures:
        first = refused[0]
        more = f" (and {len(refused) - 1} more)" if len(refused) > 1 else ""
        raise ImageError(
            f"{source.name}: no picture can be read: {first.name}: {first.reason}{more}"
        )
    kept, copies = different(pictures)
    return Gathered(source.name, kept, (*refused, *copies), len(copies), left_out)


def open_source(path: Path, video_start_s: float | None = None) -> PictureSource:
    """The source at a path. Raises `ImageError` where there is none.

    `video_start_s`: when a video begins, in seconds since 1970; for one with a .tlog beside it.
    """
    if path.is_file() and path.suffix.lower() in VIDEOS:
        return Video(path, video_start_s)
    if (path / FRAMES / POSES).is_file():
        return FlightFrames(path)
    return Folder(path)
