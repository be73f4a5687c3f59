"""Pictures and their painted examples.

A mask is a picture of the same shape, named after the photograph: white is region, black is not,
mid-grey is undecided. If `classes.toml` is beside it, its gray values, or indices of its palette,
are numbers of classes. Polygons are in `uavmap.photos.tune.polygons`.
"""

from __future__ import annotations

import io
import itertools
import tomllib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pydantic import ValidationError

from missions.classes import Classes
from missions.errors import ImageError
from missions.mission.messages import explain
from uavmap.base.image_files import opened
from uavmap.base.text_files import read_text
from uavmap.photos.sources.photo_file import SUFFIXES, decoded, eight_bits
from uavmap.photos.tune.polygons import REGION, SURROUND, UNKNOWN, Polygons
from vision.detectors.pixel_features import working_picture

BLACK: Final = 85
WHITE: Final = 170
"""Gray values of a mask: up to BLACK not region, from WHITE on region, between them undecided."""
UNDECIDED: Final = 128
CLASSES_TOML: Final = "classes.toml"
"""File beside examples of several classes: the table `[detector.classes]`, without its heading."""
_DEEP: Final = 257.0  # 65535 is white
_COLOURED: Final = 48  # levels between the channels of a pixel; JPEG and scaling make some
_MAX_COLOURED: Final = 0.02  # of the pixels: a stray stroke is ignored
_LABEL: Final = 20  # several gray values up to this are numbers of classes

Gray = NDArray[np.uint8]


def mask_of(data: bytes, name: str) -> Gray:
    """Return a mask as gray values (rows, columns), 0 to 255; transparent pixels are undecided.

    White is the upper end of 16 bits. Raises `ImageError` for a file that is no picture, is in
    colour, or holds numbers of classes.
    """
    with opened(io.BytesIO(data), name) as picture:
        if picture.mode.startswith("I"):
            deep = np.asarray(picture).astype(np.float64)
            gray = np.round(np.clip(deep / _DEEP, 0, 255)).astype(np.uint8)
        else:
            gray = _gray(picture, name)
    brightest = int(gray.max())
    if 0 < brightest <= _LABEL:
        raise ImageError(
            f"{name}: its brightest pixel has {brightest} of 255; paint the region white (255) and "
            "all other ground black (numbers of classes are no gray values)"
        )
    return gray


def class_mask(data: bytes, name: str, classes: Classes) -> Gray:
    """Return a mask of numbers of classes (rows, columns): 0 is surround, `UNKNOWN` undecided.

    Raises `ImageError` for a file that is no picture, is in colour, or holds another number.
    """
    with opened(io.BytesIO(data), name) as picture:
        if picture.mode in ("P", "L", "I;16", "I"):
            levels = np.asarray(picture)
        else:
            levels = _gray(picture, name, UNKNOWN)
    known = (0, *classes.names, UNKNOWN)
    strange = np.setdiff1d(levels, known)
    if strange.size:
        named = ", ".join(f"{number} {text}" for number, text in classes.names.items())
        raise ImageError(
            f"{name}: holds {strange[0]}, which is the number of no class in {CLASSES_TOML}: "
            f"expected 0 for all other ground, {UNKNOWN} for undecided, {named}"
        )
    return levels.astype(np.uint8)


def _gray(picture: Image.Image, name: str, undecided: int = UNDECIDED) -> Gray:
    rgba = np.asarray(picture.convert("RGBA"))
    seen = rgba[..., 3] >= UNDECIDED
    rgb = rgba[..., :3]
    spread = rgb.max(axis=2).astype(np.int16) - rgb.min(axis=2)
    if np.count_nonzero((spread > _COLOURED) & seen) > _MAX_COLOURED * seen.size:
        raise ImageError(
            f"{name}: is in colour; paint white where the region is, black where it is not and "
            "mid-grey where you are unsure, in a picture without anything else"
        )
    gray = np.array(cv2.cvtColor(np.ascontiguousarray(rgb), cv2.COLOR_RGB2GRAY), np.uint8)
    gray[~seen] = undecided
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
                f"{file}: a mask is a PNG, because other formats lose details; save it as "
                f"{file.stem}.png"
            )
        if picture is None:
            raise ImageError(
                f"{file}: no picture has this name; name it after one of them, such as "
                f"{pictures[0].stem}.png"
            )
        if picture in found:
            raise ImageError(
                f"{file}: {found[picture].name} is also a mask of {picture.name}; keep one of them"
            )
        found[picture] = file
        yield picture, file


