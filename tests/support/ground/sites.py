"""Sites with known pixels: rendered ground with a region and with ground that looks like it.

A site is drawn from above in metres, material by material. A camera photographs it with exposure,
white balance and attitude that differ from picture to picture. The ground that looks like the
region lies in the eastern half, so examples painted in the western half show none of it.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.geo.geodesy import LocalPlane
from missions.units import LatLon, Quaternion
from sitl.camera.exif import Geotag, tagged
from uavmap.output.facts.map_model import NOT_ROI

GSD_M: Final = 0.06
WIDTH_M: Final = 192.0
HEIGHT_M: Final = 144.0
SHAPE: Final = (round(HEIGHT_M / GSD_M), round(WIDTH_M / GSD_M))
ORIGIN: Final = LatLon(51.0, 7.0)
"""The south-western corner of every site."""

Image = NDArray[np.uint8]
Plane = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Material:
    """A kind of ground: blue, green, red, and their variation, in levels.

    `fine` is the variation from pixel to pixel, `coarse` over metres, `tint` of the colour over
    metres. `rows_m` is the distance of furrows, battens or panels, `rows` their depth.
    """

    color: tuple[float, float, float]
    fine: float
    coarse: float
    tint: float = 3.0
    rows_m: float = 0.0
    rows: float = 0.0
    bearing_deg: float = 20.0


MATERIALS: Final[Mapping[str, Material]] = {
    "meadow": Material((62, 112, 88), 13, 10, 5),
    "dry grass": Material((108, 150, 158), 12, 9, 5),
    "crop": Material((58, 100, 70), 11, 6, 4, 0.8, 14),
    "bare soil": Material((124, 144, 158), 6, 9, 4),
    "ploughed soil": Material((84, 106, 128), 8, 8, 3, 0.9, 12, 75),
    "gravel": Material((150, 160, 166), 6, 5, 2),
    "asphalt": Material((122, 122, 120), 4, 4, 2),
    "concrete": Material((172, 176, 176), 3, 4, 2, 5.0, 6),
    "roof": Material((74, 82, 138), 5, 4, 2, 0.5, 16, 110),
    "metal roof": Material((188, 182, 174), 2, 3, 1, 0.9, 10, 35),
    "panels": Material((92, 62, 44), 3, 3, 1, 1.1, 22, 0),
    "crown": Material((38, 70, 48), 20, 14, 5),
    "burnt": Material((44, 46, 48), 7, 8, 2),
    "water": Material((92, 78, 58), 2, 5, 2),
    "muddy water": Material((108, 132, 146), 2, 4, 2),
    "sea": Material((110, 92, 52), 5, 7, 3, 3.2, 5, 60),
    "oil": Material((70, 66, 60), 2, 7, 3),
    "sand": Material((150, 178, 190), 6, 6, 2),
    "weed": Material((70, 78, 70), 9, 9, 3),
    "sheen": Material((144, 132, 110), 3, 6, 3),
    "rainbow": Material((150, 104, 140), 3, 7, 14),
    "metallic": Material((96, 92, 86), 2, 6, 2),
    "true colour": Material((38, 58, 92), 3, 6, 3),
}  # fmt: skip


# --- drawing -------------------------------------------------------------------------------------
Part = tuple[slice, slice]
WHOLE: Final = (slice(0, SHAPE[0]), slice(0, SHAPE[1]))


def clouds(rng: np.random.Generator, scale_m: float, part: Part = WHOLE) -> Plane:
    """Return smooth noise of a scale, zero mean and unit variance over the whole ground."""
    fine = scale_m < 1.0  # a tile that repeats: no camera shows that
    shape = (SHAPE[0] // 4, SHAPE[1] // 4) if fine else SHAPE
    found = np.zeros(shape, np.float32)
    for octave in range(1 if fine else 3):
        step = max(1.0, scale_m / GSD_M / 2**octave)
        size = (max(2, math.ceil(shape[0] / step)), max(2, math.ceil(shape[1] / step)))
        small = rng.standard_normal(size, np.float32) / 2**octave
        found += cv2.resize(small, shape[::-1], interpolation=cv2.INTER_LINEAR)
    mean, deviation = found.mean(), found.std()
    found = (np.tile(found, (4, 4)) if fine else found)[part]
    return np.asarray((found - mean) / deviation, np.float32)


def rendered(rng: np.random.Generator, material: Material, part: Part = WHOLE) -> Plane:
    """Return a part of the ground in one material, (rows, columns, 3), float32."""
    light = material.coarse * clouds(rng, 9.0, part)
    for scale_m, share in ((0.9, 0.35), (0.25, 0.55), (GSD_M, 0.75)):
        light += share * material.fine * clouds(rng, scale_m, part)
    if material.rows_m:
        rows, columns = np.mgrid[part].astype(np.float32)
        bearing = math.radians(material.bearing_deg)
        along = (columns * math.cos(bearing) + rows * math.sin(bearing)) * GSD_M
        wave = np.sin(2 * math.pi * along / material.rows_m + 0.6 * clouds(rng, 5.0, part))
        light += material.rows * wave * 0.7
    tint = np.stack([clouds(rng, 12.0, part) for _ in range(3)], axis=2) * material.tint
    return np.asarray(np.array(material.color, np.float32) + light[:, :, None] + tint, np.float32)


def area(
    rng: np.random.Generator, polygon_m: Sequence[tuple[float, float]], rough_m: float
) -> Mask:
    """Return the pixels of a polygon (east, north, metres) with a ragged edge."""
    points = np.array([(e / GSD_M, SHAPE[0] - n / GSD_M) for e, n in polygon_m])
    drawn = np.zeros(SHAPE, np.uint8)
    cv2.fillPoly(drawn, [np.round(points).astype(np.int32)], (1,))
    return _ragged(rng, drawn, rough_m)


def lane(
    rng: np.random.Generator, line_m: Sequence[tuple[float, float]], wide_m: float, rough_m: float
) -> Mask:
    """Return the pixels within half a width of a line (east, north, metres)."""
    points = np.array([(e / GSD_M, SHAPE[0] - n / GSD_M) for e, n in line_m])
    drawn = np.zeros(SHAPE, np.uint8)
    cv2.polylines(drawn, [np.round(points).astype(np.int32)], False, (1,), round(wide_m / GSD_M))
    return _ragged(rng, drawn, rough_m)


def discs(
    rng: np.random.Generator, count: int, radius_m: float, west_m: float, east_m: float
) -> Mask:
    """Return round things, scattered between two eastings."""
    drawn = np.zeros(SHAPE, np.uint8)
    for _ in range(count):
        middle = (rng.uniform(west_m, east_m) / GSD_M, rng.uniform(0, HEIGHT_M) / GSD_M)
        radius = radius_m * rng.uniform(0.6, 1.3) / GSD_M
        cv2.circle(drawn, (round(middle[0]), round(middle[1])), round(radius), (1,), -1)
    return _ragged(rng, drawn, 0.8)


def _ragged(rng: np.random.Generator, drawn: NDArray[np.uint8], rough_m: float) -> Mask:
    if not rough_m:
        return drawn > 0
    away = rough_m / GSD_M
    columns = away * clouds(rng, 4.0) + np.arange(SHAPE[1], dtype=np.float32)
    rows = away * clouds(rng, 4.0) + np.arange(SHAPE[0], dtype=np.float32)[:, None]
    moved = cv2.remap(drawn, columns, rows, cv2.INTER_NEAREST)
    return np.asarray(moved > 0)


def _part_of(where: Mask) -> Part:
    """Return the rows and columns from the first to the last pixel of an area."""
    rows, columns = (np.flatnonzero(where.any(axis=axis)) for axis in (1, 0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


class Canvas:
    def __init__(self, seed: int, ground: str) -> None:
        self.rng: Final = np.random.default_rng(seed)
        self.image: Plane = rendered(self.rng, MATERIALS[ground])
        self.numbers: Image = np.zeros(SHAPE, np.uint8)

    def paint(self, where: Mask, material: str, *, number: int = 0) -> None:
        """Paint an area; `number` is that of its class, 0 for ground that is not region."""
        soft = cv2.GaussianBlur(where.astype(np.float32), (0, 0), 2.0)[:, :, None]
        part = _part_of(soft[:, :, 0] > 0)
        made, soft = rendered(self.rng, MATERIALS[material], part), soft[part]
        self.image[part] = self.image[part] * (1 - soft) + made * soft
        self.numbers[where] = number

    def shade(self, where: Mask, toward_m: tuple[float, float]) -> None:
        east, north = (round(part / GSD_M) for part in toward_m)
        moved = np.roll(where, (-north, east), axis=(0, 1)) & ~where
        soft = cv2.GaussianBlur(moved.astype(np.float32), (0, 0), 3.0)[:, :, None]
        dark = self.image * np.array([0.46, 0.38, 0.34], np.float32)
        self.image = np.asarray(self.image * (1 - soft) + dark * soft, np.float32)

    def trees(self, count: int, west_m: float, east_m: float) -> None:
        crowns = discs(self.rng, count, 3.0, west_m, east_m)
        self.shade(crowns, (2.5, 3.5))
        self.paint(crowns, "crown")

    def glint(self, where: Mask, share: float) -> None:
        sparkle = (clouds(self.rng, 0.4) + 0.8 * clouds(self.rng, 14.0)) > np.quantile(
            clouds(self.rng, 0.4), 1 - share
        ) + 0.8
        self.image[sparkle & where] += 110.0


@dataclass(frozen=True, slots=True)
class Site:
    """A site from above: `image` (rows, columns, 3), uint8, north up; the class of each pixel."""

    name: str
    image: Image
    numbers: Image

    @property
    def region(self) -> Mask:
        return self.numbers > 0


def _box(west: float, south: float, east: float, north: float) -> list[tuple[float, float]]:
    return [(west, south), (east, south), (east, north), (west, north)]


def _track(canvas: Canvas) -> None:
    """Draw a gravel track in meadow and dry grass; bare soil, roofs and a yard look like it."""
    rng = canvas.rng
    canvas.paint(area(rng, _box(-5, 70, 90, 150), 3.0), "dry grass")
    canvas.paint(area(rng, _box(110, 78, 180, 150), 2.0), "bare soil")
    canvas.paint(area(rng, _box(120, -5, 200, 46), 1.0), "ploughed soil")
    line = [(0, 40), (40, 52), (75, 48), (104, 64), (140, 58), (192, 66)]
    canvas.paint(lane(rng, line, 6.0, 0.5), "gravel", number=1)
    canvas.paint(lane(rng, [(58, 0), (64, 30), (62, 50)], 5.0, 0.4), "gravel", number=1)
    house, shed = area(rng, _box(150, 90, 168, 102), 0.0), area(rng, _box(128, 18, 142, 30), 0.0)
    canvas.shade(house | shed, (2.0, 3.0))
    canvas.paint(house, "roof")
    canvas.paint(shed, "metal roof")
    canvas.paint(area(rng, _box(150, 14, 176, 30), 0.0), "panels")
    canvas.trees(26, 0, 190)


def _burn(canvas: Canvas) -> None:
    """Draw burnt dry grass; a pond, an asphalt road and shadows are as dark."""
    rng = canvas.rng
    canvas.paint(area(rng, _box(-5, -5, 70, 50), 3.0), "meadow")
    burnt = [(20, 60), (70, 40), (118, 62), (150, 48), (160, 88), (110, 112), (60, 120), (28, 96)]
    canvas.paint(area(rng, burnt, 3.0), "burnt", number=1)
    canvas.paint(area(rng, _box(66, 72, 84, 86), 2.5), "dry grass")
    canvas.paint(lane(rng, [(172, 0), (168, 60), (182, 150)], 6.5, 0.2), "asphalt")
    pond = area(rng, [(118, 8), (150, 4), (158, 26), (130, 34)], 2.0)
    canvas.paint(pond, "water")
    canvas.paint(area(rng, _box(118, 122, 150, 140), 1.0), "ploughed soil")
    canvas.trees(34, 0, 190)


def _flood(canvas: Canvas) -> None:
    """Draw muddy water over a meadow; bare soil, a farm track and a roof have its colour."""
    rng = canvas.rng
    canvas.paint(area(rng, _box(96, -5, 200, 60), 2.0), "crop")
    water = [(0, 50), (40, 44), (80, 66), (130, 74), (192, 96), (192, 126), (120, 108), (60, 104),
             (0, 90)]  # fmt: skip
    flooded = area(rng, water, 2.5)
    canvas.paint(flooded, "muddy water", number=1)
    canvas.glint(flooded, 0.02)
    canvas.paint(area(rng, _box(122, 8, 176, 50), 1.5), "bare soil")
    canvas.paint(lane(rng, [(100, 0), (108, 40), (116, 70)], 4.0, 0.3), "gravel")
    house = area(rng, _box(140, 122, 154, 134), 0.0)
    canvas.shade(house, (2.0, 3.0))
    canvas.paint(house, "metal roof")
    canvas.trees(22, 0, 190)


def _spill(canvas: Canvas) -> None:
    """Draw oil on the sea before a beach; weed, wet sand and a cloud's shadow are as dark."""
    rng = canvas.rng
    oil = [(20, 50), (62, 40), (100, 58), (150, 52), (168, 78), (120, 92), (70, 84), (34, 80)]
    canvas.paint(area(rng, oil, 4.0), "oil", number=1)
    canvas.paint(area(rng, _box(54, 58, 70, 68), 2.0), "sea")
    canvas.glint(np.ones(SHAPE, np.bool_), 0.004)
    canvas.paint(area(rng, _box(-5, 116, 200, 150), 3.0), "sand")
    canvas.paint(discs(rng, 22, 3.0, 110, 190) & (canvas.numbers == 0), "weed")
    canvas.shade(area(rng, _box(120, 10, 175, 36), 5.0), (0.0, 0.0001))
    shadow = area(rng, _box(118, 6, 172, 34), 6.0)
    soft = cv2.GaussianBlur(shadow.astype(np.float32), (0, 0), 25.0)[:, :, None]
    canvas.image = np.asarray(canvas.image * (1 - 0.42 * soft), np.float32)


