"""ortho.tif and probability.tif, for geographic information systems, by rasterio (the extra `geo`).

They are Cloud Optimized GeoTIFFs. GDAL makes such a file from another one, so the blocks go into a
temporary file beside it first. Each file is whole or absent.
"""

from __future__ import annotations

import errno
import logging
import math
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from missions.errors import ImageError, OutputError, UavmapError
from missions.geo.grid import Grid
from uavmap.base.extras import install_command
from uavmap.output.drawing.mosaic_file import ORTHO, PROBABILITY, utm_transform
from uavmap.photos.ground.fine_map import FineMap, Tile, mosaic, upright
from uavmap.photos.ground.judging import Judge
from uavmap.photos.ground.surface import ScenePicture, aligned
from uavmap.photos.sources.picture_record import Placed
from uavmap.photos.workers import Threads
from vision.mosaic import Colours
from vision.raster import MOST, UNSEEN, Levels, Raster, Window, framed

TILE_PX: Final = 512
_CACHE_MB: Final = 64  # of GDAL, whose default is a twentieth of the machine's memory
_COMMON: Final = {"bigtiff": "IF_SAFER"}
_THREADS: Final = {"num_threads": "ALL_CPUS"}  # not for blocks: GDAL would not report a full disk
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
    4,  # GDAL makes the last one, coverage, a mask beside a JPEG
    # band by band: GDAL shrinks bands for overviews in half the time
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
    """Return True if rasterio is installed."""
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
    """Write a raster of the grid's moving frame, at its position at a mission time.

    Args:
        grid: Gives the UTM zone.
        blocks: Parts of the raster, each of shape (bands, rows, columns); absent ones are empty.

    Raises:
        OutputError: The disk refuses; then no part of the file is left.
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
        "transform": rasterio.Affine(*utm_transform(raster, grid, t_s)),
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
    except OSError as error:  # rasterio's errors are such
        reason = error.strerror or str(error).partition("\n")[0]
        helps = f"is there room in {path.parent}?"
        if error.errno in (errno.EISDIR, errno.EACCES, errno.EPERM, errno.EROFS):
            helps = "write into another folder"
        raise OutputError(f"{path.name} is not written ({reason}); {helps}") from None


def _read_again(path: Path) -> None:
    """Raise `OSError` if a file is not whole: GDAL does not report every full disk."""
    import rasterio  # noqa: PLC0415 - an extra

    with rasterio.open(path) as file:
        for _, window in file.block_windows(1):
            file.read(window=window)


# --- the rasters, block by block -----------------------------------------------------------------
_LOG: Final = logging.getLogger("uavmap.photos")
FINEST_M: Final = 0.05
"""Minimum default pixel of the mosaic, m; otherwise it is that of the pictures."""
MAX_PX: Final = 1_500_000_000
MAX_LEVELS_PX: Final = 8_000_000_000
"""Maximum pixels of the probabilities: empty ones need no room, but GDAL visits each."""
APART: Final = 0.5
"""Share of the raster within pictures below which the pictures count as separate sites."""
_SIDE: Final = 2048
_RECENT_BYTES: Final = 96 * 1024 * 1024  # of decoded pictures that the next block may need
_MINUTES: Final = 200  # number of pictures from which a line reports the making of the mosaic


@dataclass(frozen=True, slots=True)
class RasterSettings:
    """The rasters to write.

    Attributes:
        ortho: True to write the mosaic; None to write it if rasterio is installed.
        gsd_m: Edge of its pixels, m; None for that of the pictures, at least `FINEST_M`.
    """

    ortho: bool | None = None
    gsd_m: float | None = None

    def check(self) -> None:
        """Raise `UavmapError` if a setting needs rasterio, and it is missing."""
        if self.ortho or (self.gsd_m is not None and self.ortho is None):
            need_rasterio("--gsd" if self.ortho is None else "--ortho")


@dataclass(frozen=True, slots=True)
class Rasters:
    """The rasters of a replay at a mission time; `placed`: the pictures by `Footing.number`."""

    fine: FineMap
    judge: Judge
    placed: Sequence[Placed]
    t_s: float
    threads: Threads

    def write(self, folder: Path, settings: RasterSettings) -> bool:
        """Write the files if rasterio is installed; return True if it is. Raises `OutputError`."""
        wanted = [PROBABILITY] if settings.ortho is False else [PROBABILITY, ORTHO]
        if not there():
            _LOG.info(
                f"{' and '.join(wanted)}: not written without rasterio: {install_command('geo')}"
            )
            return False
        self._write_probability(folder / PROBABILITY)
        if ORTHO in wanted:
            self._write_ortho(folder / ORTHO, settings.gsd_m)
        return True

    def _write_probability(self, path: Path) -> None:
        surface, grid = self.fine.surface, self.fine.setting.grid
        raster = surface.raster
        if raster.rows * raster.columns > MAX_LEVELS_PX:
            _LOG.info(
                f"{PROBABILITY}: not written: it would have {raster.columns:,} x {raster.rows:,} "
                f"pixels of {raster.pitch_m:.2g} m, and at most {MAX_LEVELS_PX:,} are written; "
                f"boundary.geojson has the region{self._remedy()}"
            )
            return
        blocks = ((window, _probabilities(levels)[None]) for window, levels in surface.seen())
        write_cog(path, surface.raster, grid, self.t_s, PROBABILITIES, blocks)

    def _remedy(self) -> str:
        """Return the remedy for a raster that is large and mostly empty; otherwise nothing."""
        raster = self.fine.scene.raster
        shown_px = sum(math.prod(entry.window.shape) for entry in self.fine.scene.shown)
        if shown_px > APART * raster.rows * raster.columns:
            return ""
        return "; most of that is ground between the pictures: replay each site by itself"

    def _write_ortho(self, path: Path, gsd_m: float | None) -> None:
        grid, scene = self.fine.setting.grid, self.fine.scene
        low = np.min([entry.bounds[0] for entry in scene.shown], axis=0)
        high = np.max([entry.bounds[1] for entry in scene.shown], axis=0)
        step = gsd_m or max(FINEST_M, round(median(self._gsd_m(e) for e in scene.shown), 2))
        least = math.sqrt(float(np.prod(high - low)) / MAX_PX)
        if step < least:
            step = math.ceil(100.0 * least) / 100.0
            _LOG.info(
                f"{ORTHO}: {step:g} m a pixel, or it would have more than {MAX_PX:,}"
                f"{self._remedy()}"
            )
        if len(scene.shown) >= _MINUTES:
            _LOG.info(
                f"{ORTHO}: projecting {len(scene.shown)} pictures, {step:g} m a pixel; all else is "
                "written (Ctrl-C leaves it out)"
            )
        raster, unread = aligned(grid, low, high, step), set[str]()
        blocks = self._blocks(raster, step, unread, Recent(_RECENT_BYTES))
        write_cog(path, raster, grid, self.t_s, COLOURS, blocks)
        for name in sorted(unread):
            _LOG.info(f"{ORTHO}: without {name}, which cannot be read any more")

    def _blocks(
        self, raster: Raster, step_m: float, unread: set[str], recent: Recent
    ) -> Iterator[tuple[Window, NDArray[np.uint8]]]:
        shown = self.fine.scene.shown
        blocks = raster.shared((raster.around(*entry.bounds) for entry in shown), _SIDE)
        last = {number: block for block, numbers in blocks.items() for number in numbers}
        for block, numbers in blocks.items():
            tiles = (
                Tile(shown[n], self._pixels(shown[n], step_m, unread, recent)) for n in numbers
            )
            found = mosaic(raster, block, tiles, self.threads)
            # pictures that no further block needs
            recent.forget(shown[n].footing.number for n in numbers if last[n] == block)
            if found is not None:
                yield block, np.ascontiguousarray(found.transpose(2, 0, 1))

    def _pixels(
        self, entry: ScenePicture, step_m: float, unread: set[str], recent: Recent
    ) -> Callable[[], Colours | None]:
        """Return a picture as finely as the mosaic shows it; its next block may need it again."""
        footing, placed = entry.footing, self.placed[entry.footing.number]
        width_px = math.ceil(placed.picture.width_px * min(1.0, self._gsd_m(entry) / step_m))

        def decoded() -> Colours | None:
            try:
                frame = self.judge.frame(placed, footing.t_s, max(1, width_px))
            except ImageError:
                unread.add(placed.picture.name)
                return None
            return framed(upright(frame.image, turned=footing.turned))

        return lambda: recent.get(footing.number, decoded)

    def _gsd_m(self, entry: ScenePicture) -> float:
        """Return the ground sample distance of a picture at its full size."""
        footing = entry.footing
        whole_px = self.placed[footing.number].picture.width_px
        return footing.gsd_m * footing.camera.width_px / whole_px


def _probabilities(levels: Levels) -> NDArray[np.float32]:
    seen = levels.astype(np.float32) / np.float32(MOST)
    return np.where(levels == UNSEEN, np.float32(NOWHERE), seen)


Pixels = NDArray[np.uint8]


@dataclass(slots=True)
class Recent:
    """The most recently used pictures by number, up to `most_bytes`; for any thread.

    Two threads that need the same picture at once both make it.

    >>> recent, made = Recent(most_bytes=8), []
    >>> def picture():
    ...     made.append(1)
    ...     return np.zeros((2, 2), np.uint8)
    >>> for number in (1, 2, 1, 3, 2, 1):
    ...     _ = recent.get(number, picture)
    >>> len(made)
    5
    """

    most_bytes: int
    _kept: OrderedDict[int, Pixels] = field(default_factory=OrderedDict)
    _bytes: int = 0
    _one_at_a_time: threading.Lock = field(default_factory=threading.Lock)

    def get(self, number: int, make: Callable[[], Pixels | None]) -> Pixels | None:
        """Return the picture of a number, made if absent; None if it cannot be made."""
        with self._one_at_a_time:
            found = self._kept.get(number)
            if found is not None:
                self._kept.move_to_end(number)
                return found
        made = make()
        if made is not None:
            self._keep(number, made)
        return made

    def forget(self, numbers: Iterable[int]) -> None:
        """Drop pictures that are not needed again."""
        with self._one_at_a_time:
            for number in numbers:
                gone = self._kept.pop(number, None)
                self._bytes -= 0 if gone is None else gone.nbytes

    def _keep(self, number: int, made: Pixels) -> None:
        with self._one_at_a_time:
            if number not in self._kept:
                self._bytes += made.nbytes
            self._kept[number] = made
            while self._bytes > self.most_bytes:
                _, oldest = self._kept.popitem(last=False)
                self._bytes -= oldest.nbytes
