"""All pictures of a source by their tags: what is there, what is there twice, what is none."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from missions.errors import ImageError
from uavmap.offline.sources.record import Picture, PictureSource, Refused


@dataclass(frozen=True, slots=True)
class Gathered:
    """What a source holds.

    Attributes:
        source: What to call it.
        pictures: Different pictures, in the order in which they were taken; those that do not say
            when come last, by name.
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
    pictures.sort(key=_when)
    different, copies = _different(pictures)
    return Gathered(source.name, different, (*refused, *copies), len(copies), left_out)


def _when(picture: Picture) -> tuple[bool, float, str]:
    return picture.taken_s is None, picture.taken_s or 0.0, picture.name


def _different(pictures: Sequence[Picture]) -> tuple[tuple[Picture, ...], tuple[Refused, ...]]:
    """The pictures without those whose content was there before; the others' names.

    Only pictures of the same size can be the same, so that few are read for it.
    """
    sizes: dict[int, int] = defaultdict(int)
    for picture in pictures:
        sizes[picture.content.size_bytes] += 1
    first: dict[str, str] = {}
    different, copies = [], []
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
        different.append(picture)
    return tuple(different), tuple(copies)