CLASSES: Final = """\
sheen = {number = 1, thickness_um = [0.04, 0.30]}
rainbow = {number = 2, thickness_um = [0.30, 5.0]}
metallic = {number = 3, thickness_um = [5.0, 50.0]}
true_colour = {number = 4, thickness_um = [50.0]}
"""
"""Classes of the site `slick`."""


def _slick(canvas: Canvas) -> None:
    """Draw oil of four appearances on the sea, each film on a thinner one, before a beach."""
    rng = canvas.rng
    films = ("sheen", "rainbow", "metallic", "true colour")
    for number, film in enumerate(films, start=1):
        reach = 1.16 - 0.25 * number
        ring = [(96 + reach * east, 62 + reach * north) for east, north in (
            (-92, -14), (-50, -46), (10, -40), (64, -50), (92, -8), (60, 34), (-8, 40), (-60, 34)
        )]  # fmt: skip
        canvas.paint(area(rng, ring, 2.5), film, number=number)
    canvas.glint(np.ones(SHAPE, np.bool_), 0.004)
    canvas.paint(area(rng, _box(-5, 122, 200, 150), 3.0), "sand")


def _runway(canvas: Canvas) -> None:
    """Draw a worn runway on a meadow; bare and ploughed soil, a yard and a roof look like it."""
    rng = canvas.rng
    canvas.paint(area(rng, _box(-5, 96, 80, 150), 3.0), "crop")
    canvas.paint(lane(rng, [(30, 44), (146, 82)], 21.0, 0.8), "gravel", number=1)
    canvas.paint(area(rng, _box(118, 108, 186, 150), 2.0), "bare soil")
    canvas.paint(area(rng, _box(128, -5, 200, 34), 1.5), "ploughed soil")
    canvas.paint(area(rng, _box(164, 52, 184, 74), 0.3), "concrete")
    house = area(rng, _box(96, 12, 110, 22), 0.0)
    canvas.shade(house, (2.0, 3.0))
    canvas.paint(house, "metal roof")
    canvas.trees(18, 0, 190)


