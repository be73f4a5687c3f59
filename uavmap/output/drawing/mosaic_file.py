"""mosaic.webp: the ground in the pictures of a flight, transparent where no picture shows it.

QGIS and other programs with GDAL read its place on the ground from the file beside it.
"""

from __future__ import annotations

import io
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, WebPImagePlugin  # noqa: F401 - without it Pillow loads all its formats

from missions.errors import ImageError
from missions.flight.state import Setting
from missions.geo.grid import Grid
from missions.mission.schema import positions
from uavmap.base.atomic_write import write_bytes, write_text
from uavmap.base.image_files import MAX_PICTURE_BYTES, opened
from uavmap.base.text_files import read_bytes, read_text
from uavmap.output.drawing.scene import Bounds, View, bounds_of
from vision.mosaic import Colours
from vision.raster import Raster

MOSAIC: Final = "mosaic.webp"
PLACE: Final = f"{MOSAIC}.aux.xml"
"""File with the place of the mosaic on the ground, in GDAL's format."""
ORTHO: Final = "ortho.tif"
"""The mosaic as a Cloud Optimized GeoTIFF, with the extra `geo`."""
PROBABILITY: Final = "probability.tif"
SIDE_PX: Final = 1600
"""Maximum length of the longer side of a flight's mosaic, px."""
FINEST_M: Final = 0.1
"""Minimum edge of a pixel of a flight's mosaic, m."""
_MARGIN: Final = 0.25
_QUALITY: Final = 80
_EFFORT: Final = 1
"""Effort of WebP, 0 to 6: higher ones take twice the time and save a tenth of the size."""
_PLACE_BYTES: Final = 100_000
_OPAQUE: Final = 250


def bounds_around(setting: Setting) -> Bounds:
    """Return the bounds of box, fence and home, with the ground that pictures show around them."""
    mission = setting.mission
    rings = (*positions(mission.search.box), *positions(mission.fence.polygon), mission.home)
    west_m, south_m, east_m, north_m = bounds_of(map(setting.grid.fixed, rings))
    pad_m = _MARGIN * max(east_m - west_m, north_m - south_m)
    return west_m - pad_m, south_m - pad_m, east_m + pad_m, north_m + pad_m


def raster_of(setting: Setting) -> Raster | None:
    """Return the raster of a flight's mosaic; None if the region drifts."""
    if setting.grid.drift_speed_m_s:
        return None
    west_m, south_m, east_m, north_m = bounds_around(setting)
    sides_m = east_m - west_m, north_m - south_m
    pitch_m = max(FINEST_M, math.ceil(100.0 * max(sides_m) / SIDE_PX) / 100.0)
    columns, rows = (math.ceil(side_m / pitch_m) for side_m in sides_m)
    return Raster(west_m, north_m, pitch_m, columns, rows)


def utm_transform(raster: Raster, grid: Grid, t_s: float = 0.0) -> tuple[float, ...]:
    """Return the matrix from columns and rows to UTM at a mission time, in the order of `Affine`.

    `raster` is in the grid's moving frame.
    """
    step = raster.pitch_m * grid.scale
    west = grid.origin.east_m + (raster.west_m + grid.drift_east_m_s * t_s) * grid.scale
    north = grid.origin.north_m + (raster.north_m + grid.drift_north_m_s * t_s) * grid.scale
    return tuple(round(value, 9) for value in (step, 0.0, west, 0.0, -step, north))


def write_mosaic(folder: Path, image: Colours, raster: Raster, grid: Grid) -> None:
    """Write a mosaic (red, green, blue, and 255 where a picture shows the ground) and its place.

    An existing file keeps its raster. Raises `OSError`.
    """
    step, _, west, _, down, north = utm_transform(raster, grid)
    numbers = ", ".join(repr(value) for value in (west, step, 0.0, north, 0.0, down))
    text = (
        f"<PAMDataset>\n  <SRS>EPSG:{grid.zone.epsg}</SRS>\n"
        f"  <GeoTransform>{numbers}</GeoTransform>\n</PAMDataset>\n"
    )
    if not (folder / PLACE).exists():
        write_text(folder / PLACE, text)
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "WEBP", quality=_QUALITY, method=_EFFORT)
    write_bytes(folder / MOSAIC, buffer.getvalue())


class UtmMosaic(NamedTuple):
    """A mosaic as it was written: upper left corner and edge of a pixel in metres of UTM.

    `epsg` is the number of the projection in EPSG's list.
    """

    image: Colours
    west: float
    north: float
    step: float
    epsg: int


