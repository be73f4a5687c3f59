"""Pictures and what people have painted on them.

A mask is a picture of the same shape, named after the photograph: white is region, black is not,
mid-grey is undecided. Polygons are GeoJSON in longitude and latitude, projected into the pictures
through their poses.
"""

from __future__ import annotations

import io
import itertools
import json
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from missions.errors import ImageError
from missions.geo.grid import Grid
from missions.units import LatLon
from uavmap.base.image_files import opened
from uavmap.base.messages import muted
from uavmap.base.text_files import read_text
from uavmap.photos.registration.refined_pictures import refined
from uavmap.photos.sources.inventory import gather, open_source
from uavmap.photos.sources.photo_file import SUFFIXES, decoded, eight_bits
from uavmap.photos.sources.picture_record import Placed, credible
from vision.camera import Camera, project
from vision.detectors.pixel_features import working_picture

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
            gray = _gray(picture, name)
    brightest = int(gray.max())
    if 0 < brightest <= _LABEL:
        raise ImageError(
            f"{name}: its brightest pixel has {brightest} of 255; paint the region white (255) and "
            "what is not region black (numbers of classes are no gray values)"
        )
    return gray


def _gray(picture: Image.Image, name: str) -> Gray:
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


# --- examples ------------------------------------------------------------------------------------
POLYGONS: Final = frozenset({".geojson", ".json"})
_SHAPE_DIFFERS: Final = 0.02
_LARGEST_GEOJSON: Final = 20_000_000
_GRID_M: Final = 2.0  # the grid only carries metres here
_WGS84: Final = ("CRS84", "EPSG::4326", "EPSG:4326")
_KINDS: Final = ("region", "surround", "undecided")


@dataclass(frozen=True, slots=True)
class Example:
    """A picture at the working width with what is known of its pixels.

    `region` and `known` are (rows, columns), bool; `region` is undefined where `known` is false.
    """

    name: str
    picture: NDArray[np.uint8]
    region: NDArray[np.bool_]
    known: NDArray[np.bool_]

    @property
    def shows(self) -> tuple[bool, bool]:
        """Whether some of it is region, and some surround."""
        return bool((self.region & self.known).any()), bool((~self.region & self.known).any())


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
                f"{images}: {one.name} and {other.name}: to which would a mask {one.stem}.png "
                "belong? Give one of them another name, or put it elsewhere"
            )
    return paths


def refuse_same_folder(images: Path, masks: Path) -> None:
    """Raise `ImageError` where masks lie, or would be written, among the pictures."""
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