SITES: Final[Mapping[str, tuple[str, Callable[[Canvas], None]]]] = {
    "track": ("meadow", _track),
    "burn": ("dry grass", _burn),
    "flood": ("meadow", _flood),
    "spill": ("sea", _spill),
    "slick": ("sea", _slick),
    "runway": ("meadow", _runway),
}


def site(name: str, seed: int = 1) -> Site:
    ground, draw = SITES[name]
    canvas = Canvas(seed, ground)
    draw(canvas)
    image = np.clip(canvas.image, 0, 255).astype(np.uint8)
    return Site(name, image, canvas.numbers)


def write_orthophoto(place: Site, file: Path) -> None:
    """Write a site as a PNG with its world file in degrees."""
    cv2.imwrite(str(file), place.image)
    plane = LocalPlane(ORIGIN)
    north_west, south_east = plane.to_wgs84(0.0, HEIGHT_M), plane.to_wgs84(WIDTH_M, 0.0)
    wide = (south_east.lon_deg - north_west.lon_deg) / SHAPE[1]
    tall = (south_east.lat_deg - north_west.lat_deg) / SHAPE[0]
    first = (north_west.lon_deg + wide / 2, north_west.lat_deg + tall / 2)
    lines = [f"{value:.12f}" for value in (wide, 0.0, 0.0, tall, *first)]
    file.with_suffix(".pgw").write_text("\n".join(lines) + "\n", "utf-8")