def read_mosaic(folder: Path) -> UtmMosaic | None:
    """Read the mosaic of a folder; None without a readable one."""
    try:
        data = read_bytes(folder / MOSAIC, MAX_PICTURE_BYTES)
        found = re.search(r"EPSG:(\d+)</SRS>\s*<GeoTransform>(.*?)</GeoTransform>",
                          read_text(folder / PLACE, _PLACE_BYTES))  # fmt: skip
        if found is None:
            return None
        west, step, _, north, _, _ = map(float, found[2].split(","))
        with opened(io.BytesIO(data), MOSAIC, ("WEBP",)) as picture:
            image = np.array(picture.convert("RGBA"))
    except (ImageError, OSError, ValueError):
        return None
    if not (step > 0.0 and math.isfinite(west + step + north)):
        return None
    return UtmMosaic(image, west, north, step, int(found[1]))


@dataclass(frozen=True, slots=True)
class Ground:
    """A mosaic of a folder: `image` as it was written, `raster` in the fixed frame."""

    raster: Raster
    image: Colours

    @classmethod
    def at(cls, image: Colours, west: float, north: float, step: float, grid: Grid) -> Ground:
        """Create the mosaic from its upper left corner and edge of a pixel in metres of UTM."""
        rows, columns = image.shape[:2]
        west_m, north_m = west - grid.origin.east_m, north - grid.origin.north_m
        scaled = (west_m / grid.scale, north_m / grid.scale, step / grid.scale)
        return cls(Raster(*scaled, columns, rows), image)

    @classmethod
    def read(cls, folder: Path, grid: Grid) -> Ground | None:
        """Read the mosaic of a folder; None without a readable one."""
        found = read_mosaic(folder)
        return None if found is None else cls.at(found.image, *found[1:4], grid)

    def beneath(self, view: View) -> NDArray[np.uint8]:
        """Return the mosaic in a view, for `uavmap.output.drawing.raster.cell_picture`."""
        raster = self.raster
        times = 1.0 / (view.px_per_m * raster.pitch_m)  # pixels of the raster in one of the view
        left = (view.left_m - raster.west_m) / raster.pitch_m
        top = (raster.north_m - view.top_m) / raster.pitch_m
        image = self.image
        if times > 1.0:  # averages detail between the view's pixels, which would speckle
            blur = 0.5 * math.sqrt(times**2 - 1.0)
            image = np.asarray(cv2.GaussianBlur(image, (0, 0), blur), np.uint8)
        matrix = np.array([[times, 0.0, left + (times - 1.0) / 2.0],
                           [0.0, times, top + (times - 1.0) / 2.0]])  # fmt: skip
        size = view.width_px, view.height_px
        how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        found = np.asarray(cv2.warpAffine(image, matrix, size, flags=how), np.uint8)
        found[..., 3] = np.where(found[..., 3] >= _OPAQUE, 255, 0)
        return found


def finest_ground(folder: Path, grid: Grid, side_px: int) -> Ground | None:
    """Return ortho.tif of a folder, shrunk by a whole number to sides of at most `side_px`.

    Without rasterio or that file, return mosaic.webp unchanged; None without either.
    """
    return _ortho(folder / ORTHO, grid, side_px) or Ground.read(folder, grid)


def _ortho(path: Path, grid: Grid, side_px: int) -> Ground | None:
    try:
        import rasterio  # noqa: PLC0415 - an extra
    except ImportError:
        return None
    if not path.is_file():
        return None
    try:
        with rasterio.open(path) as file:
            if file.crs is None or file.crs.to_epsg() != grid.zone.epsg or file.count < 3:
                return None
            times = math.ceil(max(file.width, file.height) / side_px)
            columns, rows = file.width // times, file.height // times
            if not (columns and rows):
                return None
            part = rasterio.windows.Window(0, 0, columns * times, rows * times)
            bands = file.read((1, 2, 3), window=part, out_shape=(3, rows, columns))
            there = file.dataset_mask(window=part, out_shape=(rows, columns))
            step, _, west, _, _, north = tuple(file.transform)[:6]
    except OSError:  # rasterio's errors are of this class as well
        return None
    image = np.ascontiguousarray(np.concatenate([bands, there[None]]).transpose(1, 2, 0))
    return Ground.at(image, west, north, step * times, grid)