def load_examples(
    images: Path, where: Path, width_px: int, say: Callable[[str], None] = lambda text: None
) -> list[Example]:
    """Return the painted pictures, by name.

    Args:
        where: A folder of masks `NAME.png` and of polygons `*.geojson`, or one file of polygons.
        say: Receives which pictures polygons are not projected into, as they cannot be read.

    Raises:
        ImageError: Naming the file, for what cannot be read, a mask without its picture or of
            another shape, and where nothing is painted, or no region, or nothing but region.
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
        masks = []  # they are the pictures; that no mask is among them was looked at
    if not polygons and not any(path.suffix.lower() in SUFFIXES for path in masks):
        raise ImageError(
            f"--examples {where}: no masks (NAME.png, named after the pictures) and no *.geojson; "
            f"paint some, for example {pictures[0].stem}.png: white region, black not"
        )
    found = {e.name: e for e in _projected(images, polygons, width_px, say)} if polygons else {}
    found |= {e.name: e for e in _painted(pictures, masks, width_px)}
    examples = [found[name] for name in sorted(found)]
    region, surround = (any(e.shows[kind] for e in examples) for kind in (0, 1))
    if polygons and not region:
        raise ImageError(
            f"--examples {where}: no polygon of the region lies in any picture; are its places in "
            "WGS84 (EPSG:4326), longitude before latitude?"
        )
    if not (region and surround):
        kind = "surround (black)" if region else "region (white)"
        raise ImageError(f"--examples {where}: nothing is painted as {kind}; both are needed")
    return examples


# --- masks -----------------------------------------------------------------------------------
def _painted(pictures: list[Path], masks: list[Path], width_px: int) -> Iterator[Example]:
    for path, mask in masks_by_picture(pictures, masks):
        picture = read_picture(path, width_px)
        painted = mask_of(file_bytes(mask), str(mask))
        (rows, columns), (tall, wide) = picture.shape[:2], painted.shape
        if abs(wide / tall - columns / rows) > _SHAPE_DIFFERS * columns / rows:
            raise ImageError(
                f"{mask}: {wide} x {tall} px is not the shape of {path.name}; paint "
                "over a copy of the picture, whole and not turned"
            )
        painted = np.asarray(
            cv2.resize(painted, (columns, rows), interpolation=cv2.INTER_NEAREST), np.uint8
        )
        known = (painted <= BLACK) | (painted >= WHITE)
        yield Example(path.stem, picture, painted >= WHITE, known)


# --- polygons --------------------------------------------------------------------------------
Rings = list[NDArray[np.float64]]


def _projected(
    images: Path, files: list[Path], width_px: int, say: Callable[[str], None]
) -> Iterator[Example]:
    """Yield the pictures with the polygons, by their best poses."""
    shapes = [shape for path in files for shape in _shapes(path)]
    gathered = gather(open_source(images))
    with muted():
        better = refined(gathered)
    verdicts = credible(better.gathered.posed)
    placed = [entry for entry in verdicts if not isinstance(entry, str)]
    if not placed:
        raise ImageError(
            f"{images}: polygons cannot be projected into pictures without a pose "
            f"({gathered.pictures[0].name}: {verdicts[0]}); paint masks"
        )
    grid = Grid.at(placed[0].pose.position, _GRID_M)
    limited = any(kind == "surround" for kind, _ in shapes)
    for entry in placed:
        try:
            picture = read_picture(images / entry.picture.name, width_px)
        except ImageError as error:  # nobody has painted it, so nobody misses it
            say(f"left out: {error}")
            continue
        drawn = {kind: _drawn(kind, shapes, entry, grid, picture.shape[:2]) for kind in _KINDS}
        region = drawn["region"]
        known = (region | drawn["surround"]) if limited else np.ones_like(region)
        known &= ~drawn["undecided"]
        if known.any():
            yield Example(Path(entry.picture.name).stem, picture, region, known)


def _drawn(
    kind: str,
    shapes: list[tuple[str, Rings]],
    placed: Placed,
    grid: Grid,
    shape: tuple[int, ...],
) -> NDArray[np.bool_]:
    """Return where the polygons of a kind lie in a picture."""
    rows, columns = shape
    lens = placed.picture.lens
    if lens is None:
        raise ImageError(
            f"{placed.picture.name}: no tag tells its focal length, without which polygons cannot "
            "be projected into it; paint a mask"
        )
    matrix = Camera(lens.hfov_rad, columns, rows).homography(placed.pose, grid, 0.0)
    drawn = np.zeros((rows, columns), np.uint8)
    for found, rings in shapes:
        if found != kind:
            continue
        layer = np.zeros((rows, columns), np.uint8)
        for ring in rings:  # even-odd: the first is the outline, the others are holes
            metres = [grid.fixed(LatLon(lat, lon)) for lon, lat in ring]
            pixels, _ = project(matrix, np.array([[p.east_m, p.north_m] for p in metres]))
            if np.isfinite(pixels).all() and np.abs(pixels).max() < 1e6:
                one = np.zeros_like(layer)
                cv2.fillPoly(one, [np.round(pixels * 16).astype(np.int32)], (255,), shift=4)
                layer ^= one
        drawn |= layer
    return drawn > 0


def _shapes(path: Path) -> list[tuple[str, Rings]]:
    """Return the polygons of a GeoJSON file with the property `kind`, else region."""
    try:
        root = json.loads(read_text(path, _LARGEST_GEOJSON))
    except OSError as error:
        raise ImageError(f"{path}: cannot be read ({error.strerror})") from None
    except (ValueError, RecursionError) as error:
        raise ImageError(f"{path}: not JSON ({error})") from None
    _refuse_other_crs(root, path)
    features = root.get("features") if isinstance(root, dict) else None
    if not isinstance(features, list) or not features:
        raise ImageError(f"{path}: no FeatureCollection with features; draw polygons")
    shapes = []
    for i, feature in enumerate(features):
        where, feature = f"{path}: features[{i}]", feature if isinstance(feature, dict) else {}
        geometry, properties = feature.get("geometry"), feature.get("properties") or {}
        kind = properties.get("kind", "region") if isinstance(properties, dict) else "region"
        if kind not in _KINDS:
            raise ImageError(f"{where}: kind is {kind!r}: expected one of {', '.join(_KINDS)}")
        sort = geometry.get("type") if isinstance(geometry, dict) else None
        if not isinstance(geometry, dict) or sort not in ("Polygon", "MultiPolygon"):
            raise ImageError(f"{where}: a {sort}; draw a Polygon or a MultiPolygon")
        parts = geometry.get("coordinates")
        for part in [parts] if sort == "Polygon" else (parts or []):
            shapes.append((kind, _rings(part, where)))
    return shapes


def _refuse_other_crs(root: Any, path: Path) -> None:
    """Raise `ImageError` if a file names another coordinate system, as old GeoJSON may."""
    crs = root.get("crs") if isinstance(root, dict) else None
    if crs is None:
        return
    text = json.dumps(crs)
    if not any(name in text for name in _WGS84):
        raise ImageError(
            f"{path}: crs is {text[:80]}; export the polygons as GeoJSON (RFC 7946), which is in "
            "WGS84 (EPSG:4326)"
        )


def _rings(part: Any, where: str) -> Rings:
    try:
        rings = [np.array([[float(p[0]), float(p[1])] for p in ring]) for ring in part]
    except (TypeError, ValueError, IndexError, KeyError):
        raise ImageError(f"{where}: not rings of [longitude, latitude]") from None
    for ring in rings:
        good = len(ring) >= 3 and bool(np.isfinite(ring).all())
        if not good or (np.abs(ring) > [180.0, 90.0]).any() or math.isnan(ring.sum()):
            raise ImageError(
                f"{where}: a ring of less than 3 places, or of no places on Earth; coordinates are "
                "longitude and latitude in WGS84 (EPSG:4326)"
            )
    return rings
