"""Masks: pictures on which people have painted the region."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from missions.errors import ImageError
from uavmap.base.image_files import opened
from uavmap.photos.sources.photo_file import SUFFIXES

BLACK: Final = 85
WHITE: Final = 170
"""A mask's gray values up to BLACK are not region, from WHITE on region, between them undecided."""
UNDECIDED: Final = 128
_DEEP: Final = 257.0  # 65535 is white
_COLOURED: Final = 48  # levels between the channels of a pixel; JPEG and scaling make some
_MOST_COLOURED: Final = 0.02  # of the pixels: a stray stroke is none
_LABEL: Final = 20  # gray values up to this, and several: numbers of classes and no paint

Gray = NDArray[np.uint8]


def mask_of(data: bytes, name: str) -> Gray:
    """Return a mask as gray values (rows, columns), 0 to 255; transparent pixels are undecided.

    Of 16 bits the upper end is white. Raises `ImageError` for what is no picture, is in colour, or
    holds numbers of classes.
    """
    with opened(io.BytesIO(data), name) as picture:
        if picture.mode.startswith("I"):
            deep = np.asarray(picture).astype(np.float64)
            gray = np.round(np.clip(deep / _DEEP, 0, 255)).astype(np.uint8)
        else:
            gray = _eight_bits(picture, name)
    brightest = int(gray.max())
    if 0 < brightest <= _LABEL:
        raise ImageError(
            f"{name}: its brightest pixel has {brightest} of 255; paint the region white (255) and "
            "what is not region black (numbers of classes are no gray values)"
        )
    return gray


def _eight_bits(picture: Image.Image, name: str) -> Gray:
    rgba = np.asarray(picture.convert("RGBA"))
    seen = rgba[..., 3] >= UNDECIDED
    rgb = rgba[..., :3]
    spread = rgb.max(axis=2).astype(np.int16) - rgb.min(axis=2)
    if np.count_nonzero((spread > _COLOURED) & seen) > _MOST_COLOURED * seen.size:
        raise ImageError(
            f"{name}: is in colour; paint white where the region is, black where it is not and "
            "mid-grey where you cannot tell, in a picture without anything else"
        )
    gray = np.array(cv2.cvtColor(np.ascontiguousarray(rgb), cv2.COLOR_RGB2GRAY), np.uint8)
    gray[~seen] = UNDECIDED
    return gray


def masks_by_picture(
    pictures: Sequence[Path], files: Iterable[Path]
) -> Iterator[tuple[Path, Path]]:
    """Yield each mask among some files with its picture: `NAME.png`, or `NAME.JPG.png`.

    Raises `ImageError` for a mask without a picture, two of one picture, and one that is no PNG.
    """
    named = {path.name: path for path in pictures} | {path.stem: path for path in pictures}
    found: dict[Path, Path] = {}
    for file in files:
        suffix, picture = file.suffix.lower(), named.get(file.stem)
        if suffix not in SUFFIXES:
            continue
        if suffix != ".png":
            raise ImageError(
                f"{file}: a mask is a PNG, for others do not keep what was painted; save it as "
                f"{file.stem}.png"
            )
        if picture is None:
            raise ImageError(
                f"{file}: no picture has this name; name it after one of them, such as "
                f"{pictures[0].stem}.png"
            )
        if picture in found:
            raise ImageError(
                f"{file}: {found[picture].name} is a mask of {picture.name}, too; keep one of them"
            )
        found[picture] = file
        yield picture, file
