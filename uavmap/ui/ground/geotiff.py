"""A GeoTIFF or Cloud Optimized GeoTIFF as a map beneath, such as the user's orthophoto."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any, Final

import numpy as np
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError

from missions.errors import OutputError
from uavmap.photos.ground.rasters import need_rasterio
from uavmap.ui.ground.warped import (
    SIDE_PX,
    Colours,
    Points,
    encode_tile,
    levels_of,
    tile_nodes,
    warp_tile,
)

_REMEDY: Final = "convert it with: gdal_translate -ot Byte -scale"


class GeoTiff:
    """A georeferenced picture of bytes, gray or in colours. Raises `OutputError` for another
    file."""

    attribution = ""

    def __init__(self, path: Path) -> None:
        need_rasterio(str(path))
        import rasterio  # noqa: PLC0415 - an extra

        self._windows = rasterio.windows
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # a missing place is an error below
                file = self._file = rasterio.open(path, driver="GTiff")
        except OSError as error:  # the base of rasterio's errors
            raise OutputError(f"{path}: cannot be read as GeoTIFF: {error}") from None
        try:
            if file.crs is None or file.transform.is_identity:
                raise OutputError(f"{path}: has no place; give a georeferenced picture")
            if set(file.dtypes) != {"uint8"}:
                raise OutputError(f"{path}: has values of type {file.dtypes[0]}; {_REMEDY}")
            crs = CRS.from_wkt(file.crs.to_wkt())
            self._to_file = Transformer.from_crs("EPSG:4326", crs, always_xy=True)
        except (OutputError, CRSError) as error:
            file.close()
            raise OutputError(str(error)) from None
        self._back = tuple(~file.transform)[:6]
        self._bands = (1, 2, 3) if file.count >= 3 else (1, 1, 1)
        x, y = file.xy(file.height / 2, file.width / 2, offset="ul")
        lon, lat = self._to_file.transform(x, y, direction="INVERSE")
        self.middle = lat, lon
        self.zooms = levels_of(self._pixels, self.middle)

    def _pixels(self, lon: Points, lat: Points) -> tuple[Points, Points]:
        a, b, c, d, e, f = self._back
        x, y = self._to_file.transform(lon, lat)
        return a * x + b * y + c, d * x + e * y + f

    def tile(self, zoom: int, x: int, y: int) -> bytes | None:
        """Return a tile; None if it shows no ground. Overviews of the file are used."""
        nodes = tile_nodes(self._pixels, zoom, x, y)
        if not np.isfinite(nodes).all():
            return None
        (left, top), (right, bottom) = nodes.min(axis=(1, 2)), nodes.max(axis=(1, 2))
        times = max((right - left) / SIDE_PX, (bottom - top) / SIDE_PX, 1.0)
        pad = 2.0 * times  # px, for the interpolation at the rim
        west, north = max(math.floor(left - pad), 0), max(math.floor(top - pad), 0)
        width = min(math.ceil(right + pad), self._file.width) - west
        height = min(math.ceil(bottom + pad), self._file.height) - north
        if width <= 0 or height <= 0:
            return None
        image = self._read(self._windows.Window(west, north, width, height), times)
        rows, columns = image.shape[:2]
        nodes[0] = (nodes[0] - west) * columns / width
        nodes[1] = (nodes[1] - north) * rows / height
        return encode_tile(warp_tile(image, nodes))

    def _read(self, window: Any, times: float) -> Colours:
        shape = max(round(window.height / times), 1), max(round(window.width / times), 1)
        bands = self._file.read(self._bands, window=window, out_shape=(3, *shape))
        there = self._file.dataset_mask(window=window, out_shape=shape)
        return np.ascontiguousarray(np.concatenate([bands, there[None]]).transpose(1, 2, 0))

    def close(self) -> None:
        """Close the file."""
        self._file.close()