# --- photographs ---------------------------------------------------------------------------------
PHOTO_PX: Final = (1000, 750)
PHOTO_M: Final = 56.0
"""Width of the ground that a photograph shows, m."""
HFOV_RAD: Final = math.radians(70.0)


@dataclass(frozen=True, slots=True)
class Shot:
    """A photograph and its truth; `to_pixel` maps metres (east, north) to its pixels."""

    name: str
    image: Image
    numbers: Image
    to_pixel: NDArray[np.float64]
    east_m: float
    north_m: float
    yaw_rad: float
    t_s: float

    @property
    def region(self) -> Mask:
        return self.numbers > 0


def photographed(place: Site, seed: int = 1) -> list[Shot]:
    """Return photographs in lanes over a whole site."""
    rng = np.random.default_rng([seed, 7])
    wide, tall = PHOTO_PX
    shots: list[Shot] = []
    scale = wide / PHOTO_M
    margin_e, margin_n = PHOTO_M / 2 + 3, PHOTO_M * tall / wide / 2 + 3
    for row, north_m in enumerate(np.linspace(margin_n, HEIGHT_M - margin_n, 6)):
        columns = np.linspace(margin_e, WIDTH_M - margin_e, 7)
        for east_m in columns if row % 2 == 0 else columns[::-1]:
            yaw = math.radians(90.0 if row % 2 == 0 else 270.0) + rng.normal(0, 0.04)
            east, north = east_m + rng.normal(0, 0.8), north_m + rng.normal(0, 0.8)
            # the top of a photograph points along the yaw; its width is across
            forward = np.array([math.sin(yaw), math.cos(yaw)])
            right = np.array([math.cos(yaw), -math.sin(yaw)])
            turn = np.stack([right * scale, -forward * scale])
            middle = np.array([(wide - 1) / 2, (tall - 1) / 2])
            to_pixel = np.hstack([turn, (middle - turn @ [east, north])[:, None]])
            shots.append(_shot(place, rng, to_pixel, len(shots), (east, north, yaw)))
    return shots


