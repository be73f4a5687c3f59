"""Rasters as Cloud Optimized GeoTIFF, by rasterio (the extra `geo`).

GDAL makes such a file of another one, so the blocks go into a temporary one beside it first. Either
file is whole or absent.
"""

from __future__ import annotations

import errno
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from numpy.typing import NDArray

from missions.errors import OutputError, UavmapError
from missions.geo.grid import Grid
from uavmap.base.extras import install_command
from vision.raster import Raster, Window

TILE_PX: Final = 512
_CACHE_MB: Final = 64  # of GDAL, which would take a twentieth of the machine
_COMMON: Final = {"bigtiff": "IF_SAFER"}
_THREADS: Final = {"num_threads": "ALL_CPUS"}  # not to write blocks: a full disk is not told then
_TILED: Final = {"tiled": True, "blockxsize": TILE_PX, "blockysize": TILE_PX, "sparse_ok": True}


@dataclass(frozen=True, slots=True)
class Layout:
    """Data type and bands of a GeoTIFF; options of the temporary and of the final file."""

    dtype: str
    bands: int
    made: Mapping[str, Any]
    copied: Mapping[str, Any]


COLOURS: Final = Layout(
    "uint8",
    4,  # with the last one, how much is there, GDAL makes a mask beside a JPEG
    # band by band: GDAL shrinks that for overviews in half the time
    {
        "photometric": "RGB",
        "alpha": "YES",
        "interleave": "BAND",
        "compress": "DEFLATE",
        "zlevel": 1,
    },
    {"compress": "JPEG", "quality": 85, "overview_resampling": "AVERAGE"},
)
NOWHERE: Final = -1.0
"""Value of an unknown probability."""
PROBABILITIES: Final = Layout(
    "float32",
    1,
    {"nodata": NOWHERE, "compress": "DEFLATE", "zlevel": 1},
    {"compress": "DEFLATE", "predictor": "YES", "overview_resampling": "AVERAGE"},
)


def there() -> bool:
    """Whether rasterio is installed."""
    try:
        import rasterio  # noqa: F401, PLC0415 - an extra
    except ImportError:
        return False
    return True


def need_rasterio(what: str) -> None:
    """Raise `UavmapError` if rasterio, which `what` needs, is missing."""
    if not there():
        raise UavmapError(f"{what} needs rasterio: {install_command('geo')}")


def write_cog(
    path: Path,
    raster: Raster,
    grid: Grid,
    t_s: float,
    layout: Layout,
    blocks: Iterable[tuple[Window, NDArray[Any]]],
) -> None:
    """Write a raster of the grid's moving frame, as it lies at a mission time.

    Args:
        grid: Gives the UTM zone.
        blocks: Its parts, each of shape (bands, rows, columns); absent ones are empty.

    Raises:
        OutputError: The disk refuses; nothing is left of the file then.
    """
    import rasterio  # noqa: PLC0415 - an extra
    from rasterio.shutil import copy  # noqa: PLC0415

    profile = {
        "driver": "GTiff",
        "width": raster.columns,
        "height": raster.rows,
        "count": layout.bands,
        "dtype": layout.dtype,
        "crs": f"EPSG:{grid.zone.epsg}",
        "transform": rasterio.Affine(*_transform(raster, grid, t_s)),
    }
    try:
        with (
            rasterio.Env(GDAL_CACHEMAX=_CACHE_MB),
            tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name}.") as name,
        ):
            raw, done = Path(name) / "blocks.tif", Path(name) / path.name
            with rasterio.open(raw, "w", **profile, **_TILED, **_COMMON, **layout.made) as file:
                for window, values in blocks:
                    rows, columns = window.shape
                    place = rasterio.windows.Window(window.left, window.top, columns, rows)
                    file.write(values, window=place)
            copy(raw, done, driver="COG", sparse_ok=True, **_COMMON, **_THREADS, **layout.copied)
            _read_again(done)
            done.replace(path)
    except OSError as error:  # rasterio's own are such, too
        reason = error.strerror or str(error).partition("\n")[0]
        helps = f"is there room in {path.parent}?"
        if error.errno in (errno.EISDIR, errno.EACCES, errno.EPERM, errno.EROFS):
            helps = "write into another folder"
        raise OutputError(f"{path.name} is not written ({reason}); {helps}") from None


def _transform(raster: Raster, grid: Grid, t_s: float) -> tuple[float, ...]:
    """Return the matrix from columns and rows to UTM, in the order of `Affine`."""
    step = raster.pitch_m * grid.scale
    west = grid.origin.east_m + (raster.west_m + grid.drift_east_m_s * t_s) * grid.scale
    north = grid.origin.north_m + (raster.north_m + grid.drift_north_m_s * t_s) * grid.scale
    return tuple(round(value, 9) for value in (step, 0.0, west, 0.0, -step, north))


def _read_again(path: Path) -> None:
    """Raise `OSError` if a file is not whole: GDAL does not report every full disk."""
    import rasterio  # noqa: PLC0415 - an extra

    with rasterio.open(path) as file:
        for _, window in file.block_windows(1):
            file.read(window=window)