# --- examples ------------------------------------------------------------------------------------
POLYGONS: Final = frozenset({".geojson", ".json"})
_SHAPE_DIFFERS: Final = 0.02
_LARGEST_TOML: Final = 100_000


@dataclass(frozen=True, slots=True)
class Example:
    """A picture at the working width with the painted kind of each pixel, (rows, columns).

    `painted`: the number of a class, `REGION` without classes; `SURROUND`; or `UNKNOWN`.
    """

    name: str
    picture: NDArray[np.uint8]
    painted: NDArray[np.uint8]

    @property
    def known(self) -> NDArray[np.bool_]:
        """True where the picture is painted."""
        return np.asarray(self.painted != UNKNOWN)

    @property
    def region(self) -> NDArray[np.bool_]:
        """True where it is painted as region."""
        return np.asarray(self.known & (self.painted != SURROUND))

    @property
    def shows(self) -> tuple[bool, bool]:
        """True for each of region and surround of which it shows a part."""
        return bool(self.region.any()), bool((self.painted == SURROUND).any())


def list_pictures(images: Path) -> list[Path]:
    """Return a folder's pictures by name. Raises `ImageError` if none, or two share a mask."""
    if not images.is_dir():
        raise ImageError(f"{images}: no such folder")
    paths = sorted(p for p in images.iterdir() if p.suffix.lower() in SUFFIXES and p.is_file())
    paths = [path for path in paths if not path.name.startswith(".")]
    if not paths:
        raise ImageError(
            f"{images}: no pictures (*.jpg, *.jpeg, *.png, *.tif, *.tiff) in this folder"
        )
    for one, other in itertools.pairwise(sorted(paths, key=lambda path: path.stem)):
        if one.stem == other.stem:
            raise ImageError(
                f"{images}: {one.name} and {other.name}: a mask {one.stem}.png would fit both; "
                "rename one of them, or move it elsewhere"
            )
    return paths


def refuse_same_folder(images: Path, masks: Path) -> None:
    """Raise `ImageError` if masks are, or would be, in the folder of the pictures."""
    if masks.resolve() == images.resolve():
        raise ImageError(
            f"--examples {masks}: the folder of the pictures; masks need one of their own, such as "
            f"{masks / 'painted'}"
        )


def read_picture(path: Path, width_px: int) -> NDArray[np.uint8]:
    """Return a picture at the working width. Raises `ImageError`."""
    data = file_bytes(path)
    try:
        image = eight_bits(decoded(data, width_px))
    except ImageError as error:
        raise ImageError(f"{path}: {error}") from None
    return working_picture(image, width_px)