def _shot(
    place: Site,
    rng: np.random.Generator,
    to_pixel: NDArray[np.float64],
    number: int,
    pose: tuple[float, float, float],
) -> Shot:
    ground = np.array([[GSD_M, 0.0, 0.0], [0.0, -GSD_M, SHAPE[0] * GSD_M], [0.0, 0.0, 1.0]])
    matrix = to_pixel @ ground
    image = cv2.warpAffine(
        place.image, matrix, PHOTO_PX, flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REFLECT
    ).astype(np.float32)
    numbers = cv2.warpAffine(
        place.numbers, matrix, PHOTO_PX, flags=cv2.INTER_NEAREST,
        borderMode=cv2.BORDER_REFLECT,
    )  # fmt: skip
    stops, balance = rng.uniform(-0.5, 0.5), rng.normal(0, 0.03, 3)
    rows, columns = np.mgrid[: PHOTO_PX[1], : PHOTO_PX[0]].astype(np.float32)
    away = np.hypot(columns / PHOTO_PX[0] - 0.5, rows / PHOTO_PX[0] - 0.375)
    gain = 2.0 ** (0.45 * (stops + balance)) * (1 - 0.22 * away[:, :, None] ** 2)
    image = image * gain + rng.normal(0, 2.0, image.shape)
    levels = np.clip(image, 0, 255).astype(np.uint8)
    return Shot(
        f"IMG_{number:04}", levels, np.asarray(numbers, np.uint8), to_pixel, *pose, t_s=2.0 * number
    )


