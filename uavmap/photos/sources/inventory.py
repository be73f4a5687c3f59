"""All pictures of a source by their tags: what is there, what is there twice, what is none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from missions.errors import ImageError
from uavmap.photos.sources.duplicate_pictures import different
from uavmap.photos.sources.picture_record import Picture, PictureSource, Refused


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