def file_bytes(path: Path) -> bytes:
    """Return the content of a file. Raises `ImageError`."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise ImageError(f"{path}: cannot be read ({error.strerror})") from None


def read_classes(where: Path) -> Classes | None:
    """Return the classes of examples; None if there is no `classes.toml` with them.

    Raises `ImageError` for a file without classes.
    """
    path = where.with_name(CLASSES_TOML) if where.is_file() else where / CLASSES_TOML
    if not path.is_file():
        return None
    try:
        return Classes.model_validate(tomllib.loads(read_text(path, _LARGEST_TOML)))
    except OSError as error:
        raise ImageError(f"{path}: cannot be read ({error.strerror})") from None
    except ValidationError as error:
        raise ImageError(f"{path}: {explain(error, Classes)[0].removeprefix(': ')}") from None
    except (ValueError, RecursionError) as error:
        raise ImageError(f"{path}: not a TOML file: {error}") from None


def load_examples(
    images: Path, where: Path, width_px: int, show: Callable[[str], None] = lambda text: None
) -> list[Example]:
    """Return the painted pictures, by name.

    Args:
        where: A folder of masks `NAME.png` and of polygons `*.geojson`, or one file of polygons.
        show: Receives a line for each picture that cannot be read to project polygons into it.

    Raises:
        ImageError: A file cannot be read; a mask has no picture or another shape; nothing is
            painted, or only region, or only surround. The error names the file.
    """
    if where.is_dir() and any(path.suffix.lower() == ".png" for path in where.iterdir()):
        refuse_same_folder(images, where)
    pictures = list_pictures(images)
    if where.is_file() and where.suffix.lower() in POLYGONS:
        files = [where]
    elif where.is_dir():
        files = sorted(p for p in where.iterdir() if p.is_file() and not p.name.startswith("."))
    else:
        raise ImageError(
            f"--examples {where}: no folder of masks (NAME.png) and no file of polygons (*.geojson)"
        )
    polygons = [path for path in files if path.suffix.lower() in POLYGONS]
    masks = [path for path in files if path not in polygons]
    if images.resolve() == where.resolve():
        masks = []  # this is the folder of the pictures, which holds no mask
    if not polygons and not any(path.suffix.lower() in SUFFIXES for path in masks):
        raise ImageError(
            f"--examples {where}: no masks (NAME.png, named after the pictures) and no *.geojson; "
            f"paint some, for example {pictures[0].stem}.png: white region, black not"
        )
    classes = read_classes(where)
    found = {e.name: e for e in _projected(images, polygons, classes, width_px, show)}
    found |= {e.name: e for e in _painted(pictures, masks, classes, width_px)}
    examples = [found[name] for name in sorted(found)]
    region, surround = (any(e.shows[kind] for e in examples) for kind in (0, 1))
    if polygons and not region:
        raise ImageError(
            f"--examples {where}: no polygon of the region is in any picture; are its places in "
            "WGS84 (EPSG:4326), longitude before latitude?"
        )
    if not (region and surround):
        kind = "surround (black)" if region else "region (white)"
        raise ImageError(f"--examples {where}: nothing is painted as {kind}; both are needed")
    return examples


# --- masks -----------------------------------------------------------------------------------
def _painted(
    pictures: list[Path], masks: list[Path], classes: Classes | None, width_px: int
) -> Iterator[Example]:
    for path, mask in masks_by_picture(pictures, masks):
        picture = read_picture(path, width_px)
        data = file_bytes(mask)
        if classes is None:
            gray = mask_of(data, str(mask))
            painted = np.full_like(gray, UNKNOWN)
            painted[gray <= BLACK], painted[gray >= WHITE] = SURROUND, REGION
        else:
            painted = class_mask(data, str(mask), classes)
        (rows, columns), (tall, wide) = picture.shape[:2], painted.shape
        if abs(wide / tall - columns / rows) > _SHAPE_DIFFERS * columns / rows:
            raise ImageError(
                f"{mask}: {wide} x {tall} px is not the shape of {path.name}; paint "
                "over a copy of the picture, whole and not turned"
            )
        painted = np.asarray(
            cv2.resize(painted, (columns, rows), interpolation=cv2.INTER_NEAREST), np.uint8
        )
        yield Example(path.stem, picture, painted)


# --- polygons --------------------------------------------------------------------------------
def _projected(
    images: Path,
    files: list[Path],
    classes: Classes | None,
    width_px: int,
    show: Callable[[str], None],
) -> Iterator[Example]:
    """Yield the pictures that contain polygons, by their best poses."""
    if not files:
        return
    polygons = Polygons.read(images, files, classes)
    for placed in polygons.placed:
        try:
            picture = read_picture(images / placed.picture.name, width_px)
        except ImageError as error:  # it is not painted, so it is not needed
            show(f"left out: {error}")
            continue
        painted = polygons.painted(placed, picture.shape[:2])
        if (painted != UNKNOWN).any():
            yield Example(Path(placed.picture.name).stem, picture, painted)