def write(shots: Sequence[Shot], folder: Path) -> None:
    """Write photographs with positions, heights and angles in their tags."""
    folder.mkdir(parents=True)
    plane = LocalPlane(ORIGIN)
    height_m = PHOTO_M / 2 / math.tan(HFOV_RAD / 2)
    for shot in shots:
        _, data = cv2.imencode(".jpg", shot.image, [cv2.IMWRITE_JPEG_QUALITY, 90])
        tag = Geotag(
            plane.to_wgs84(shot.east_m, shot.north_m), 100.0 + height_m, height_m,
            Quaternion.from_euler(0.0, -math.pi / 2, shot.yaw_rad), (0.0, 0.0, shot.yaw_rad),
            shot.t_s, HFOV_RAD, PHOTO_PX[0],
        )  # fmt: skip
        (folder / f"{shot.name}.jpg").write_bytes(tagged(bytes(data), tag))


def paint(shots: Sequence[Shot], folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for shot in shots:
        cv2.imwrite(str(folder / f"{shot.name}.png"), shot.region.astype(np.uint8) * 255)


def paint_classes(shots: Sequence[Shot], folder: Path) -> None:
    """Write masks of the numbers of classes, and `classes.toml`."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "classes.toml").write_text(CLASSES)
    for shot in shots:
        cv2.imwrite(str(folder / f"{shot.name}.png"), shot.numbers)


def western(shots: Sequence[Shot], count: int = 3) -> list[Shot]:
    """Return photographs of the western half that show region and surround, spread over it."""
    some = [s for s in shots if s.east_m < WIDTH_M * 0.42 and 0.05 < s.region.mean() < 0.8]
    step = max(1, len(some) // count)
    return some[step // 2 :: step][:count]


# --- maps ----------------------------------------------------------------------------------------
def classes_of_cells(folder: Path, place: Site) -> NDArray[np.int64]:
    """Return a row for each cell of a map within the site: the number on the map, and in truth.

    In truth a cell of which half or more is region has the class that covers most of it.
    """
    by_name = {name: one["number"] for name, one in tomllib.loads(CLASSES).items()}
    rows = []
    for told, part in _cells(folder, place):
        counts = np.bincount(part.ravel(), minlength=5)
        truth = int(counts[1:].argmax()) + 1 if 2 * counts[0] <= part.size else 0
        rows.append((by_name[told["class"]] if "class" in told else 0, truth))
    return np.array(rows)


def judged_cells(folder: Path, place: Site) -> tuple[Mask, Mask, Mask]:
    """Return the cells of a map within the site: region, unsure, and region in truth."""
    rows = []
    for told, part in _cells(folder, place):
        state = told["state"]
        rows.append((state not in NOT_ROI, state == "unsure", bool((part > 0).mean() >= 0.5)))
    region, unsure, truth = np.array(rows).T
    return region, unsure, truth


def _cells(folder: Path, place: Site) -> Iterator[tuple[Mapping[str, Any], Image]]:
    """Yield the properties of each cell of a map within the site, and the site's classes there."""
    plane = LocalPlane(ORIGIN)
    features = json.loads((folder / "map.geojson").read_text("utf-8"))["features"]
    for feature in features:
        if feature["properties"]["kind"] != "cell":
            continue
        ring = feature["geometry"]["coordinates"][0]
        corners = [plane.to_plane(LatLon(lat, lon)) for lon, lat in ring]
        east, north = (np.array(axis) / GSD_M for axis in zip(*corners, strict=True))
        if min(east.min(), north.min()) < 0 or east.max() > SHAPE[1] or north.max() > SHAPE[0]:
            continue
        lines = slice(int(SHAPE[0] - north.max()), int(SHAPE[0] - north.min()))
        yield feature["properties"], place.numbers[lines, int(east.min()) : int(east.max())]
